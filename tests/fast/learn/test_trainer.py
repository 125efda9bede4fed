"""Trainings of a few iterations: what they write, when they end, and what they refuse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rans import GoToPose, Timing
from rans.base.errors import ConfigError, NonFiniteState
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.make_controller import guard_of
from rans.fast.agent_files.tensors import pack_tensors, unpack_tensors
from rans.fast.learn.config import (
    MemorySettings,
    PPOSettings,
)
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.fast.stepping.compiled import ArrayStep
from rans.randomization.conditions_file import load_conditions
from tests.support.engines import PLATFORM, SHORT
from tests.support.training import (
    CONFIG,
    EASY,
    TINY,
    after,
    everything,
    ignore,
    resumed,
    tiny_trainer,
)


def test_same_config_same_bits(tmp_path):
    results = []
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        trainer = tiny_trainer(tmp_path / name, replace(CONFIG, seed=seed, total_timesteps=384))
        trainer.train(ignore)
        results.append(everything(trainer))
    assert results[0] == results[1]
    assert results[0] != results[2]


def test_what_a_run_holds(tmp_path):
    rows = []
    trainer = tiny_trainer(tmp_path / "run", replace(CONFIG, report_interval=8))
    trainer.train(rows.append)
    assert rows == trainer.run.metrics()
    assert [row["steps"] for row in rows] == [1024, 2048]
    assert rows[0]["seconds"] < rows[1]["seconds"] == pytest.approx(trainer.seconds, abs=1e-3)
    rate = 1024 / (rows[1]["seconds"] - rows[0]["seconds"])
    assert rows[1]["steps_per_s"] == pytest.approx(
        rate, rel=0.1
    )  # seconds are rounded to milliseconds
    for key in (
        "success",
        "duty",
        "error/position",
        "error/attitude",
        "return/position",
        "return/thrust",
        "train/loss",
        "rollout/at_goal_rate",
    ):
        assert np.isfinite(rows[1][key]), key
    names = {file.name for file in (tmp_path / "run").iterdir()}
    assert names == {
        "config.json",
        "spacecraft.toml",
        "metrics.jsonl",
        "checkpoint.safetensors",
        "agent.safetensors",
        "tensorboard",
        ".lock",
    }
    assert len(list((tmp_path / "run" / "tensorboard").iterdir())) == 1


def test_solved_twice_in_a_row(tmp_path, monkeypatch):
    """One lucky report does not end a training; nor does a stop between reports make two of one.

    A solved training goes on where its config says so.
    """
    config = replace(CONFIG, report_interval=2, solved_share=0.9, total_timesteps=10_000)
    found = iter([0.95, 0.2, 0.9, 0.91, 0.99, 0.99])
    trainer = tiny_trainer(tmp_path / "run", config)
    monkeypatch.setattr(trainer.selection, "judge", lambda: {"success": next(found), "duty": 0.5})
    trainer.train(ignore, after(7))  # reports at iterations 2, 4, 6, and at 7 because of the stop
    assert [row["success"] for row in trainer.run.metrics()] == [0.95, 0.2, 0.9, 0.91]
    assert not trainer.solved
    again = resumed(tmp_path / "run")
    monkeypatch.setattr(again.selection, "judge", lambda: {"success": next(found), "duty": 0.5})
    again.train(ignore)
    assert again.solved
    assert again.steps == 8 * 128
    file = tmp_path / "run/config.json"
    file.write_text(
        file.read_text()
        .replace('"solved_share": 0.9', '"solved_share": null')
        .replace('"total_timesteps": 10000', '"total_timesteps": 1280')
    )
    longer = resumed(tmp_path / "run")
    longer.train(ignore)
    assert not longer.solved
    assert longer.steps == 10 * 128


def test_episodes_to_learn_in_may_be_shorter_than_those_to_be_judged_in(tmp_path):
    """Nobody fails, so that each of 16 begins anew four times in 20 steps, whenever its first one ends."""
    config = replace(CONFIG, settings=EASY, episode_steps=5, ppo=replace(TINY, n_steps=4))
    trainer = tiny_trainer(tmp_path / "run", config)
    ends = torch.stack([trainer.engine.step(torch.zeros(16, 8)).truncated for _ in range(20)]).sum(
        dim=0
    )
    assert ends.tolist() == [4] * 16
    trainer.train(ignore)
    assert load_policy(tmp_path / "run").judged.timing == SHORT


def test_it_learns(tmp_path):
    """From 3 to 4 m away to the goal: five seeds were within 0.05 to 0.10 m after so many steps."""
    config = replace(
        CONFIG, ppo=PPOSettings(), timing=Timing(), total_timesteps=114_688, report_interval=14
    )
    rows = []
    tiny_trainer(tmp_path / "run", config).train(rows.append)
    assert rows[-1]["error/position"] < 0.6


def test_nothing_is_written_for_a_config_that_cannot_work(tmp_path):
    run = RunFolder(tmp_path / "run")
    config = replace(CONFIG, ppo=replace(TINY, n_steps=21, batch_size=21 * 16))
    with pytest.raises(ConfigError, match="n_steps must not exceed the episode's 20 steps"):
        Trainer(config, tiny_trainer(tmp_path / "good").run.spacecraft(), run)
    assert not run.path.exists()


def test_a_critic_that_knows_what_conditions_draw_is_judged_without(tmp_path):
    """Whoever judges or flies the agent knows less: it is told of what is usual, which is zero for each."""
    ppo = replace(TINY, privileged_critic=True, memory=MemorySettings(4), symmetric=False)
    trainer = tiny_trainer(tmp_path, replace(CONFIG, ppo=ppo, conditions=load_conditions("faults")))
    trainer.train(ignore)
    given = trainer.learner.network.architecture
    assert given.nominal == (0.0,) * given.privileged
    assert (
        given.privileged == trainer.engine.privileged().shape[1] > 16
    )  # begins, and gains, and leaks
    assert load_policy(tmp_path).conditions is not None


def test_a_training_that_is_compiled_on_its_way_goes_on(tmp_path, monkeypatch):
    """With the same reports and agent; on a CPU nothing is compiled, but it is divided in two as on a GPU."""
    plain, divided = (tiny_trainer(tmp_path / name) for name in ("plain", "divided"))
    plain.train(ignore)
    warm_ups = []
    monkeypatch.setattr(divided, "_warm_up", lambda: warm_ups.append(divided.steps))
    monkeypatch.setattr(divided, "_compiling_pays", lambda: divided.steps >= 640)
    divided.train(ignore)
    assert warm_ups == [0, 640]
    assert everything(divided) == everything(plain)


GUARDED = replace(CONFIG, guard=True)


class Shut:
    """Lets nothing through."""

    def admitted(self, world: Any, state: Any, goal: Any, command: Any) -> Any:
        """All thrusters shut."""
        return tuple(one * 0.0 for one in command), command[0] >= 0.0


def trained_behind(guard: Any, folder: Path) -> tuple[Trainer, list[dict[str, Any]]]:
    """A short training, and its rows of metrics."""
    run = RunFolder(folder)
    run.begin(GUARDED, "test")
    trainer = Trainer(GUARDED, PLATFORM, run, guard=guard)
    rows: list[dict[str, Any]] = []
    trainer.train(rows.append)
    return trainer, rows


def test_nothing_moves_where_nothing_is_let_through(tmp_path):
    """Episodes begin at rest, and there is no disturbance."""
    trainer, rows = trained_behind(Shut(), tmp_path / "shut")
    assert rows[-1]["success"] == 0.0
    engine = trainer.engine
    engine.reset()
    before = {name: error.clone() for name, error in engine.errors().items()}
    assert before["position"].min() > 0.0
    for _ in range(3):
        engine.step(torch.ones(engine.num_envs, len(PLATFORM.commands)))
    for name, error in engine.errors().items():
        assert torch.equal(error, before[name]), name


def test_what_cannot_be(tmp_path):
    with pytest.raises(ConfigError, match="needs a safety filter"):
        tiny_trainer(tmp_path / "none", GUARDED)
    with pytest.raises(ConfigError, match="has none"):
        guard_of(GUARDED, PLATFORM)
    assert guard_of(CONFIG, PLATFORM) is None


@pytest.mark.filterwarnings(
    "ignore:this engine steps slower"
)  # for a reward that no program is made of
@pytest.mark.parametrize("what", ["weight", "state", "reward"])
def test_nan_stops_it(tmp_path, what, monkeypatch):
    trainer = tiny_trainer(tmp_path / "run")
    trainer.train(ignore, after(2))
    before = trainer.run.checkpoint_file.read_bytes()
    if what == "weight":
        with torch.no_grad():
            trainer.learner.network.tensors["value_net.weight"][0, 0] = float("nan")
    elif what == "state":
        trainer.engine.state.p.x[3] = float("nan")
    else:
        trainer.engine._step = ArrayStep()  # with the reward that follows
        monkeypatch.setattr(
            GoToPose, "reward", lambda *_: {"position": np.full(16, np.nan, np.float32)}
        )
    sentence = r"not finite after 384 steps .* State and weights are in .*nonfinite\.safetensors"
    with pytest.raises(NonFiniteState, match=sentence):
        trainer.train(ignore)
    dump = unpack_tensors((tmp_path / "run" / "nonfinite.safetensors").read_bytes(), "dump")
    assert dump["steps"] == 384
    assert trainer.run.checkpoint_file.read_bytes() == before


def test_a_checkpoint_of_another_config(tmp_path):
    tiny_trainer(tmp_path / "run").train(ignore, after(1))
    table = json.loads((tmp_path / "run" / "config.json").read_text())
    for key, value, message in (
        ("layers", [8, 8], r"its network is another one \(layers \(16, 16\)"),
        ("n_envs", 32, "saved state is not one of 32"),
        ("symmetric", False, "its network is another one .*symmetric True"),
    ):
        changed = table | {"ppo": table["ppo"] | {key: value}}
        (tmp_path / "run" / "config.json").write_text(json.dumps(changed))
        with pytest.raises(ConfigError, match=message) as caught:
            resumed(tmp_path / "run")
        assert "\n" not in str(caught.value)


def test_a_checkpoint_of_something_else(tmp_path):
    """What is damaged has a test of its own (`tests.test_damaged_files`)."""
    trainer = tiny_trainer(tmp_path / "run")
    trainer.train(ignore, after(1))
    trainer.run.checkpoint_file.write_bytes(pack_tensors([1, 2, 3]))
    with pytest.raises(ConfigError, match=r"checkpoint\.safetensors does not fit") as caught:
        resumed(tmp_path / "run")
    assert "\n" not in str(caught.value)
