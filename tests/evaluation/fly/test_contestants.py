from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rans.base.pretrained
from rans import ConfigError, GoToPose, MultiTask, RansWarning, TrackVelocity
from rans.episode.scenario import scenarios
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import (
    contestant,
    judged_separately,
    view_command,
)
from rans.evaluation.fly.protocols import fitting_protocols
from rans.fast.agent_files.agent import actor_bytes, read_policy
from rans.model.spacecraft_file import load_spacecraft, to_toml
from tests.support.training import CONFIG, tiny_trainer


def untrained(path: Path, **changes: object) -> Path:
    """A run folder with an agent that has learnt nothing yet."""
    trainer = tiny_trainer(path, replace(CONFIG, **changes))  # type: ignore[arg-type]
    trainer.save()
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return untrained(tmp_path_factory.mktemp("runs") / "poser")


@pytest.fixture(scope="module")
def multi(tmp_path_factory) -> Path:
    tasks = MultiTask(tasks=("go-to-position", "track-velocity"))
    return untrained(tmp_path_factory.mktemp("runs") / "all", task="multi-task", settings=tasks)


def test_a_policy_of_others_is_told_its_period_on_the_craft_of_a_file(tmp_path):
    """A craft of a file that turns quickly is commanded every 0.1 s, in environments of its task every 0.2 s."""
    (tmp_path / "mine.toml").write_text(to_toml(load_spacecraft("floating-platform")))
    named = "python:tests.support.policies:idle:go-to-pose-2d@"
    with pytest.warns(RansWarning, match=r"flown every 0\.1 s.* environments .* 0\.2 s"):
        found = contestant(f"{named}{tmp_path}/mine.toml")
    assert found.timing.control_period == 0.1
    assert contestant(f"{named}{tmp_path}/mine.toml", period=0.3).timing.control_period == 0.3
    assert contestant(f"{named}floating-platform").timing.control_period == 0.2


def test_an_agent_that_comes_with_rans(run, monkeypatch):
    saved = read_policy(run / "agent.safetensors").network
    shipped = actor_bytes(saved.architecture, saved.weights(), 0)
    (run / "agent.safetensors").write_bytes(shipped)
    monkeypatch.setattr(rans.base.pretrained, "FOLDER", run.parent)
    assert contestant("pretrained:poser").controller.name == "poser"
    assert ContestantName.parse("pretrained:poser").output_folder == Path(
        "runs/evaluations/pretrained-poser"
    )
    with pytest.raises(ConfigError, match=r"comes with RANS \(did you mean poser\?\)"):
        contestant("pretrained:posr")


def test_an_agent_by_its_bare_name_where_no_folder_has_it(here):
    assert contestant("go-to-pose-2d").controller.name == "go-to-pose-2d"
    assert ContestantName.parse("go-to-pose-2d").output_folder == Path(
        "runs/evaluations/pretrained-go-to-pose-2d"
    )
    (here / "go-to-pose-2d").mkdir()
    with pytest.raises(ConfigError, match="go-to-pose-2d is not a run folder"):
        contestant("go-to-pose-2d")


def test_results_stay_inside_their_folder():
    """And apart: files that differ in their folder only have one each."""
    places = [
        ContestantName.parse(f"lqr:go-to-pose-2d@{file}").output_folder
        for file in ("../own craft.toml", "a/own.toml", "a-own.toml", "own.toml")
    ]
    assert {place.parent for place in places} == {Path("runs/evaluations")}
    assert len({place.name for place in places}) == 4
    assert (
        ContestantName.parse("lqr:go-to-pose-2d@atmos").output_folder.name
        == "lqr-go-to-pose-2d-atmos"
    )


@pytest.mark.parametrize(
    ("spec", "spacecraft"),
    [
        ("lqr:go-to-pose", "floating-platform"),
        ("lqr:go-to-pose@free-flyer", "free-flyer"),
        ("mission:dock", "afrl-deputy"),
        ("mission:dock-3d", "afrl-deputy"),
        ("rans.control.lqr:LQR:go-to-pose", "floating-platform"),
    ],
)
def test_the_number_of_dimensions_may_be_left_out(spec, spacecraft):
    assert contestant(spec).craft.name == spacecraft


def test_the_command_that_shows_a_flight_says_whose_code_it_runs():
    class Mine(GoToPose):
        """From outside of RANS."""

    assert (
        view_command(["runs/a b"], GoToPose(), None, 3, 7)
        == "rans view 'runs/a b' --episode 3 --seed 7"
    )
    assert (
        view_command(["x", "y"], Mine(), "lab", 0, 1)
        == "rans view x y --conditions lab --episode 0 --seed 1 --trust"
    )


def test_protocols(run):
    """Section 4.1 of the paper, and the original system's shared supply."""
    for protocol, sharing in (("paper", "none"), ("original", "split")):
        _, craft, task, timing, _ = contestant(str(run), protocol)[:5]  # type: ignore[arg-type]
        starts = scenarios(task.for_evaluation(), craft, 1, 200).start
        distance = np.hypot(starts.p.x, starts.p.y)  # type: ignore[union-attr]
        assert (craft.mass, len(craft.thrusters), craft.thrust_sharing) == (5.32, 8, sharing)
        assert (timing.episode_steps, timing.control_period) == (250, 0.2)
        assert 3.0 <= distance.min() < 3.05 < 3.95 < distance.max() <= 4.0
        assert sorted(fitting_protocols(craft)) == sorted(["own", protocol])
    with pytest.raises(
        ConfigError, match="--protocol paper is for planar spacecraft with 8 thrusters"
    ):
        contestant("lqr:go-to-pose-3d", "paper")


def test_a_multi_task_agent_is_judged_on_each_of_its_tasks(multi):
    parts = [f"{multi}#go-to-position", f"{multi}#track-velocity"]
    assert [*map(str, judged_separately(str(multi)))] == parts
    picked = contestant(f"{multi}#track-velocity", "paper")
    assert (picked.task, picked.timing.episode_steps) == (TrackVelocity(), 250)
    assert ContestantName.parse(f"{multi}#track-velocity").output_folder == multi
    with pytest.raises(ConfigError, match="picks 'go-to-pose', but its tasks are go-to-position, "):
        contestant(f"{multi}#go-to-pose")


def test_the_network_of_a_contestant_is_that_of_an_agent():
    """So that no caller guesses what the controller is."""
    run = contestant("pretrained:go-to-pose-2d")
    assert run.network.architecture.thrusters == run.craft.command_count
    with pytest.raises(ConfigError, match="LQR has no network of RANS"):
        _ = contestant("lqr:go-to-pose-2d").network
