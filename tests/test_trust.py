"""Whose code runs: a file that names MODULE:NAME is not enough, somebody must vouch for it."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import rans
from rans import TASKS, ConfigError, GoToPose, trust_files
from rans.base.files import write_json
from rans.cli import _parse, main
from rans.evaluation.fly.agent import load_policy
from rans.fast.learn.run_folder import RunFolder
from rans.model.spacecraft_file import SPACECRAFT
from tests.support.processes import printed
from tests.support.training import CONFIG

MODULE = """
from pathlib import Path
from rans.tasks import GoToPose as Task
from rans.model.spacecraft_file import load_spacecraft
Path("ran").write_text("")
craft = load_spacecraft("floating-platform")
"""


@pytest.fixture
def run(trained, tmp_path, monkeypatch) -> Iterator[Path]:
    """A run folder and a config of a stranger, whose module lies beside them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("RANS_TRUST", "")
    monkeypatch.setattr("rans.base.registry._typed", set())
    for registry in (TASKS, SPACECRAFT):
        monkeypatch.setattr(registry, "_loaded", {})
    Path("strangers.py").write_text(MODULE)
    folder = Path(shutil.copytree(trained, "run"))
    table = json.loads((folder / "config.json").read_text()) | {"task": "strangers:Task"}
    write_json(folder / "config.json", table)
    write_json(Path("craft.json"), table | {"task": "go-to-pose", "spacecraft": "strangers:craft"})
    yield folder
    sys.modules.pop("strangers", None)


COMMANDS = [
    "evaluate run --episodes 2",
    "compare run --with lqr",
    "view run --save page.html",
    "stress run",
    "assure run --episodes 2",
    "follow run",
    "export run --output out --force",
    "train --resume run",
    "train run/config.json",
    "train craft.json",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_runs_nobodys_module(run, command, ran):
    text = ran(command, code=2)
    assert "to use it would run that module's code" in text
    assert "add --trust" in text
    assert not Path("ran").exists()


def test_with_trust_it_does(run):
    assert main(["train", "--resume", "run", "--trust"]) == 0
    assert Path("ran").exists()


@pytest.mark.parametrize("command", COMMANDS)
def test_every_such_command_can_be_told_to(command):
    _parse([*command.split(), "--trust"])


def test_a_module_that_is_loaded_is_not_thereby_trusted(run):
    """Somebody else may have loaded it, as torch is by every training."""
    __import__("strangers")
    with pytest.raises(ConfigError, match=r"from Python, call rans\.trust_files\(\) first"):
        load_policy(run)
    rans.trust_files()
    assert type(load_policy(run).task).__name__ == "GoToPose"


WRITTEN = Path("called")


def write() -> None:
    """What no file may call."""
    WRITTEN.write_text("")


@pytest.mark.parametrize(
    "reference",
    [
        "torch:builtins.breakpoint",
        "torch:os.abort",
        "rans.base.errors:sys.exit",
        "rans.base.registry:trust_files",
        f"{__name__}:write",
    ],
)
@pytest.mark.parametrize("entry", ["task", "spacecraft"])
def test_a_file_calls_nothing_of_modules_that_are_loaded(run, reference, entry, ran):
    table = json.loads((run / "config.json").read_text()) | {"task": "go-to-pose", entry: reference}
    write_json(Path("odd.json"), table)
    assert f"names the {entry} {reference!r}" in ran("train odd.json", code=2)
    assert not WRITTEN.exists()
    assert not os.environ["RANS_TRUST"]


@dataclass(frozen=True)
class Own(GoToPose):
    """Of the program that runs."""


def test_what_a_program_trained_itself_it_may_open(run):
    """It gave the class, so nothing runs that does not run anyway; other names stay refused."""
    agent = rans.train(
        Own(),
        device="cpu",
        total_timesteps=CONFIG.ppo.n_envs * CONFIG.ppo.n_steps,
        ppo=CONFIG.ppo,
        output="own",
    )
    assert type(agent.task) is Own
    assert type(rans.load_agent("own").task) is Own
    with pytest.raises(ConfigError, match="would run that module's code"):
        rans.load_agent("run")


@pytest.mark.slow
def test_trust_is_known_to_processes_that_are_started(run):
    trust_files()
    assert RunFolder(run).config().task == "strangers:Task"
    code = (
        "from pathlib import Path\nfrom rans.fast.learn.run_folder import RunFolder\n"
        "print(RunFolder(Path('run')).config().task)"
    )
    assert printed("-c", code, cwd=Path()) == "strangers:Task\n"


@pytest.mark.usefixtures("undrawn")
def test_a_typed_name_needs_no_trust_but_its_run_folder_does(run, capsys, monkeypatch):
    command = (
        "train strangers:Task --spacecraft strangers:craft --device cpu --output mine "
        "--set total_timesteps=64 --set ppo.n_envs=8 --set ppo.n_steps=4 --set ppo.batch_size=16 "
        "--set timing.episode_steps=10"
    )
    assert main([str(word) for word in command.split()]) == 0
    assert Path("mine/agent.safetensors").exists()
    # The next process has no typed name: the proposed commands must say it.
    evaluate = capsys.readouterr().out.split("Next:\n")[1].splitlines()[0]
    monkeypatch.setattr("rans.base.registry._typed", set())
    assert main([*evaluate.split()[1:], "--episodes", "2"]) == 0
    proposed = capsys.readouterr().out.split("Next:\n")[1].splitlines()
    assert ["--trust" in line.split() for line in proposed] == [True] * 3
