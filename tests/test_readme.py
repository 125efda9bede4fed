"""What the pages say is so: examples run, commands parse, links lead somewhere, tables are the code's."""

from __future__ import annotations

import dataclasses
import html
import inspect
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import rans
from rans import Conditions, Spacecraft, Timing
from rans.base.display import meanings
from rans.base.errors import EXTRAS, ConfigError
from rans.base.structure import structure
from rans.cli import COMMANDS, _parse
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.fast.learn.config import (
    FilterSettings,
    MemorySettings,
    PPOSettings,
    change_entry,
    to_table,
    training,
)
from rans.model.fields import map_leaves
from rans.model.spacecraft_file import load_spacecraft, parse_spacecraft
from rans.randomization.conditions_file import CONDITIONS
from rans.tasks import TASKS, GoToPose, observation_columns
from tests.support import plugins
from tests.support.sources import FOLDERS, sources

plugins.register()

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted({*(ROOT / "docs").glob("*.md"), *ROOT.glob("packages/*/docs/*.md")}),
]
DECISIONS = [
    page
    for folder in (ROOT / "docs", *sorted(ROOT.glob("packages/*/docs")))
    for page in sorted(folder.glob("decisions/*.md"))
]
CRAFT = load_spacecraft("floating-platform")


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a language."""
    found = re.findall(
        r"^```([^\n]*)\n(.*?)^```$", page.read_text("utf-8"), re.DOTALL | re.MULTILINE
    )
    return [text for own, text in found if own == language]


def rows(page: Path, heading: str, place: int = 0) -> list[list[str]]:
    """Cells of the first table, or a later one, whose first heading this is."""
    lines = page.read_text("utf-8").splitlines()
    first = [k for k, line in enumerate(lines) if line.startswith(f"| {heading} |")][place] + 2
    end = next(k for k in range(first, len(lines)) if not lines[k].startswith("|"))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[first:end]]


def test_examples_of_the_python_page_run():
    names = {}
    for example in blocks(ROOT / "docs" / "python.md", "python"):
        exec(example, names)
    assert names["engine"].num_envs == 64
    assert names["observation"].shape == (10,)
    np.testing.assert_allclose(names["flight"].times, np.linspace(0.0, 25.0, 251), rtol=1e-12)
    assert rans.load_agent("lqr:go-to-pose-2d@atmos").timing == Timing(0.2, episode_steps=125)


@pytest.fixture(scope="module")
def own_tasks() -> dict[str, Any]:
    """What the examples of the page of own tasks define."""
    names: dict[str, Any] = {}
    for example in blocks(ROOT / "docs" / "own_task.md", "python"):
        exec(example, names)
    return names


def test_the_task_of_the_page_of_own_tasks_is_met_and_its_goal_moves(own_tasks):
    task = own_tasks["Meet"]()
    flight = fly(CRAFT, task, rans.LQR(CRAFT, task), scenarios(task, CRAFT, 0, 4), Timing())
    moved = flight.goals.p - map_leaves(lambda x: x[0], flight.goals.p)
    # 25 s at 0.03 m/s
    assert moved.norm()[-1] == pytest.approx(0.75, rel=1e-12)
    assert flight.errors()["position"][-1].max() < task.position_tolerance


def test_the_mission_of_the_page_of_own_tasks_is_won(own_tasks):
    """By LQR, which comes to rest at the point: softly, and long before the time is up."""
    task = own_tasks["Dock"]()
    with pytest.warns(UserWarning, match="constraints"):
        lqr = rans.LQR(CRAFT, task)
    flight = fly(CRAFT, task, lqr, scenarios(task, CRAFT, 0, 4), task.timing)
    assert flight.done is not None
    assert flight.done.all()
    assert flight.lengths is not None
    assert flight.lengths.max() < 200
    assert set(flight.margins) == {"wall"}
    assert flight.rewards()["done"].sum(axis=0).tolist() == [10.0] * 4


@pytest.mark.usefixtures("forgotten")
def test_the_environments_of_the_page_of_own_tasks_are_made(here, monkeypatch):
    page = ROOT / "docs" / "own_task.md"
    example, *_ = blocks(page, "python")
    (here / "meet.py").write_text(example, "utf-8")
    monkeypatch.syspath_prepend(str(here))
    names: dict[str, Any] = {"rans": rans, "gymnasium": gymnasium}
    exec("from meet import Meet", names)
    said = page.read_text("utf-8").partition("For Gymnasium it is ")[2].partition("\n\n")[0]
    single, _, named, vector = (eval(code, names) for code in re.findall("`([^`]+)`", said))
    tasks = single.unwrapped.task, named.unwrapped.task, vector.engine.task
    assert tasks == (names["Meet"](),) * 3


def test_the_python_page_has_every_function():
    told = [
        row[0].strip("`").removeprefix("rans.").partition("(")[0]
        for row in rows(ROOT / "docs" / "python.md", "function")
    ]
    assert sorted(told) == sorted(
        name
        for name in dir(rans)
        if getattr(getattr(rans, name), "__module__", "").startswith(
            ("rans.api", "rans_", "validation.")
        )
        and inspect.isfunction(getattr(rans, name))
    )


def test_examples_of_the_environments_page_run():
    examples = blocks(ROOT / "docs" / "environments.md", "python")
    assert len(examples) == 4
    names = {}
    for example in examples:
        exec(example, names)
        if "env" not in names:
            assert names["observation"].shape == (4096, 10)
            assert torch.isfinite(names["reward"]).all()
    assert names["picture"].ndim == 3
    assert names["agent"].num_timesteps >= 1000
    names["env"].close()


def test_the_example_of_the_readme_says_what_it_prints(capsys):
    (example,) = blocks(ROOT / "README.md", "python")
    names = {}
    exec(example, names)
    assert names["observation"].shape == (4096, 10)
    printed = capsys.readouterr().out
    stated = re.search(r"print\(.*# ([0-9.]+), %", example)
    assert stated
    assert float(printed) == float(stated[1])


def commands_in_markup(text: str) -> set[str]:
    """Commands between tags, and in strings of scripts; each may end with what a script puts in."""
    tagged = re.findall(r"<(?:code|pre)[^>]*>\s*(rans [^<]+)</", text)
    quoted = re.findall(r"""["'`](rans [^"'`\n]+)["'`]""", text)
    return {html.unescape(found) for found in (*tagged, *quoted)}


def commands() -> set[str]:
    """The commands of all pages, of templates of pages that RANS writes, and of their scripts."""
    found: set[str] = set()
    for file in (file for folder in FOLDERS for file in folder.rglob("*")):
        if file.suffix in (".j2", ".js", ".html"):
            found |= commands_in_markup(file.read_text("utf-8"))
    for page in PAGES:
        found.update(re.findall(r"`(rans [^`\n]+)`", page.read_text("utf-8")))
        found |= commands_in_markup(page.read_text("utf-8"))
        found.update(re.findall(r"^(rans .+)$", "".join(blocks(page, "")), re.MULTILINE))
    return found


def check_changes(task: str, arguments: list[str]) -> None:
    """Refuse (`ConfigError`) a --set of an entry that a training of this task does not have; of a file, go-to-pose.

    Algorithms of one's own are not installed here.
    """
    table = to_table(training(task if task in TASKS else "go-to-pose", device="cpu"))
    for word, change in pairwise(arguments):
        if word == "--set" and not change.startswith("algorithm="):
            change_entry(table, *change.split("=", 1))


def test_commands_parse():
    refused = []
    for line in sorted(commands()):
        arguments = shlex.split(line, comments=True)[1:]
        if len(arguments) > 1 and arguments[0] in COMMANDS:
            try:
                _parse(arguments)
                if arguments[0] == "train":
                    check_changes(arguments[1], arguments)
            except (SystemExit, ConfigError) as error:
                refused.append((line, str(error)))
    assert not refused


def test_links_lead_somewhere():
    lost = [
        (page.relative_to(ROOT).as_posix(), target)
        for page in (
            *PAGES,
            *ROOT.glob("packages/*/README.md"),
            *ROOT.glob("examples/**/README.md"),
        )
        for target in re.findall(r"\]\(([^)#]+)", page.read_text("utf-8"))
        if not target.startswith("https://") and not (page.parent / target).exists()
    ]
    assert not lost


def test_every_module_at_the_top_of_the_package_has_a_line_in_the_architecture():
    """A stranger could not find out what belongs into `rans/episode/environment.py`."""
    rooms = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    modules = [file.name for file in (ROOT / "rans").glob("*.py") if file.name[0] != "_"]
    assert [name for name in modules if f"`rans/{name}`" not in rooms] == []


def headings(page: Path) -> set[str]:
    """Anchors of a page's headings, as MyST and GitHub make them."""
    titles = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def test_what_names_a_decision_leads_to_one():
    """In pages, code and data: the page exists, and so does the heading that a link names."""
    named = re.compile(r"decisions/([\w-]+\.\w+)(?:#([\w-]+))?")
    anchors = {page.name: headings(page) for page in DECISIONS}
    files = [
        ROOT / name for name in ("CHANGELOG.md", "CONTRIBUTING.md", "README.md", "SECURITY.md")
    ]
    rooms = ("rans", "validation", "campaigns", "changelog", "docs", "tests", "examples")
    for folder in (*rooms, "packages"):
        files += [
            file
            for end in ("md", "py", "toml")
            for file in (ROOT / folder).rglob(f"*.{end}")
            if file != Path(__file__)
        ]
    for file in files:
        for name, heading in named.findall(file.read_text("utf-8")):
            assert name in anchors, f"{file.relative_to(ROOT)} names decisions/{name}"
            assert not heading or heading in anchors[name], f"{file.relative_to(ROOT)}: #{heading}"


def test_the_rooms_are_there():
    for room, _ in rows(ROOT / "docs" / "architecture.md", "room"):
        for name in re.findall(r"`([^`]+)`", room):
            assert (ROOT / name).exists(), name


def test_the_spacecraft_page_has_a_spacecraft_and_all_its_keys():
    page = ROOT / "docs" / "spacecraft.md"
    toml, *_ = blocks(page, "toml")
    craft = parse_spacecraft(
        toml, page.name
    )  # warns, which is an error here, if it cannot be controlled
    # Thruster 0 pushes along -x at y = 0.2 m: a torque of 0.2 N m, wherever along x the centre is.
    assert craft.wrench_map[0] == pytest.approx((-1.0, 0.0, 0.2), abs=1e-15)
    # No exhaust crosses the plate: forces point inwards.
    assert all(np.dot(one.position, one.direction) < 0.0 for one in craft.thrusters)
    keys = {key for row in rows(page, "key") for key in re.findall(r"`([a-z_]+)`", row[0])}
    several = {  # a table each
        "thrusters": "thruster",
        "wheels": "wheel",
        "further_effectors": "effector",
    }
    assert keys == {several.get(field.name, field.name) for field in dataclasses.fields(Spacecraft)}


def test_the_conditions_page_names_all_keys_and_files():
    page = ROOT / "docs" / "conditions.md"
    named = {key for row in rows(page, "table") for key in re.findall(r"[a-z_]+", " ".join(row))}
    for key, _ in described(Conditions()):
        assert set(key.split(".")) <= named, key
    names = [row[0].strip("`") for row in rows(page, "name")]
    assert names == list(CONDITIONS.built_in)
    own = structure(tomllib.loads(blocks(page, "toml")[0]), Conditions, page.name)
    assert own.thrusters.latency == (0.0, 0.05)


def described(given: Any, place: str = "") -> Iterator[tuple[str, tuple[Any, str]]]:
    """Every key of a dataclass of dataclasses, its default as TOML has it, and the text under its field."""
    told = meanings(type(given))
    for one in dataclasses.fields(given):
        value = getattr(given, one.name)
        if dataclasses.is_dataclass(value):
            yield from described(value, f"{place}{one.name}.")
        else:
            plain = [] if value is None else list(value) if isinstance(value, tuple) else value
            yield place + one.name, (plain, told[one.name])


def test_the_pages_of_training_have_the_settings_with_their_defaults():
    of = {
        "": training("go-to-pose", device="cpu"),
        "ppo": PPOSettings(),
        "ppo.memory": MemorySettings(),
        "ppo.filters": FilterSettings(),
    }
    docs = ROOT / "docs"
    tables = {"training.md": 1, "memory.md": 1}
    listed = [
        row
        for page, count in tables.items()
        for place in range(count)
        for row in rows(docs / page, "setting", place)
    ]
    for key, default, _ in listed:
        room, _, name = key.strip("`").rpartition(".")
        value = getattr(of[room], name)
        assert json.loads(default.strip("`")) == (
            list(value) if isinstance(value, tuple) else value
        ), key


def test_the_tasks_page_has_the_observation_and_the_rewards():
    page = ROOT / "docs" / "tasks.md"
    task = GoToPose()
    columns = [(str(k), *column) for k, column in enumerate(observation_columns(task, 2))]
    assert [tuple(row) for row in rows(page, "column")] == columns
    settings = {
        "position": task.position_scale,
        "attitude": task.attitude_scale,
        "approach": task.approach_scale,
        "turn": task.turn_scale,
        "thrust": task.thrust_weight,
    }
    told = {row[0].strip("`"): row[1] for row in rows(page, "term")}
    assert told.keys() == settings.keys()
    for term, value in settings.items():
        assert f"{value:g}" in told[term]


def test_extras_that_errors_and_pages_name_exist():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
        "optional-dependencies"
    ]
    texts = [page.read_text("utf-8") for page in PAGES]
    texts.append((ROOT / "examples/notebook/first_agent.ipynb").read_text("utf-8"))
    named = {
        name.strip()
        for text in texts
        for many in re.findall(r"(?:rans|\.)(?:-[\w.]+whl)?\[([a-z0-9, ]+)\]", text)
        for name in many.split(",")
    }
    assert {"fast", "plots", "optimal"} <= named
    assert (named | {*EXTRAS.values()}) - extras.keys() == {"agents"}  # a folder
    # No index has RANS, so that pip finds whoever has taken its name there.
    texts += [file.read_text("utf-8") for _, file in sources()]
    assert not re.search(r"pip install (-\S+ )*['\"]?rans[\[\s=]", "\n".join(texts))


OF_OTHERS = {
    *("RANK", "WORLD_SIZE", "LOCAL_RANK", "LOCAL_WORLD_SIZE", "TORCHELASTIC_ERROR_FILE"),
    *("COLUMNS", "DISPLAY", "WAYLAND_DISPLAY"),
}
"""Variables that torchrun, terminals and the desktop set, and no user."""


def test_environment_variables_are_listed():
    """All that the sources read by name, except those of launchers."""
    texts = [file.read_text("utf-8") for _, file in sources()]
    read = {
        name for text in texts for name in re.findall(r'environ(?:\.get\(|\[)"([A-Z_]+)"', text)
    }
    read |= {name for text in texts for name in re.findall(r'_VARIABLE = "([A-Z_]+)"', text)}
    listed = " ".join(row[0] for row in rows(ROOT / "docs/terminal.md", "variable"))
    named = {name.partition("=")[0] for name in re.findall(r"`([^`]+)`", listed)}
    assert {"RANS_TRUST", "RANS_TRACEBACK"} <= read
    assert read - OF_OTHERS - named == set()
