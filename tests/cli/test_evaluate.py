from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rans.cli import main
from rans.evaluation.fly import choice, episodes
from rans.evaluation.fly.choice import Choice, Rival
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant


@pytest.fixture
def run_folder(trained, tmp_path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(trained, tmp_path / "run"))


@pytest.mark.usefixtures("undrawn")
def test_both_engines(capsys, run_folder):
    """Drake's evaluation leaves what the first one wrote."""
    (run_folder / "evaluation-drake.json").write_text("damaged")
    for engine, stem in (("fast", "evaluation"), ("drake", "evaluation-drake")):
        assert main(f"evaluate {run_folder} --episodes 3 --engine {engine}".split()) == 0
        text = capsys.readouterr().out.replace("\n", "")
        assert str(run_folder / f"{stem}.html") in text
        assert (run_folder / f"{stem}.html").is_file()
        written = json.loads((run_folder / f"{stem}.json").read_text())
        assert written.keys() == {engine, "conditions", "seed", "about"}
    assert "<svg" in (run_folder / "evaluation.svg").read_text()


@pytest.mark.usefixtures("undrawn")
def test_an_interrupt_keeps_the_episodes_before_it(monkeypatch, here, ran):
    monkeypatch.setattr("rans.base.processes.processors", lambda: 1)
    monkeypatch.setattr("rans.evaluation.fly.episodes._SHARE", 1)
    flies = episodes._Flyer.fly

    def fly(self, seed, first, count):
        if first == 2:
            raise KeyboardInterrupt
        return flies(self, seed, first, count)

    monkeypatch.setattr(episodes._Flyer, "fly", fly)
    text = ran("evaluate lqr:go-to-pose-2d --engine drake --episodes 3", code=130)
    assert "LQR: 2 episodes" in text
    written = here / "runs/evaluations/lqr-go-to-pose-2d/evaluation-drake.json"
    assert json.loads(written.read_text())["conditions"]["episodes"] == 2


def test_flights_too_many_to_keep_are_refused(ran):
    assert "rans assure judges more" in ran("evaluate go-to-pose-2d --episodes 65537", code=2)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_conditions_of_one_name_have_files_apart(run_folder, tmp_path, capsys):
    """Those that come with RANS, users' files of the same name in two folders, and one called own."""
    for name in ("a/lab", "b/lab", "own"):
        file = tmp_path / f"{name}.toml"
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"[body]\nmass = {1.0 + len(name) / 10 + (name[0] == 'b') / 10}\n")
    own = [str(tmp_path / f"{name}.toml") for name in ("a/lab", "b/lab", "own")]
    for given in ("lab", *own):
        assert main(f"evaluate {run_folder} --episodes 2 --conditions {given}".split()) == 0
        following = capsys.readouterr().out.split("Next:\n")[1].split("  rans ")[1:]
        # What is proposed next flies under the same conditions.
        assert [f"--conditions {given}" in command for command in following] == [True] * 3
    assert main(f"evaluate {run_folder} --episodes 2".split()) == 0
    written = sorted(file.name for file in run_folder.glob("evaluation*.json"))
    assert len(written) == 5
    assert {"evaluation.json", "evaluation-lab.json"} <= set(written)
    assert len(list(run_folder.glob("episodes*.npz"))) == 5


@pytest.mark.usefixtures("here", "undrawn")
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("guard", [[], ["--guard"]])
def test_behind_the_filter_no_controller_is_said_to_violate_constraints(guard, ran):
    said = ran("evaluate lqr:avoid-2d --episodes 1", *guard)
    assert ("constraints of Avoid" in said) is not bool(guard)


