"""Names from anywhere: what is found, what is not, and what a broken package may not break."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from types import SimpleNamespace
from typing import Any, cast

import gymnasium
import pytest

from rans import ConfigError
from rans.base.registry import Registry, typed
from rans.effectors.effector import Begun, Effector
from rans.tasks import TASKS, GoToPose, SingleTask
from tests.support.processes import printed

MODULE = """
import sys
sys.modules["loaded_witness"] = sys
number = 7
def faulty(): return number.of_craft
text = "seven"
"""


def number(found: Any) -> int:
    if callable(found):
        found = found()
    if not isinstance(found, int):
        raise ConfigError(f"it is no number, got {found!r}.")
    return found


Install = Callable[..., None]


@pytest.fixture
def install(tmp_path, monkeypatch) -> Iterator[Install]:
    """Puts a package on the path: its module, and metadata with entry points as pip writes them."""
    before = set(sys.modules)
    monkeypatch.syspath_prepend(str(tmp_path))

    def package(name: str, module: str = MODULE, **entries: str) -> None:
        (tmp_path / f"{name}.py").write_text(module)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = "".join(f"{key} = {value}\n" for key, value in entries.items())
        (info / "entry_points.txt").write_text(f"[numbers]\n{lines}")

    yield package
    for added in set(sys.modules) - before:
        del sys.modules[added]


def registry() -> Registry[int]:
    return Registry("number", "numbers", {"byte": "tests.base.test_registry:BYTE"}, number)


BYTE = 8


def test_names_import_nothing_until_they_are_used(install):
    install("offer", seven="offer:number", broken="nowhere:x")
    found = registry()
    assert list(found) == ["byte", "broken", "seven"]
    assert "seven" in found
    assert "eight" not in found
    assert (found.package("seven"), found.package("byte")) == ("offer", "")
    assert "loaded_witness" not in sys.modules
    assert (found["seven"], found["byte"]) == (7, 8)
    assert "loaded_witness" in sys.modules


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (
            "nowhere_at_all:x",
            "the number 'bad' of the package offer cannot be used: ModuleNotFoundError: No module named",
        ),
        (
            "offer:missing",
            "of the package offer cannot be used: offer has no 'missing'",
        ),
        ("offer:faulty", "of the package offer cannot be used: offer.py, line .* AttributeError"),
        ("offer:text", "of the package offer cannot be used: it is no number, got 'seven'"),
    ],
)
def test_a_broken_package_is_one_sentence_and_breaks_nothing_else(install, entry, said):
    install("offer", seven="offer:number", bad=entry)
    found = registry()
    assert (found["byte"], found["seven"], len(found)) == (8, 7, 3)
    with pytest.raises(ConfigError, match=said):
        found["bad"]


@pytest.mark.parametrize(
    "ending", ["sys.exit(0)", "sys.exit('no licence')", "raise BaseException('no')"]
)
def test_a_package_that_ends_the_process_is_named(install, ending):
    install("quitter", f"import sys\n{ending}\n", early="quitter:number")
    with pytest.raises(ConfigError, match="'early' of the package quitter cannot be used"):
        registry()["early"]


@pytest.mark.parametrize(
    "line", ["eight", "eig\x1b[2Jht = careless:number", f"{'8' * 101} = careless:number"]
)
def test_a_line_without_an_equals_sign_or_a_name_breaks_no_other_package(line, install, tmp_path):
    install("careful", seven="careful:number")
    install("careless", eight="careless:number")
    (tmp_path / "careless-1.0.dist-info/entry_points.txt").write_text(f"[numbers]\n{line}\n")
    with pytest.warns(UserWarning, match="entry points of the package careless cannot be read"):
        assert list(registry()) == ["byte", "seven"]


def test_of_two_distributions_of_one_name_the_first_counts(install, tmp_path, monkeypatch):
    install("twice", old="twice:number")
    info = tmp_path / "twice-1.0.dist-info"
    shutil.copytree(info, tmp_path / "later" / info.name)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path / "later")])
    (info / "entry_points.txt").write_text("[others]\nnew = twice:number\n")
    assert [*registry()] == ["byte"]


def test_two_packages_with_one_name_are_named_and_none_replaces_what_is_built_in(install):
    install("one", same="one:number", byte="one:number")
    install("two", same="two:number")
    found = registry()
    with pytest.raises(ConfigError, match="'same' of the package one and two cannot be used"):
        found["same"]
    assert (found["byte"], found.package("byte")) == (8, "")


def test_where_names_are_shared_every_package_counts_and_a_broken_one_is_named(install):
    install("one", same="one:number", byte="one:number")
    install("two", "number = 9", same="two:number")
    assert [*registry().each()] == [("byte", 8), ("same", 7), ("same", 9)]
    install("three", same="three:text")
    with pytest.raises(ConfigError, match="'same' of the package three cannot be used"):
        [*registry().each()]


def test_objects_of_the_current_folder(here, monkeypatch):
    (here / "beside_me.py").write_text("class Inner:\n    four = 4\n")
    monkeypatch.setattr(sys, "path", list(sys.path))
    found = registry()
    assert found[typed("beside_me:Inner.four")] == 4
    assert "beside_me:Inner.four" not in list(found)
    with pytest.raises(
        ConfigError, match="the number 'beside_me:five' cannot be used: beside_me has no 'five'"
    ):
        found[typed("beside_me:five")]


def test_modules_of_the_current_folder_take_nobodys_place(here, monkeypatch):
    """A stranger's module of the name of an installed one, which nothing has imported yet."""
    assert "this" not in sys.modules
    (here / "this.py").write_text("")
    (here / "also_beside_me.py").write_text("four = 4\n")
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = list(sys.path)
    assert registry()[typed("also_beside_me:four")] == 4
    assert sys.path == [*before, str(here)]
    found = importlib.util.find_spec("this")
    assert found is not None
    assert found.origin != str(here / "this.py")


