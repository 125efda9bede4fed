"""What imports what: layers point one way, start-up stays light, the judge stays independent."""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from rans.effectors.effector import Effector
from rans.model.actuators import Actuators
from rans.tasks import Task
from tests.support.processes import loaded, modules_loaded
from tests.support.sources import module_name

ROOT = Path(__file__).parents[1]
ROOMS = "rans", "validation", "campaigns"
HEAVY = {
    "torch",
    "pydrake",
    "casadi",
    "stable_baselines3",
    "gymnasium",
    "matplotlib",
    "tyro",
    "rich",
}

LAYERS: list[set[str]] = [
    {"rans.base"},
    {"rans.model"},
    {"rans.effectors"},
    {"rans.randomization"},
    {"rans.tasks"},
    {"rans.episode"},
    {"rans.policy"},
    {"rans.compile"},
    {"rans.fast", "rans.reference", "rans.control"},
    {"rans.evaluation"},
    {"rans.deploy"},
    {"rans.show"},
    {"rans.api"},
    {"rans.cli"},
    {"rans.extend"},
    {"validation.study"},
    {"validation.speed"},
    {"validation.judges"},
    {"validation.functions"},
    {"validation.commands"},
    {"campaigns"},
    {"rans.__main__"},
]
"""From the bottom up: a module imports from its own package and from lower layers only, so that engines
do not know one another. The package's front door, `rans` itself, hands out names of any layer lazily."""
RANK = {unit: rank for rank, units in enumerate(LAYERS) for unit in units}


OWN_ROOMS = "rans.model", "rans.effectors", "rans.tasks"
"""Where the kinds of tasks and effectors are known; other rooms ask a task or an effector for its properties."""
CHECKED: dict[str, set[str]] = {}
"""Kinds that a module asks for to refuse all others with a sentence."""
JUDGES = {"rans.reference.nozzles": {"Pulsed", "Throttle"}}
"""Drake's side reads settings only, and has to have equations of its own for each kind."""


LOADERS = {"load_spacecraft", "load_task", "load_conditions"}
"""Functions that take a name, a file or an object."""
DOORS = (
    "rans.api",
    "rans.cli",
    "rans.episode.environment",
    "rans.extend",
    "rans.fast.engine",
    "validation.commands",
    "validation.functions",
)
"""Where users' names, files and strings become values; below them functions take values."""
INNER_DOORS = {
    "rans.evaluation.fly.contestants",  # the text of a contestant names a task and a spacecraft
    "rans.evaluation.fly.contestant_name",  # also of the folder that an agent for any craft is written into
    "rans.fast.learn.config",  # so do training configs, which are files
    "rans.control.arguments",  # controllers are public classes, like Engine
    "rans.tasks",  # hands out load_task of its module names
}


def modules() -> list[tuple[str, Path]]:
    """Every module but the front door: name and file."""
    files = sorted(file for room in ROOMS for file in (ROOT / room).rglob("*.py"))
    found = [(module_name(file, ROOT), file) for file in files]
    return [(name, file) for name, file in found if name not in ROOMS]


MODULES = dict(modules())
NAMES = set(MODULES)


@cache
def parsed(file: Path) -> ast.Module:
    """The syntax tree of a file, which most tests below look through."""
    return ast.parse(file.read_text("utf-8"))


