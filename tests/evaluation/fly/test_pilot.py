"""Controllers in Gymnasium environments: the same flight as `rans.episode.flight.fly`, in five lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest

from rans import ConfigError, Pilot
from rans.base.pretrained import pretrained_folder
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.make_controller import controller

CONTROLLERS_OF_POSES = sorted(
    set(filter(CONTROLLERS.comes_with_rans, CONTROLLERS))
    - {
        "circumnavigation",
        "convex",
        "corridor",
        "mission",
        "passive",
    }
)


@pytest.mark.parametrize(("number", "name"), [*enumerate(CONTROLLERS_OF_POSES)])
def test_flies_as_in_a_batch(number, name):
    """By turns in our environment and in Drake's."""
    env_id = ("rans/GoToPose3D-v0", "rans/GoToPose2D-Drake-v0")[number % 2]
    env = gymnasium.make(env_id, disable_env_checker=False)
    pilot: Any = Pilot(name, env)
    observation, _ = env.reset(seed=7)
    commands = []
    for _ in range(8):
        action = pilot.act(observation)
        assert env.action_space.contains(action)
        observation, *_ = env.step(action)
        commands.append(action)
    inner: Any = env.unwrapped
    setup = Setup(inner.craft, inner.task, inner.timing)
    flight = fly(
        *setup[:2],
        controller(name, setup),
        scenarios(inner.task, inner.craft, 7, 1),
        replace(inner.timing, episode_steps=8),
    )
    assert np.array_equal(commands, flight.commands[:, 0])


def test_arrives_and_flies_again():
    """The loop of docs/python.md; the second episode is flown as by a pilot who never flew before."""
    env = gymnasium.make("rans/GoToPose2D-v0")
    pilot = Pilot("lqr", env)
    flown = []
    for _ in range(2):
        observation, info = env.reset(seed=3)
        pilot.reset()
        done = False
        while not done:
            observation, _, terminated, truncated, info = env.step(pilot.act(observation))
            done = terminated or truncated
        assert info["at_goal"]
        flown.append(info["errors"])
    assert flown[0] == flown[1]


def test_an_agent_flies_what_it_was_made_for():
    agent = load_policy(pretrained_folder("go-to-pose-2d"))
    env = gymnasium.make("rans/GoToPose2D-v0")
    pilot = Pilot(agent, env)
    observation, info = env.reset(seed=3)
    for _ in range(125):
        observation, *_, info = env.step(pilot.act(observation))
    assert info["at_goal"]
    for other in ("rans/GoToPose3D-v0", "rans/GoToXY-v0"):
        with pytest.raises(ConfigError, match="make the environment of its task"):
            Pilot(agent, gymnasium.make(other))