class NotMade:
    """Nobody makes one to find out what it is."""

    def __new__(cls, *_: Any) -> Any:
        raise AssertionError("it was called")


def test_a_name_of_a_file_is_refused_until_the_user_types_it(monkeypatch):
    monkeypatch.setattr("rans.base.registry._typed", set())
    name = "tests.base.test_registry:BYTE"
    for trust in ("", "0", "no", "true"):
        monkeypatch.setenv("RANS_TRUST", trust)
        with pytest.raises(ConfigError, match="a file names the number"):
            registry()[name]
    found = registry()
    assert found[typed(name)] == 8
    monkeypatch.setattr("rans.base.registry._typed", set())
    with pytest.raises(ConfigError, match="a file names the number"):
        found[name]  # that it is loaded makes no difference
    monkeypatch.setenv("RANS_TRUST", "1")
    assert found[name] == 8


def test_registered_in_python():
    found = registry()
    assert found.register("two")(2) == 2
    assert (found["two"], list(found)) == (2, ["byte", "two"])
    found.register("two")(3)  # a notebook's cell may run twice
    assert found["two"] == 3
    with pytest.raises(ConfigError, match="it is no number"):
        found.register("three")("3")  # type: ignore[type-var]
    for taken in ("byte", "a:b", "two\nlines", 8 * "long names of "):
        with pytest.raises(ConfigError, match=r"choose another one|must be one line"):
            found.register(taken)


@dataclass(frozen=True)
class Far(GoToPose):
    """A task of a module that is nowhere enrolled."""

    spawn_distance: tuple[float, float] = (5.0, 6.0)


@dataclass(frozen=True)
class Unfinished(SingleTask):
    """It has next to nothing of a task."""

    length: float = 1.0


@dataclass(frozen=True)
class Mute(Effector):
    """It takes no commands, and does not say so."""

    def begin(self, begun: Begun) -> None: ...


