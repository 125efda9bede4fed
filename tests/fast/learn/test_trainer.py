from __future__ import annotations

import contextlib
import os
import random
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rans.errors import ConfigError
from rans.evaluation.fly.agent import load_agent
from rans.fast.distributed import Processes
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.ppo import STATISTICS
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer, check_device, run_path
from rans.flight import fly
from rans.model.conditions_file import load_conditions
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.fast.engines import SHORT
from tests.fast.training import CONFIG, TINY, after, ignore, newest, resumed, tiny_trainer, weights
from tests.processes import python

ROOT = Path(__file__).parents[2]
EASY = GoToPose(spawn_distance=(0.5, 1.0), evaluation_distance=(0.5, 1.0), position_tolerance=9.0,
                attitude_tolerance=4.0)
"""Solved by whoever does not fail."""
WHOLE = replace(CONFIG, report_interval=4)


def everything(trainer: Trainer) -> list[Any]:
    """All that decides how a training goes on, in comparable form."""
    saved = trainer._checkpoint()
    learner = saved["learner"]
    flat = [saved["steps"], [state.tolist() for state in learner["generators"]], saved["engine"]["seed"]]
    flat += [buffer.tolist() for buffer in saved["engine"]["buffers"]]
    flat += [] if learner["memory"] is None else [learner["memory"].tolist()]
    return [*flat, weights(trainer.learner.network).tolist(), repr(learner["adam"])]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Trainer:
    """A training that nobody stopped, with a report every four iterations."""
    trainer = tiny_trainer(tmp_path_factory.mktemp("whole") / "run", WHOLE)
    trainer.train(ignore)
    return trainer


def test_same_config_same_bits(tmp_path: Path) -> None:
    results = []
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        trainer = tiny_trainer(tmp_path / name, replace(CONFIG, seed=seed, total_timesteps=384))
        trainer.train(ignore)
        results.append(everything(trainer))
    assert results[0] == results[1]
    assert results[0] != results[2]


TRAIN = """
import sys, torch
from pathlib import Path
from rans.fast.learn.run_folder import RunFolder, read_config
from rans.fast.learn.trainer import Trainer
torch.set_num_threads(1)
run = RunFolder(Path(sys.argv[1]))
trainer = Trainer([run.config()], run.spacecraft(), run)
trainer.resume()
trainer.train(lambda members: print(members[0].rows[-1]["steps"], flush=True))
"""
"""A training in another process."""


def run_script(script: str, path: Path) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    return python("-c", script, str(path), cwd=ROOT)


@pytest.mark.parametrize("stop_at", [5, 8])
def test_a_resumed_training_ends_as_if_never_stopped(whole: Trainer, tmp_path: Path, stop_at: int) -> None:
    """Stopped between reports or at one; the same reports are made but for the one at the stop."""
    tiny_trainer(tmp_path / "cut", WHOLE).train(ignore, after(stop_at))
    trainer = resumed(tmp_path / "cut")
    assert trainer.steps == stop_at * 128
    torch.manual_seed(99)  # what happens between stop and resume is of no account
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    reports = [row["steps"] for row in whole.run.metrics()]
    assert reports == [512, 1024, 1536, 2048]
    assert [row["steps"] for row in trainer.run.metrics()] == sorted({*reports, stop_at * 128})
    for ours, theirs in zip(trainer.run.metrics(), whole.run.metrics(), strict=False):
        if ours["steps"] == theirs["steps"] > stop_at * 128:
            assert ours["success"] == theirs["success"]
            assert ours["train/loss"] == theirs["train/loss"]


def test_rows_after_the_checkpoint_are_taken_again(tmp_path: Path) -> None:
    """Killed between checkpoints: later rows are dropped, also a row that was only half written."""
    config = replace(CONFIG, report_interval=2)
    trainer = tiny_trainer(tmp_path / "run", config)
    trainer.train(ignore, after(4))
    checkpoint = trainer.run.checkpoint_file.read_bytes()
    trainer.train(ignore, after(5))
    trainer.run.checkpoint_file.write_bytes(checkpoint)
    with trainer.run.metrics_file.open("a") as file:
        file.write('{"steps": 99999, "succ')
    again = resumed(tmp_path / "run")
    assert [row["steps"] for row in again.run.metrics()] == [256, 512]
    again.train(ignore)
    assert [row["steps"] for row in again.run.metrics()] == list(range(256, 2049, 256))


