"""Learning from an expert: its commands are met, trainings resume, and others begin from what was learnt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rans_missions.tasks import Dock

from rans.errors import ConfigError
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.fast.agent_files.agent import read_policy
from rans.fast.learn.config import ExplorationSettings, MemorySettings, TrainConfig
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.spacecraft_file import load_spacecraft
from tests.support import plugins
from tests.support.training import CONFIG, TINY, after, ignore, resumed, tiny_trainer

plugins.register()

DEPUTY = load_spacecraft("afrl-deputy")
TASK = Dock()


@CONTROLLERS.register("damping")
class Damping:
    """Pushes against the velocity, with no thrust at all below 0.1 m/s along an axis."""

    name = "damping"

    def __init__(self, craft: Any = None, task: Any = None, timing: Any = None) -> None:
        pass

    def reset(self, count: int) -> None:
        """Nothing is remembered."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """A tenth of the speed along every axis, as a share of full thrust."""
        v = np.stack([state.v.x, state.v.y, state.v.z], axis=1)
        wanted = np.where(np.abs(v) > 0.1, -v, 0.0)
        both = np.stack([np.maximum(wanted, 0.0), np.maximum(-wanted, 0.0)], axis=2)
        return both.reshape(len(v), 6)


def config(**changes: Any) -> TrainConfig:
    """A small training."""
    base = TrainConfig(
        "dock",
        TASK,
        "afrl-deputy",
        # A twelfth of the task's episode, which judgements of the agent fly to its end.
        timing=replace(TASK.timing, episode_steps=20),
        algorithm="imitation",
        learner={"expert": "damping", "updates": 150, "roll_in": 0.5},
        total_timesteps=3 * 64 * 10,
        report_interval=1,
        solved_share=None,
    )
    ppo = replace(
        base.ppo,
        n_envs=64,
        n_steps=10,
        batch_size=320,
        learning_rate=3e-3,
        head="gated",
        symmetric=False,
        exploration=ExplorationSettings(log_std_init=-2.0),
    )
    return replace(base, ppo=ppo, **changes)


def trained(folder: Path, given: TrainConfig) -> Trainer:
    """A training to its end."""
    run = RunFolder(folder)
    trainer = Trainer([given], DEPUTY, run)
    run.begin(given, "test")
    trainer.train(lambda _: None)
    return trainer


@pytest.mark.slow
def test_an_expert_is_met_and_others_begin_from_the_agent(tmp_path: Path) -> None:
    trainer = trained(tmp_path / "one", config(report_interval=3))
    learner = trainer.learner
    engine = trainer.engine
    engine.reset()
    state = engine.state
    wanted = Damping().act(state, engine.goal, np.zeros(0))
    with torch.no_grad():
        given = learner.network.forward(engine.observe())[0].policy.mode().numpy()
    # Shut thrusters alone would miss by the whole mean, untrained ones by more; 1,920 labels leave half of it.
    assert np.abs(given - wanted).mean() < 0.75 * wanted.mean()
    assert (given == 0.0).mean() > 0.5
    # Another training begins with the same weights, and keeps what inputs are normalised by.
    first = read_policy(tmp_path / "one" / "agent.safetensors").network
    begun = config(
        begin_from=str(tmp_path / "one"), algorithm="ppo", learner={}, total_timesteps=64 * 10
    )
    other = Trainer([begun], DEPUTY, RunFolder(tmp_path / "two"))
    for name, tensor in other.learner.network.tensors.items():
        if not name.endswith("count"):
            torch.testing.assert_close(tensor, first.tensors[name], rtol=0, atol=0)
    mean = other.learner.network.tensors["features_extractor.mean"].clone()
    other.learner.learn()
    torch.testing.assert_close(other.learner.network.tensors["features_extractor.mean"], mean)


def test_it_resumes_bit_by_bit(tmp_path: Path) -> None:
    learner = {"expert": "lqr", "updates": 10, "roll_in": 0.5}
    count = TINY.n_envs * TINY.n_steps
    short = replace(
        CONFIG,
        spacecraft="astrobee-granite",
        algorithm="imitation",
        learner=learner,
        total_timesteps=2 * count,
    )
    whole = tiny_trainer(tmp_path / "whole", short)
    whole.train(ignore)
    half = tiny_trainer(tmp_path / "half", short)
    half.train(ignore, after(1))
    assert half.steps == count
    again = resumed(tmp_path / "half")
    again.train(ignore)
    assert again.steps == whole.steps
    for name, tensor in whole.learner.network.tensors.items():
        assert torch.equal(tensor, again.learner.network.tensors[name])


def test_what_cannot_work_is_refused(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    with pytest.raises(ConfigError, match="no controller named 'nobody'"):
        Trainer([config(learner={"expert": "nobody"})], DEPUTY, run)
    remembering = replace(config(), ppo=replace(config().ppo, memory=MemorySettings("history")))
    with pytest.raises(ConfigError, match="does not support memory"):
        Trainer([remembering], DEPUTY, run)
    with pytest.raises(ConfigError, match="has no agent"):
        Trainer([config(begin_from=str(tmp_path), algorithm="ppo", learner={})], DEPUTY, run)
    with pytest.raises(ConfigError, match="did you mean pretrained:land-3d"):
        Trainer([config(begin_from="land-3d", algorithm="ppo", learner={})], DEPUTY, run)
    begun = config(begin_from="pretrained:land-3d", algorithm="ppo", learner={})
    with pytest.raises(ConfigError, match=r"something else .* \S+land-3d/config\.json. has"):
        Trainer([begun], DEPUTY, run)
