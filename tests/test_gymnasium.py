"""What Gymnasium's own tests of environments ask of every registered one; its wheel does not carry those tests."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest

import rans

BOXES = ["rans/Land3D-v0", "rans/Land3D-Drake-v0"]
"""Environments of continuous actions."""
CONTINUOUS = pytest.mark.skipif(
    BOXES[0] not in gymnasium.registry, reason="landings are a package, which is not installed"
)
COPIED = ["rans/GoToPose2D-v0", "rans/GoToPose2D-Drake-v0", "rans/GoToPose3D-Drake-v0"]


def copies(environment: Any) -> list[Any]:
    return [pickle.loads(pickle.dumps(environment)), copy.deepcopy(environment)]


@pytest.mark.parametrize("name", COPIED)
@pytest.mark.parametrize("conditions", [None, "lab"])
def test_copies_fly_on_as_the_environment_does(name, conditions):
    """Made before an episode, and in the middle of one."""
    environment = gymnasium.make(name, conditions=conditions)
    assert environment.action_space == copies(environment)[0].action_space
    environment.reset(seed=3)
    actions = np.random.default_rng(0).integers(0, 2, (12, environment.action_space.shape[0]))  # type: ignore[index]
    for action in actions[:6]:
        environment.step(action)
    both = copies(environment)
    for action in actions[6:]:
        expected = environment.step(action)
        for one in both:
            observation, reward, *_ = one.step(action)
            np.testing.assert_array_equal(observation, expected[0])
            assert reward == expected[1]


def length(batch: Any) -> int:
    """Steps until a batch's first episodes are truncated, with all thrusters shut."""
    batch.reset(seed=0)
    actions = np.zeros(batch.action_space.shape, np.int64)
    for step in range(1, 1000):
        *_, truncated, _ = batch.step(actions)
        if np.asarray(truncated).all():
            return step
    return 0


@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
@pytest.mark.parametrize(("limit", "own", "expected"), [(7, 125, 7), (50, 9, 9)])
def test_the_shorter_of_two_limits_ends_episodes(mode, limit, own, expected):
    made = gymnasium.make_vec
    batch = made(
        "rans/GoToPose2D-v0",
        num_envs=2,
        vectorization_mode=mode,
        max_episode_steps=limit,
        timing=rans.Timing(episode_steps=own),
    )
    assert length(batch) == expected