@cache
def imports(file: Path, types: bool = False) -> set[str]:
    """Names that a file imports, in functions and by `importlib` too, and for type checkers if asked for."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if not types and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            found.update({f"{node.module}.{alias.name}" for alias in node.names})
        if isinstance(node, ast.Constant) and node.value in NAMES:
            found.add(str(node.value))  # given to importlib
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(parsed(file))
    return found


def unit(name: str) -> str:
    """The package or module of `LAYERS` that a module, or a name in it, belongs to."""
    parts = name.split(".")
    return parts[0] if parts[0] == "campaigns" else ".".join(parts[:2])


def test_imports_point_down():
    found = []
    for name, file in MODULES.items():
        assert unit(name) in RANK, f"{name} is new: give it a place in LAYERS"
        for imported in imports(file, types=True):
            ours = imported.startswith(tuple(f"{room}." for room in ROOMS))
            if ours and unit(imported) != unit(name) and RANK[unit(imported)] >= RANK[unit(name)]:
                found.append(f"{name} imports {imported}")
    assert not found


LISTS = ("rans", "rans.extend", "rans.tasks")
"""Modules whose imports for types are lists of names that are imported on first use."""


def test_no_module_imports_itself_through_others():
    """In functions and for types neither: what needs one another is one module."""
    every = MODULES | PACKAGED
    graph = {
        name: {
            one if one in every else one.rpartition(".")[0]
            for one in imports(file, types=name not in LISTS)
        }
        - {name}
        for name, file in every.items()
    }
    TopologicalSorter(graph).prepare()  # its CycleError names the circle


def test_nothing_imports_the_front_door():
    """`import rans` reaches every layer; only the command's start may, and a name from it is no submodule's."""
    found = []
    for name, file in MODULES.items():
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.Import):
                names = {alias.name for alias in node.names} & {*ROOMS}
            elif isinstance(node, ast.ImportFrom) and node.module in ROOMS:
                names = {f"{node.module}.{alias.name}" for alias in node.names} - NAMES
            else:
                continue
            found += [f"{name} imports {imported}" for imported in names]
    assert not found


IN_PLACE = {
    "rans.base.terminal": {"rich"},
    "rans.effectors.commands": {"gymnasium"},
    "rans.episode.environment": {"gymnasium"},
}
"""Libraries that a module below the engines imports where they are asked for."""


def test_each_engine_keeps_to_its_library():
    found = []
    for name, file in MODULES.items():
        libraries = {imported.partition(".")[0] for imported in imports(file)}
        refused = set()
        if unit(name) == "rans.fast":
            refused |= {"pydrake", "casadi"}
        if RANK[unit(name)] <= RANK["rans.episode"]:
            refused |= HEAVY - IN_PLACE.get(name, set())
        found += [f"{name} imports {library}" for library in libraries & refused]
    assert not found


ONE_ROOM = {
    "rich.table": "rans.base.terminal",  # results are values (`rans.base.table.Table`), and it lays them out
    "matplotlib": "rans.show.figures.plotting",  # figures take their names from it, for its backend
    "jinja2": "rans.show.pages.page",
}
"""Libraries that one module alone imports for all."""
PACKAGED = {
    ".".join(file.relative_to(ROOT / "packages").with_suffix("").parts[1:]): file
    for file in sorted((ROOT / "packages").glob("*/rans_*/**/*.py"))
}
"""Modules of packages."""


def test_a_mechanism_has_one_room():
    """In what is installed, and in what draws figures of documents."""
    for mechanism, room in ONE_ROOM.items():
        found = {
            name
            for name, file in (MODULES | PACKAGED).items()
            if any(
                imported == mechanism or imported.startswith(f"{mechanism}.")
                for imported in imports(file)
            )
        }
        assert found == {room}


ELEMENT = re.compile(
    r"</?(?:body|canvas|div|h[1-6]|html|img|p|progress|script|span|style|svg|table|td|th|tr)(?:[ />]|$)"
)
BEGINNING = re.compile(ELEMENT.pattern.partition("(?:[")[0])
MARKED_UP = (
    "rans.show.pages",
    "rans.show.markup",
    "rans.show.figures.svg",
)
"""Modules that write elements of HTML or SVG: of pages, and of figures in them."""


def elements(text: str) -> list[str]:
    """Elements of HTML or SVG in the texts of a module."""
    if not BEGINNING.search(text):  # reading syntax takes ten times as long
        return []
    return [
        found[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if (found := ELEMENT.search(node.value))
    ]


def test_html_has_one_room():
    found = {
        name: names
        for name, file in (MODULES | PACKAGED).items()
        if not name.startswith(MARKED_UP) and (names := elements(file.read_text("utf-8")))
    }
    assert not found, "pages are made of `rans.show.pages.page.Section`, which escapes texts"


def test_the_judge_knows_nothing_of_our_equations():
    values = {f"rans.model.{name}" for name in ("spacecraft", "actuators", "body", "drift")}
    own = {f"rans.reference.{name}" for name in ("parts", "nozzles", "further", "frames")}
    for judge in ("plant.py", "parts.py", "nozzles.py", "further.py", "frames.py"):
        nodes = ast.walk(parsed(ROOT / "rans" / "reference" / judge))
        used = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        assert not used & {"wrench_map", "carry", "pulses"}
        ours = {
            name for name in imports(ROOT / "rans" / "reference" / judge) if name.startswith(ROOMS)
        }
        assert {name.rpartition(".")[0] for name in ours} <= {
            *values,
            *own,
            "rans.base.errors",
            "rans.base.registry",
        }


def derived(kind: type) -> set[str]:
    """Names of all classes of the package that are derived from one; other tests define some of their own."""
    return {
        one.__name__ for one in kind.__subclasses__() if one.__module__.startswith("rans.")
    }.union(*map(derived, kind.__subclasses__()))


def kinds_asked_for(tree: ast.Module, kinds: set[str]) -> set[str]:
    """Names among the kinds that a module passes to `isinstance`."""
    imported = {
        alias.asname or alias.name: alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(OWN_ROOMS)
        for alias in node.names
    }
    return {
        imported[part.id]
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance"
        for part in ast.walk(node.args[1])
        if isinstance(part, ast.Name) and imported.get(part.id) in kinds
    }


def test_only_their_own_rooms_know_kinds_of_tasks_and_effectors():
    kinds = derived(Task) | derived(Actuators) | derived(Effector)
    asked = {
        name: kinds_asked_for(parsed(file), kinds)
        for name, file in MODULES.items()
        if name.startswith("rans.") and not name.startswith(OWN_ROOMS)
    }
    assert {name: found for name, found in asked.items() if found} == CHECKED | JUDGES


def loaders_used(tree: ast.Module) -> set[str]:
    """Loaders that a module imports, under any name, or reads from another module."""
    used = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            used |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Attribute):
            used.add(node.attr)
    return used & LOADERS


def test_names_become_values_at_the_door():
    found = {
        name: loaders_used(parsed(file))
        for name, file in MODULES.items()
        if name.startswith("rans.") and not name.startswith(DOORS) and name not in INNER_DOORS
    }
    assert not {name: used for name, used in found.items() if used}


def test_tests_import_nothing_from_other_tests():
    """What several share is in `tests.support`, which imports from no test either."""
    shared = "tests.support."
    other = re.compile(
        r"\b(from|import) tests\.(?!support\b)"
    )  # reading syntax takes ten times as long
    found = {
        f"{file.relative_to(ROOT)} imports {name}"
        for file in (ROOT / "tests").rglob("*.py")
        if other.search(file.read_text("utf-8"))
        for name in imports(file)
        if name.startswith("tests.") and not name.startswith(shared)
    }
    assert not found


def test_start_up_is_light():
    """One after another in one process, whose modules are those of all of them."""
    statements = (
        "import rans",
        "import rans.tasks",
        "import rans.model.spacecraft_file",
        "import rans.episode.flight",
        "import rans.cli",
        "from rans.model.spacecraft_file import load_spacecraft as load",
        "load('free-flyer').wrench_map",
    )
    # Gymnasium takes 40 ms beyond NumPy, and learns our environments' names when rans is imported.
    assert loaded("; ".join(statements)) & (HEAVY | {"scipy", "numba"}) <= {"gymnasium"}


MACHINERY = {
    "rans.base",
    "rans.base.abilities",
    "rans.base.display",
    "rans.base.errors",
    "rans.base.files",
    "rans.base.lazy",
    "rans.base.registry",
    "rans.base.safe_path",
    "rans.base.system",
    "rans.tasks",
}
"""Modules by which `import rans` registers the environments of tasks by name, and loads everything else later."""


def test_import_rans_loads_no_implementation():
    """No spacecraft, task, engine or command: each is loaded when its name is used."""
    found = modules_loaded("import rans; dir(rans); print(rans.TASKS)")
    assert {name for name in found if name.startswith("rans.")} <= MACHINERY


LEFT_ALONE = {
    "from rans.cli import main; assert not main(['list'])": (
        "torch",
        "rans.policy",
        "rans.tasks.",
        "rans.api",
        "rans.cli.door",
        "rans.fast.engine",
        "rans.fast.learn.ppo",  # learners are listed by name
        "rans.optimal",
        "rans_optimal",
        "rans_missions.tasks",  # its files are found beside its package, which is empty
        "rans_missions.control",
        "rans.evaluation.measure",
    ),
    "import rans; rans.Engine; import rans.fast.learn.ppo": (
        "rans.optimal",
        "rans_optimal",
        "rans.reference",
        "rans.evaluation",
        "rans.show",
        "rans.cli",
        "rans_missions",
    ),
    "from rans.cli import main; assert not main(['evaluate', 'go-to-pose-2d', '--episodes', '2'])": (
        "rans.control",
        "rans.reference",
        "rans.evaluation.compare",
        "rans_foreign_policies",
        "rans.deploy",
    ),
}
"""Modules that a statement does not need, by beginnings of their names."""


@pytest.mark.slow
@pytest.mark.parametrize("statement", LEFT_ALONE, ids=["list", "engine", "evaluate"])
def test_what_is_not_used_is_not_loaded(statement, tmp_path):
    found = modules_loaded(f"import os, rans; os.chdir({str(tmp_path)!r})\n{statement}")
    assert not {name for name in found if name.startswith(LEFT_ALONE[statement])}


TRAIN = """
import sys
from rans.cli import main
from rans_any_craft import imitation
from rans.fast.learn.trainer import Trainer

def train(trainer, *_):
    imitation._ROUNDS = imitation._OWN_ROUNDS = imitation._UPDATES = 1
    imitation._SECONDS = 0.2
    given = trainer.learner.network, trainer.learner.adam, trainer._teacher, trainer.config.ppo
    imitation.imitate(trainer.engine, *given, lambda: True)
    trainer.save()
    raise KeyboardInterrupt

Trainer.train = train
assert main(["train", "go-to-pose", "--device", "cpu", "--output", {!r}]) == 130
assert "torch._dynamo" not in sys.modules  # torch's compiler takes 0.6 s to load
"""
"""An imitation, until the first step of reinforcement learning, and the files that it leaves."""


@pytest.mark.slow
def test_training_begins_without_drake_casadi_and_matplotlib(tmp_path):
    """It needs torch, Stable-Baselines3 and Gymnasium; the learning curve is drawn at its end."""
    found = loaded(TRAIN.format(str(tmp_path / "run")))
    assert "torch" in found
    assert not found & {"pydrake", "casadi", "matplotlib", "sympy", "scipy"}