@pytest.fixture
def tried(monkeypatch) -> Callable[..., None]:
    """A function that sets what flights of any craft and of LQR beside it give, in place of flights."""

    def set_to(solved: int, lqr: float) -> None:
        rival = Rival("lqr", lqr, 6.0, 20.0) if lqr else None
        found = Choice(0.3, 0.2, 256, solved, 6.0, 17.0, rival=rival)
        monkeypatch.setattr(choice, "chosen", lambda *_: found)

    return set_to


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("any-craft-2d#1,0.1mm@atmos", "rans list atmos"),
        ("any-craft-2d@atmos", "rans list atmos"),
        ("lqr:go-to-pose-2d@atmos", "rans list atmos"),
        ("go-to-pose-2d", "rans view go-to-pose-2d"),
    ],
)
def test_lost_flights_lead_to_a_command_that_may_help(text, command, tried):
    """Nobody who was tried solves 5 % more."""
    tried(200, 0.8)
    name = ContestantName.parse(text)
    run = contestant("lqr:go-to-pose-2d@atmos")
    assert name.shortfall(94.0, run).endswith(command)
    assert name.shortfall(95.0, run) == ""


@pytest.mark.parametrize("text", ["any-craft-2d#1@atmos", "switching:go-to-pose-2d@atmos"])
@pytest.mark.parametrize("conditions", [None, "faults"])
@pytest.mark.parametrize(
    ("solved", "lqr", "who"),
    [
        (256, 0.0, "rans evaluate 'any-craft-2d#0.3@atmos'"),
        (150, 0.9, "rans evaluate lqr:go-to-pose-2d@atmos"),
        (150, 0.6, ""),
    ],
)
def test_who_solves_more_is_named_after_flights(text, conditions, solved, lqr, who, tried):
    """In conditions that nobody copes with a training is the next step."""
    tried(solved, lqr)
    run = contestant("lqr:go-to-pose-2d@atmos")
    found = ContestantName.parse(text).shortfall(60.0, run, conditions).partition("Next: ")[2]
    under = f" --conditions {conditions}" if conditions else ""
    alone = "rans train go-to-pose --spacecraft atmos --conditions faults --quality good"
    assert found == (f"{who}{under}" if who else alone if conditions else "rans list atmos")


@pytest.mark.filterwarnings("ignore:LQR does not know")
@pytest.mark.parametrize("options", [[], ["--guard"]])
def test_flights_through_a_zone_lead_to_the_filter_and_to_no_cause_of_poses(options):
    name = ContestantName.parse("lqr:avoid-2d")
    said = name.shortfall(12.5, contestant("lqr:avoid-2d"), None, options)
    assert "cause" not in said
    assert said.endswith(
        "rans train avoid --spacecraft floating-platform --quality good"
        if options
        else "rans evaluate lqr:avoid-2d --guard"
    )


@pytest.mark.usefixtures("here", "undrawn")
@pytest.mark.parametrize(
    "options",
    [
        ["evaluate", "--episodes", "4"],
        ["export", "--episodes", "4", "--output", "out", "--format", "numpy", "--force"],
        ["report"],
    ],
    ids=lambda options: options[0],
)
def test_what_judges_a_flight_says_why_flights_are_lost(options, run_folder, ran):
    said = ran(options[0], str(run_folder), *options[1:])
    assert f"Next: rans view {run_folder}" in said


@pytest.mark.usefixtures("here", "undrawn")
@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("evaluate lqr:go-to-pose-2d --episodes 2", "evaluation.json"),
        ("follow lqr:track-velocity-2d --episodes 1", "evaluation-circle.json"),
        ("optimal go-to-pose --episodes 1", "optimal.json"),
        ("optimal land --episodes 1", "optimal.json"),
        ("validate --quick --layer thrusters --output out", "validation.json"),
    ],
)
def test_results_are_written_before_they_are_printed(line, file, monkeypatch, capsys):
    """As with ``> /dev/full``, where they cannot be."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("rans.base.terminal.Terminal.table", full)
    assert main(line.split()) == 2
    assert "the disk is full" in capsys.readouterr().err
    assert [*Path().rglob(file)]
