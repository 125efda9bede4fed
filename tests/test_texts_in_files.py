"""MODULE:NAME in place of every text of every file that is read: no code runs, whoever reads it."""

from __future__ import annotations

import copy
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rans
from rans import RansError
from rans.base.files import write_json
from rans.base.structure import read_toml
from rans.cli import main
from rans.deploy.export import write_export
from rans.episode.step import Setup
from rans.evaluation.fly.tuned import Tuned
from rans.fast.learn.config import to_table
from tests.support import plugins
from tests.support.damage import edited, toml
from tests.support.training import CONFIG
from tests.support.written_files import TUNED, contents

plugins.register()

EVIL = "evil:E"
MODULE = 'from pathlib import Path\nPath("ran").write_text("")\nclass E:\n    pass\n'


def texts(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield every copy of a nested value with one text, or one value that may be a text, replaced."""
    return edited(value, lambda one: [EVIL] if isinstance(one, str | None) else [])


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A current folder with a stranger's module, which Python would find."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("RANS_TRUST", "")
    monkeypatch.setattr("rans.base.registry._typed", set())
    Path("evil.py").write_text(MODULE)
    return tmp_path


def call(ask: Callable[[], object]) -> None:
    """Ask, and see that no code of a file has run, whatever came out."""
    os.environ["RANS_TRUST"] = ""  # the one before may have been asked to trust
    try:
        ask()
    except RansError:
        pass
    finally:
        assert not Path("ran").exists()
        assert "evil" not in sys.modules


def command(words: str) -> Callable[[], object]:
    return lambda: main(words.split())


def test_the_module_would_run_if_it_were_typed(here):
    """The traps of this file can close."""
    with pytest.raises(rans.ConfigError, match="a task must be a dataclass"):
        rans.load_task(EVIL)
    assert Path("ran").exists()
    del sys.modules["evil"]


TINY = {"units": 4, "states": 16, "rounds": 1, "updates": 1, "batch": 16}
EVERYTHING = replace(CONFIG, algorithm="value", learner=TINY, total_timesteps=1)
"""A training that uses everything which a config can name; texts that are read as they are begin it each time."""

RUN = [
    command("train --resume run"),
    command("train run/config.json --output out"),
    lambda: rans.load_agent("run"),
]
MORE = [
    command("evaluate run --episodes 2"),
    command("compare run --with lqr --episodes 2 --certified 0"),
    command("view run --save page.html"),
    command("stress run --only latency --episodes 2"),
    command("assure run --episodes 2"),
    command("follow run"),
    command("export run --output shipped --force"),
    command("fly run --bus udp --seconds 0.1"),
    command("report run"),
]


BASE = json.loads(json.dumps(to_table(EVERYTHING))) | {"about": {"command": "rans train"}}
EVERYWHERE = ".task", ".algorithm"
"""Texts of a config that name code for whoever reads it; those of `NAMING` also for a training."""
NAMING = (*EVERYWHERE, ".spacecraft", ".begin_from")


def ask_of_run(trained: Path, changed: Any, asks: list[Callable[[], object]]) -> None:
    """Ask with a run folder of the changed config."""
    for ask in asks:
        for folder in ("run", "runs", "out", "shipped"):
            shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(trained, "run")
        write_json(Path("run/config.json"), changed)
        shutil.copytree("run", "runs/run")
        call(ask)


def test_names_in_the_config_of_a_run(here, trained):
    named = {where: changed for where, changed in texts(BASE) if where in NAMING}
    assert len(named) == len(NAMING)
    for where, changed in named.items():
        ask_of_run(trained, changed, [*RUN, *(MORE if where in EVERYWHERE else ())])


@pytest.mark.slow
def test_every_text_in_the_config_of_a_run(here, trained):
    others = [*RUN[2:], *MORE, command("evaluate value:go-to-pose-2d#0.5 --episodes 2")]
    for number, (_, changed) in enumerate(texts(BASE)):
        ask_of_run(trained, changed, [*RUN[:2], others[number % len(others)]])


RECIPE = {
    "base": "base-precise",
    "task": "go-to-pose",
    "spacecraft": "floating-platform",
    "conditions": "lab",
    "algorithm": "value",
    "begin_from": "pretrained:go-to-pose-2d",
    "learner": {"units": 32},
    "gpu": {"device": "cpu"},
}


def test_recipe(here):
    for _, changed in texts(copy.deepcopy(RECIPE)):
        Path("recipe.toml").write_text(toml(changed))
        call(command("train recipe.toml --set total_timesteps=1 --set ppo.n_envs=1 --output out"))
        call(lambda: rans.train("recipe.toml", total_timesteps=1, n_envs=1, output="out"))
        shutil.rmtree("out", ignore_errors=True)


def test_spacecraft_and_conditions(here):
    craft = read_toml(
        Path(rans.__file__)
        .with_name("data")
        .joinpath("spacecraft/floating-platform.toml")
        .read_text()
    )
    craft["effector"] = [{"kind": "torquer"}]
    for _, changed in texts(craft):
        Path("craft.toml").write_text(toml(changed))
        call(command("list craft.toml"))
        call(lambda: rans.load_spacecraft("craft.toml"))
        call(lambda: rans.Engine("craft.toml", "go-to-pose", 1))
    for _, changed in texts(
        {"base": "lab", "description": "a laboratory", "others": [{"base": "lab"}]}
    ):
        Path("world.toml").write_text(toml(changed))
        call(command("list world.toml"))
        call(lambda: rans.load_conditions("world.toml"))


@pytest.mark.slow
def test_contract_of_an_export(here, trained):
    write_export(trained, Path("shipped"), "onnx", episodes=0)
    Path("shipped/agent.py").write_text("import evil\n")
    for where, changed in texts(json.loads(Path("shipped/contract.json").read_text())):
        write_json(Path("shipped/contract.json"), changed)
        call(lambda: rans.load_agent("shipped"))
        if where == ".task":  # no other text of a contract is a name
            call(command("evaluate shipped --episodes 2"))
            call(command("fly shipped --bus udp --seconds 0.1"))


def test_results(here):
    card = {"training": "x", "agent": "y"}
    for name, table in (contents() | {"card.json": card}).items():
        for _, changed in texts(table):
            shutil.rmtree("results", ignore_errors=True)
            write_json(Path("results") / name, changed)
            call(command("report results"))


def test_tuned_settings(here):
    table = json.loads(TUNED.read_text())
    setup = Setup(rans.load_spacecraft("floating-platform"), rans.GoToPose(), rans.Timing())
    for _, changed in texts(table):
        write_json(Path("lqr.json"), changed)
        call(lambda: Tuned.read(Path("lqr.json")).fits("lqr", setup))


def test_plan_of_a_bag(here, trained):
    pytest.importorskip("mcap")
    bags = pytest.importorskip("rans_robot.bag")
    messages = pytest.importorskip("rans_robot.messages")
    replay_bag = pytest.importorskip("rans_robot.node").replay_bag
    settings = json.loads(json.dumps(to_table(CONFIG)))["settings"]
    plan = {
        "folder": "shipped",
        "task": {"name": "go-to-pose", "settings": settings},
        "robot": "ros",
    }
    for where, changed in texts(plan):
        Path("flight.mcap").unlink(missing_ok=True)
        writer = bags.BagWriter(Path("flight.mcap"))
        packed = messages.text_message(json.dumps(changed))
        writer.write(bags.BagMessage(1, "rans/flight", messages.TEXT, packed))
        writer.close()
        call(lambda: replay_bag(Path("flight.mcap")))
        call(command("replay flight.mcap"))
        if where == ".task.name":  # trust of one's own agent is none of what a bag names
            call(command("replay flight.mcap mine --trust"))