@dataclass(frozen=True)
class Boundless(Unfinished):
    """Nothing says when its errors are small enough."""

    sample = observation_terms = errors = reward = failed = cast(Any, None)


@dataclass(frozen=True)
class Strange(GoToPose):
    """Nobody knows how to show or to bound its error."""

    gap_tolerance: float = 0.1


@dataclass(frozen=True)
class Unheard(GoToPose):
    """Nobody knows how to show one of its errors, which has no tolerance."""

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        return super().errors(state, goal) | {"gap": state.p.x}


@dataclass(frozen=True)
class Soft(GoToPose):
    """Has a tolerance of what it does not measure."""

    velocity_tolerance: float = 0.1

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        return {"position": (goal.p - state.p).norm()}


@dataclass(frozen=True)
class Aside(GoToPose):
    """What is asked for is 1 m from the goal, to which controllers fly."""

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        away = super().errors(state, goal)
        return away | {"position": abs(away["position"] - 1.0)}


@dataclass(frozen=True, kw_only=True)
class Demanding(GoToPose):
    """A setting of it has no default."""

    limit: float


def no_task() -> None:
    """Settings need fields."""


def test_a_task_by_its_module():
    assert TASKS[typed("tests.base.test_registry:Far")] is Far


@pytest.mark.usefixtures("forgotten")
def test_a_registered_task_has_gymnasium_ids():
    TASKS.register("far-away")(GoToPose)
    TASKS.register("far-away")(Far)  # a notebook's cell may run twice, with another class
    assert {"rans/FarAway2D-Drake-v0", "rans/FarAway3D-Drake-v0"} <= gymnasium.registry.keys()
    for name, width in (("rans/FarAway2D-v0", 10), ("rans/FarAway3D-v0", 22)):
        env: Any = gymnasium.make(name)
        assert env.reset(seed=0)[0].shape == (width,)
        assert type(env.unwrapped.task) is Far
        # Starts of Far are 5 to 6 m away, those of go-to-pose at most 4.5 m.
        assert float((env.unwrapped.goal.p - env.unwrapped.state.p).norm()) > 5.0
    assert gymnasium.make_vec("rans/FarAway3D-v0", num_envs=2).reset(seed=0)[0].shape == (2, 22)


WITHOUT = """
import sys
from pathlib import Path
sys.path.insert(0, {!r})
import rans
from rans.tasks import TASKS
from rans.model.spacecraft_file import SPACECRAFT
from rans.evaluation.fly.controllers import CONTROLLERS
assert "rocket-task" in TASKS and "rocket" in SPACECRAFT and "autopilot" in CONTROLLERS
import gymnasium
assert "rans/RocketTask3D-v0" in gymnasium.registry
assert not {{"torch", "pydrake", "casadi", "rocketry"}} & sys.modules.keys()
"""


def test_start_up_knows_the_names_of_packages_without_importing_them(tmp_path):
    info = tmp_path / "rocketry-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rocketry\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[rans.tasks]\nrocket-task = rocketry:Task\n[rans.spacecraft]\nrocket = rocketry:rocket\n"
        "[rans.controllers]\nautopilot = rocketry:Pilot\n"
    )
    (tmp_path / "rocketry.py").write_text("raise RuntimeError('imported')\n")
    printed("-c", WITHOUT.format(str(tmp_path)))


def test_names_of_the_distribution_of_rans_are_its_own(monkeypatch):
    """No other package replaces one, and none is called a package's."""
    entries = [
        EntryPoint("same", value, "numbers")._for(SimpleNamespace(name=name))  # pyrefly: ignore[missing-attribute]
        for value, name in (("builtins:no", "another"), ("tests.base.test_registry:BYTE", "rans"))
    ]
    monkeypatch.setattr("rans.base.registry._entry_points", lambda _: entries)
    found = registry()
    assert found["same"] == BYTE
    assert found.package("same") == ""
    assert found.comes_with_rans("same")
