"""Trainings of thrusters that take any number from 0 to 1, from the engine to the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rans import ConfigError
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.agent import load_policy
from rans.fast.learn.config import Head
from rans.fast.learn.trainer import Trainer
from rans.model.actuators import Actuators, Pulsed, Throttle
from rans.model.spacecraft_file import to_toml
from rans.reference.flight import fly_in_drake
from tests.support.engines import PLATFORM
from tests.support.training import CONFIG, after, ignore, seen, tiny_trainer


def begun(folder: Path, kind: Actuators, head: Head = "auto") -> Trainer:
    """A training of the platform with these actuators, from a file of the user's."""
    file = folder / "craft.toml"
    file.write_text(to_toml(replace(PLATFORM, name="own", actuators=kind)))
    config = replace(CONFIG, spacecraft=str(file), ppo=replace(CONFIG.ppo, head=head))
    trainer = tiny_trainer(folder / "run", config)
    assert trainer.learner.network.architecture.continuous
    return trainer


@pytest.mark.parametrize(
    "kind",
    [Throttle(), pytest.param(Pulsed(4, 1), marks=pytest.mark.slow)],
    ids=["throttle", "pulsed"],
)
def test_an_agent_is_trained_saved_and_flown(kind, tmp_path):
    trainer = begun(tmp_path, kind)
    trainer.train(ignore)
    assert (
        float(trainer.learner.rollout.all.action.min()) < 0.0
    )  # what is learnt from is not clipped
    loaded = load_policy(tmp_path / "run")
    agent = loaded.controller
    craft = loaded.craft
    task = loaded.task
    timing = loaded.timing
    assert craft.actuators == kind
    observations = seen(craft, 200).numpy()
    commands = agent.act(None, None, observations)
    assert ((commands > 0) & (commands < 1)).mean() > 0.5
    starts = scenarios(task.for_evaluation(), craft, 1, 2)
    ours, drakes = (by(craft, task, agent, starts, timing) for by in (fly, fly_in_drake))
    # Float32 observations of 20 steps that agree to rounding.
    np.testing.assert_allclose(ours.commands, drakes.commands, rtol=0, atol=1e-5)


@pytest.mark.filterwarnings("ignore:.*is not the file of the training")
def test_an_agent_for_other_actuators_is_refused(tmp_path):
    begun(tmp_path, Throttle()).train(ignore, after(1))
    (tmp_path / "run" / "spacecraft.toml").write_text(to_toml(PLATFORM))
    with pytest.raises(
        ConfigError, match=r"does not command the on-off actuators of .* different runs"
    ):
        load_policy(tmp_path / "run")