def test_killed_at_any_moment(tmp_path: Path) -> None:
    """SIGKILL, with a checkpoint after every iteration; another process ends it as if nothing was."""
    config = replace(CONFIG, total_timesteps=60 * 128, report_interval=2)
    whole = tiny_trainer(tmp_path / "whole", config)
    whole.train(ignore)
    script = TRAIN.replace("torch.set_num_threads", "import rans.fast.learn.trainer as t; "
                           "t._CHECKPOINT_SECONDS = 0; torch.set_num_threads")
    RunFolder(tmp_path / "cut").begin(config, "rans train")
    moments = random.Random(3)
    for kill in (True, False):
        with run_script(script, tmp_path / "cut") as process:
            if kill:
                assert process.stdout is not None
                process.stdout.readline()
                time.sleep(moments.uniform(0, 0.05))
                process.kill()
            _, errors = process.communicate()
        assert kill or process.returncode == 0, errors
    assert everything(resumed(tmp_path / "cut")) == everything(whole)
    steps = [row["steps"] for row in RunFolder(tmp_path / "cut").metrics()]
    assert steps == [row["steps"] for row in whole.run.metrics()]


def test_without_a_checkpoint_it_starts_over(whole: Trainer, tmp_path: Path) -> None:
    RunFolder(tmp_path / "cut").begin(WHOLE, "rans train")
    RunFolder(tmp_path / "cut").append_metrics({"steps": 128, "seconds": 0.1, "success": 0.0})
    trainer = resumed(tmp_path / "cut")
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    assert [row["steps"] for row in trainer.run.metrics()] == [512, 1024, 1536, 2048]


