"""What people type from habit is answered by what it is called here."""

from dataclasses import replace
from pathlib import Path

import pytest

import rans
from rans import Conditions, ThrusterConditions, cli
from rans.base.errors import ConfigError, checked, meant, meant_file
from rans.cli import main
from rans.cli.train import command_to_train_on
from rans.fast.learn.config import training
from rans.fast.learn.trainer import SOLVED_IN_A_ROW, is_solved


@pytest.mark.parametrize(
    ("typed", "answer"),
    [
        ("train go-to-pose --out runs/x", "--output"),
        ("assure x --below 1e-3", "--failure-below"),
        ("play runs/x", "commands are train, "),
        ("evaluate x --episods 9", "--episodes"),
        ("export x --onnx", "Unrecognized options: --onnx"),
        ("train go-to-pose --quality god", "Expected one of"),
        ("train go-to-pose dock", "no place for 'dock': train takes"),
        ("evaluat runs/x", "did you mean evaluate?"),
        ("--train", "did you mean train?"),
        ("train --resume . --total-timesteps many", "1e6"),
        ("assure x --failure-below 0.1%", "Did you mean 0.001?"),
    ],
)
def test_leads_to_what_it_is_called_here(typed, answer, capsys):
    try:
        code = main(typed.split())
    except SystemExit as error:  # of tyro, for values that are no numbers
        code = error.code
    printed = capsys.readouterr()
    assert code == 2
    assert answer in " ".join((printed.err + printed.out).split())


def test_a_solved_task_is_trained_on():
    """Its last reports end a training, unless the number of steps alone does."""
    config = replace(training("go-to-pose", None, "cpu"), solved_share=0.9, report_interval=1)
    bad, good = (
        {
            "success": share,
            "train/learning_rate": 1e-3,
            "steps": config.ppo.n_envs * config.ppo.n_steps,
        }
        for share in (0.1, 0.95)
    )
    assert is_solved(config, [bad, *[good] * SOLVED_IN_A_ROW])
    assert not is_solved(config, [*[good] * SOLVED_IN_A_ROW, bad])
    assert not is_solved(replace(config, solved_share=None), [good] * SOLVED_IN_A_ROW)
    # A report between those at the interval, as of a stop, does not count; an imitation has one report.
    assert not is_solved(replace(config, report_interval=2), [good] * SOLVED_IN_A_ROW)
    assert is_solved(config, [{"success": 0.95, "steps": 1}])
    assert "--total-timesteps 400000" in command_to_train_on(Path("runs/x"), 204_800)


KNOWN = ["go-to-pose-3d-robust", "go-to-pose-2d", "go-to-pose-3d", "go-to-posed", "lqr", "dock"]


@pytest.mark.parametrize(
    ("word", "near"),
    [
        ("GoToPose2D", "go-to-pose-2d"),
        ("rans/LQR-v0", "lqr"),
        ("GoToPos2D", "go-to-pose-2d"),
        ("rans/GoToPse2D-v0", "go-to-pose-2d"),
        ("go-to-pose", "go-to-pose-2d or go-to-pose-3d or go-to-pose-3d-robust"),
        ("go-to-pose-2", "go-to-pose-2d"),
        ("lrq", "lqr"),
        ("nothing", ""),
        ("rocket", ""),
    ],
)
def test_the_name_that_was_meant(word, near):
    assert meant(word, KNOWN) == (f" (did you mean {near}?)" if near else "")


def test_a_file_that_is_near(tmp_path):
    for name in ("slider6.toml", "flight.csv"):
        (tmp_path / name).touch()
    assert meant_file(tmp_path / "slider6") == f" (did you mean {tmp_path / 'slider6.toml'}?)"
    assert meant_file(tmp_path / "slidr6") == f" (did you mean {tmp_path / 'slider6.toml'}?)"
    assert meant_file(tmp_path / "flights.csv") == f" (did you mean {tmp_path / 'flight.csv'}?)"
    assert meant_file(tmp_path / "slider6.tml") == f" (did you mean {tmp_path / 'slider6.toml'}?)"
    assert meant_file(tmp_path / "flights.toml") == ""
    assert meant_file(tmp_path / "flight.csv") == ""  # which is there, and not what was asked for
    assert meant_file(tmp_path / "nowhere" / "x") == ""


def test_a_dict_in_place_of_an_object_is_written_as_one():
    with pytest.raises(ConfigError) as refused:
        checked("conditions", {"latency": 0.03}, Conditions)
    call = str(refused.value).partition(": ")[2].rstrip(".")
    assert eval(call, {"rans": rans}) == Conditions(thrusters=ThrusterConditions(latency=0.03))


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        ("go-to-pose --output begun", "begun holds a training already"),
        ("--resume empty", "empty is not a run folder: it has no config.json"),
    ],
)
def test_a_training_is_refused_before_anything_is_prepared(typed, sentence, here, monkeypatch):
    """The engine took five seconds of a processor, after which the folder was looked at."""
    (here / "begun").mkdir()
    (here / "begun/config.json").write_text("{}")
    (here / "empty").mkdir()
    (here / "mine.toml").write_text("")

    def prepared(*_):
        pytest.fail("it is prepared before it is refused")

    monkeypatch.setattr("rans.fast.device.open_ahead", prepared)
    with pytest.raises(ConfigError, match=sentence):
        cli._parse(["train", *typed.split()]).run()
