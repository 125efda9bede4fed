"""Who takes part, under whose conditions, and what is said of what they cost."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from rans import ConfigError, GoToPose, Timing
from rans.episode.scenario import EVALUATION_SEED
from rans.evaluation.compare import entrants
from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.entrants import contest_of, enlist, simple_controller
from rans.evaluation.fly import contestant_name

IDLE = "python:tests.support.policies:idle"


@pytest.fixture(scope="module")
def contest() -> Contest:
    return contest_of("lqr:go-to-pose-2d", 2)


def tuning(text: str) -> str:
    return entrants._tuning(contestant_name.ContestantName.parse(text))


def test_conditions_of_the_first():
    """The task with the starts that agents are judged on, an episode of 25 s at 5 Hz."""
    found = contest_of("lqr:go-to-pose-2d", 3, 11, "drake")
    assert (found.episodes, found.seed, found.engine) == (3, 11, "drake")
    assert found.task == GoToPose().for_evaluation()
    assert (found.craft.name, found.duration) == ("floating-platform", 25.0)
    assert found.title() == "3 starts of seed 11, floating-platform, 25 s at 5 Hz"
    usual = contest_of("lqr:go-to-pose-2d", 1)
    assert (usual.episodes, usual.seed, usual.engine) == (1, EVALUATION_SEED, "fast")


def test_only_the_same_control_period_is_compared(contest):
    """Other tasks and craft are refused in `tests/evaluation/compare/test_run.py`."""
    quicker = replace(contest, timing=Timing(0.1))
    with pytest.raises(ConfigError, match=r"acts every 0\.2 s, but .* every 0\.1 s"):
        enlist("pretrained:go-to-pose-2d", quicker)
    policy = f"{IDLE}:go-to-pose-2d"
    with pytest.raises(ConfigError, match=r"acts every 0\.2 s, but .* every 0\.1 s"):
        enlist(policy, quicker)
    assert enlist(policy, quicker, period=0.1).knows == "observation"  # the user asks for it


def test_a_craft_of_the_same_name_with_other_values_is_another(contest):
    heavier = replace(contest, craft=replace(contest.craft, mass=2 * contest.craft.mass))
    with pytest.raises(ConfigError, match="or for other values of it"):
        enlist("lqr:go-to-pose-2d", heavier)


def test_what_everybody_knows_and_cost(contest):
    lqr = enlist("lqr:go-to-pose-2d", contest)
    idle = enlist(IDLE, contest)
    assert (lqr.name, lqr.knows) == ("LQR", "state, exact model")
    assert lqr.tuning.startswith("tuned: ")
    default = enlist("rans.control.lqr:LQR:go-to-pose-2d", contest)
    assert default.tuning == "none: default settings"
    assert (idle.knows, idle.tuning) == ("observation", "not known")
    beside = simple_controller("mpc", contest)
    assert (beside.name, beside.knows) == ("MPC", "state, exact model")
    assert beside.tuning.startswith("tuned: ")


def test_the_cost_of_an_agent_is_that_on_its_card(contest, monkeypatch, tmp_path):
    """Also of one of its tasks, as 'NAME#TASK'."""
    card = {"training": {"steps": 26_200_000, "seconds": 0.2549, "device": "cuda:0"}}
    (tmp_path / "card.json").write_text(json.dumps(card))
    monkeypatch.setattr(
        contestant_name,
        "pretrained_folder",
        lambda name: tmp_path if name == "mine" else Path("no"),
    )
    said = "training: 26.2 M steps, 0.255 s on a GPU"
    assert tuning("pretrained:mine") == tuning("pretrained:mine#go-to-pose") == said
    assert tuning(str(tmp_path)) == said
    card["training"]["device"] = "cpu"
    (tmp_path / "card.json").write_text(json.dumps(card))
    assert tuning("pretrained:mine") == "training: 26.2 M steps, 0.255 s on a CPU"
    (tmp_path / "card.json").unlink()
    assert tuning("pretrained:mine") == "not known"


def test_the_cost_of_a_run_is_in_its_last_row(trained, tmp_path):
    run = Path(shutil.copytree(trained, tmp_path / "run"))
    with (run / "metrics.jsonl").open("a") as rows:
        rows.write('{"steps": 3000000, "seconds": 12.0, "success": 0.5}\n')
    assert tuning(str(run)) == "training: 3.0 M steps, 12 s on a CPU"