def test_what_a_run_holds(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = []
    trainer = tiny_trainer(tmp_path / "run", replace(CONFIG, report_interval=8))
    trainer.train(newest(rows))
    assert rows == trainer.run.metrics()
    assert [row["steps"] for row in rows] == [1024, 2048]
    assert rows[0]["seconds"] < rows[1]["seconds"] == pytest.approx(trainer.seconds, abs=1e-3)
    rate = 1024 / (rows[1]["seconds"] - rows[0]["seconds"])
    assert rows[1]["steps_per_s"] == pytest.approx(rate, rel=0.1)  # seconds are rounded to milliseconds
    for key in ("success", "duty", "error/position", "error/attitude", "return/position", "return/thrust",
                "train/loss", "rollout/success_rate"):
        assert np.isfinite(rows[1][key]), key
    names = {file.name for file in (tmp_path / "run").iterdir()}
    assert names == {"config.json", "spacecraft.toml", "metrics.jsonl", "checkpoint.safetensors",
                     "policy.zip", "tensorboard"}
    assert len(list((tmp_path / "run" / "tensorboard").iterdir())) == 1


def test_solved_twice_in_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One lucky report does not end a training; nor does a stop between reports make two of one."""
    config = replace(CONFIG, report_interval=2, solved_share=0.9, total_timesteps=10_000)
    found = iter([0.95, 0.2, 0.9, 0.91, 0.99, 0.99])
    trainer = tiny_trainer(tmp_path / "run", config)
    monkeypatch.setattr(trainer.selection, "judge", lambda: [{"success": next(found), "duty": 0.5}])
    trainer.train(ignore, after(7))  # reports at iterations 2, 4, 6, and at 7 because of the stop
    assert [row["success"] for row in trainer.run.metrics()] == [0.95, 0.2, 0.9, 0.91]
    assert not trainer.solved
    again = resumed(tmp_path / "run")
    monkeypatch.setattr(again.selection, "judge", lambda: [{"success": next(found), "duty": 0.5}])
    again.train(ignore)
    assert again.solved
    assert again.steps == 8 * 128


def test_the_bound_of_the_step_size_falls_towards_the_end(tmp_path: Path) -> None:
    """The trainer slows down: in the last of sixteen iterations a sixteenth of the way is left."""
    ppo = replace(TINY, desired_kl=1e6, learning_rate=1e-3, max_learning_rate=1e-3, anneal=1.0)
    rows: list[dict[str, Any]] = []
    tiny_trainer(tmp_path / "run", replace(CONFIG, ppo=ppo, report_interval=1)).train(newest(rows))
    rates = [row["train/learning_rate"] for row in rows]
    # Every update wants longer steps, so the bound is what is taken.
    assert rates == pytest.approx([1e-3 * (16 - n) / 16 for n in range(16)], rel=1e-6)


def test_thrusters_open_at_first_as_often_as_the_config_says(tmp_path: Path) -> None:
    """Judged by the deterministic agent, which opens what is likelier open than shut: none, and all."""
    for duty, expected in ((0.01, 0.0), (0.99, 1.0)):
        trainer = tiny_trainer(tmp_path / str(duty), replace(CONFIG, ppo=replace(TINY, initial_duty=duty)))
        assert trainer.selection.judge()[0]["duty"] == pytest.approx(expected, abs=1e-6)
        trainer.learner.collect()
        # 1,024 throws: within five standard deviations of their mean.
        assert float(trainer.learner.rollout.all.action.mean()) == pytest.approx(duty, abs=0.016)


@pytest.mark.parametrize("old", [False, True], ids=["pickled code", "old"])
def test_checkpoints_that_are_not_opened(tmp_path: Path, old: bool) -> None:
    """Nothing in a file is run; what an older version wrote is refused with the reason."""
    trainer = tiny_trainer(tmp_path / "run")
    trainer.train(ignore, after(1))
    trainer.run.checkpoint_file.unlink()
    file, ran = tmp_path / "run" / "checkpoint.pt", tmp_path / "ran"
    if old:
        torch.save({"policy": {}, "network": "", "optimizer": {}, "steps": 128}, file)
    else:
        torch.save({"learner": Code(str(ran))}, file)
    sentence = ("written by an older RANS, .* begin anew with --config" if old else
                r"checkpoint\.pt holds code that would run posix\.mkdir")
    with pytest.raises(ConfigError, match=sentence):
        resumed(tmp_path / "run")
    assert not ran.exists()


def test_a_run_of_before_goes_on_bit_by_bit(whole: Trainer, tmp_path: Path) -> None:
    """With the checkpoint as torch saves it, which gives way to ours."""
    tiny_trainer(tmp_path / "cut", WHOLE).train(ignore, after(3))
    run = RunFolder(tmp_path / "cut")
    torch.save(run.load_checkpoint("cpu"), tmp_path / "cut" / "checkpoint.pt")
    run.checkpoint_file.unlink()
    trainer = resumed(tmp_path / "cut")
    assert trainer.steps == 3 * 128
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    assert not (tmp_path / "cut" / "checkpoint.pt").exists()


class Code:
    """What makes a file when it is unpickled."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (self.path,)


@pytest.mark.parametrize("kind", [{"memory": "history", "history": 2},
                                  {"memory": "recurrent", "privileged_critic": True}],
                         ids=["history", "recurrent and privileged"])
def test_what_remembers_resumes_bit_by_bit_too(tmp_path: Path, kind: dict[str, Any]) -> None:
    config = replace(CONFIG, ppo=replace(TINY, symmetric=False, **kind), total_timesteps=768)
    whole = tiny_trainer(tmp_path / "whole", config)
    whole.train(ignore)
    tiny_trainer(tmp_path / "cut", config).train(ignore, after(3))
    trainer = resumed(tmp_path / "cut")
    trainer.train(ignore)
    assert everything(trainer) == everything(whole)
    agent, craft, task, timing, _ = load_agent(tmp_path / "cut")
    starts = scenarios(task.for_evaluation(), craft, 1, 8)
    flights = [fly(craft, task, agent, starts, timing) for _ in range(2)]
    np.testing.assert_array_equal(flights[0].commands, flights[1].commands)  # it forgets in between


def test_a_finished_training_is_left_alone(tmp_path: Path) -> None:
    config = replace(CONFIG, settings=EASY, solved_share=1.0, report_interval=1)
    trainer = tiny_trainer(tmp_path / "run", config)
    trainer.train(ignore)
    assert trainer.solved
    assert trainer.steps == 2 * 128
    again = resumed(tmp_path / "run")
    again.train(lambda _: pytest.fail("it trained on"))
    assert again.solved
    assert everything(again) == everything(trainer)


def test_a_warm_up_that_takes_all_steps_is_reported(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where few steps are wanted of a GPU, which compiles and records in the first iterations."""
    trainer = tiny_trainer(tmp_path / "run", replace(CONFIG, total_timesteps=384))
    monkeypatch.setattr(trainer, "_warm_up", lambda: [trainer._iterate() for _ in range(3)])
    trainer.train(ignore)
    assert [row["steps"] for row in trainer.run.metrics()] == [384]


def test_an_agent_without_a_checkpoint_is_not_lost(tmp_path: Path) -> None:
    """A sweep leaves such a one; to resume would begin anew and write over it."""
    tiny_trainer(tmp_path / "run").train(ignore)
    (tmp_path / "run" / "checkpoint.safetensors").unlink()
    with pytest.raises(ConfigError, match=r"agent without a checkpoint .* anew with --config .*config\.json"):
        resumed(tmp_path / "run")
    assert len(RunFolder(tmp_path / "run").metrics()) == 1


def test_episodes_to_learn_in_may_be_shorter_than_those_to_be_judged_in(tmp_path: Path) -> None:
    """Nobody fails, so that each of 16 begins anew four times in 20 steps, whenever its first one ends."""
    config = replace(CONFIG, settings=EASY, episode_steps=5, ppo=replace(TINY, n_steps=4))
    trainer = tiny_trainer(tmp_path / "run", config)
    ends = torch.stack([trainer.engine.step(torch.zeros(16, 8)).truncated for _ in range(20)]).sum(dim=0)
    assert ends.tolist() == [4] * 16
    trainer.train(ignore)
    assert load_agent(tmp_path / "run").judged.timing == SHORT


def test_it_learns(tmp_path: Path) -> None:
    """From 3 to 4 m away to the goal: five seeds were within 0.01 to 0.20 m after so many steps.

    The attitude is no measure: one of the five had not found it yet.
    """
    config = replace(CONFIG, ppo=PPOSettings(), timing=Timing(), total_timesteps=230_000, report_interval=28)
    rows: list[dict[str, Any]] = []
    tiny_trainer(tmp_path / "run", config).train(newest(rows))
    assert rows[-1]["error/position"] < 0.6


def test_devices() -> None:
    check_device("cpu")
    for wrong in ("tpu", "gpu", "", "meta", "cuda:1"):
        with pytest.raises(ConfigError, match="device must be cpu or cuda, got"):
            check_device(wrong)
    if not torch.cuda.is_available():
        with pytest.raises(ConfigError, match="torch sees no CUDA device"):
            check_device("cuda")


def test_nothing_is_written_for_a_config_that_cannot_work(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    config = replace(CONFIG, ppo=replace(TINY, n_steps=21, batch_size=21 * 16))
    with pytest.raises(ConfigError, match="n_steps must not exceed the episode's 20 steps"):
        Trainer([config], tiny_trainer(tmp_path / "good").run.spacecraft(), run)
    assert not run.path.exists()


def test_new_folders(tmp_path: Path) -> None:
    config = replace(CONFIG, spacecraft=str(tmp_path / "mine.toml"), seed=7)
    first = run_path(config, tmp_path)
    assert first == tmp_path / "go-to-pose-mine-seed7"
    first.mkdir()
    assert run_path(config, tmp_path).name == "go-to-pose-mine-seed7-2"


def test_steps_are_those_of_all_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of two has half of the environments, and counts the flight of both."""
    run = RunFolder(tmp_path / "run")
    trainer = Trainer([CONFIG], tiny_trainer(tmp_path / "whole").run.spacecraft(), run, Processes(0, 2))
    assert trainer.engine.num_envs == 8
    said = torch.zeros(1, len(STATISTICS) + 4 + len(trainer.engine.term_names))
    monkeypatch.setattr(trainer.learner, "collect", lambda: None)
    monkeypatch.setattr(trainer.learner, "update", lambda: said)
    trainer._iterate()
    assert trainer.steps == 128


def test_a_critic_that_knows_what_conditions_draw_is_judged_without(tmp_path: Path) -> None:
    """Whoever judges or flies the agent knows less: it is told of what is usual, which is zero for each."""
    ppo = replace(TINY, privileged_critic=True, memory="history", symmetric=False)
    trainer = tiny_trainer(tmp_path, replace(CONFIG, ppo=ppo, conditions=load_conditions("faults")))
    trainer.train(ignore)
    given = trainer.learner.network.architecture
    assert given.nominal == (0.0,) * given.privileged
    assert given.privileged == trainer.engine.privileged().shape[1] > 16  # begins, and gains, and leaks
    assert load_agent(tmp_path).conditions is not None
