"""Kalman filters on what is observed, against the engine's motion, SciPy's covariances and a filter in W."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from campaigns.robustness import rows
from rans import TASKS, ConfigError, GoToPose
from rans.episode.step import Setup, World
from rans.tasks.base import observation
from rans.tasks.derived import layout
from rans.tasks.observation_terms import Scalar, VectorInW
from tests.support.crafts import random_states
from tests.support.engines import FLYER, PLATFORM, both_crafts
from tests.support.filter_flights import COUNT, TIMING, commands, followed, in_body, made

FOLLOWED = [
    "go-to-pose",
    "go-to-position",
    "track-velocity",
    "track-twist",
    "track-velocity-heading",
]


@pytest.mark.parametrize(
    ("name", "drift", "response", "craft"),
    [
        (name, *kind)
        for number, name in enumerate(FOLLOWED)  # two kinds each, by turns
        for kind in [
            (1e-3, 0.0, PLATFORM),
            (1e-3, 1.0, FLYER),
            (10.0, 0.0, FLYER),
            (10.0, 0.1, PLATFORM),
        ][2 * (number % 2) :][:2]
    ],
    ids=lambda x: getattr(x, "name", str(x)),
)
def test_what_is_expected_is_what_is_seen_next(drift, response, name, craft):
    """In a perfect world, whose motion is the engine's; turning by up to 0.3 rad in a period."""
    task = TASKS[name]()
    body = layout(task, craft.dimension).body
    filters = made(craft, task, drift, response)
    given = itertools.islice(commands(craft, 0.015), 30)
    fastest = 0.0
    for k, (now, read, memory) in enumerate(
        followed(World(Setup(craft, task, TIMING)), filters, given)
    ):
        if k:
            expected = np.array(memory[: body.width])
            # Turning is kept to first order within a period: of the 0.06 m/s that a pulse gives, and of 5 m
            # to go at 1.5 rad/s, a few millimetres.
            np.testing.assert_allclose(
                expected, np.broadcast_to(read, expected.shape), rtol=0, atol=8e-3
            )
        fastest = max(fastest, *(np.abs(w).max() for w in now.state.spin()))
    assert 0.9 < fastest < 1.6


@both_crafts
def test_a_force_and_a_torque_are_found(craft):
    """Of up to 0.3 N and 0.1 N m, steady in W and about the centre of mass, after 12 s of exact readings."""
    task = GoToPose()
    for name in ("force", "torque"):
        body = layout(task, craft.dimension).body
        filters = made(craft, task, 0.01, 1e-6)  # thrusters as designed
        world = World(Setup(craft, task, TIMING, rows()[name]))
        given = itertools.islice(commands(craft, 0.0), 61)
        *_, (before, read, memory), (now, *_) = followed(world, filters, given)
        told = filters.estimate(body, read, memory)[body.width : -4]
        gained = now.state.v - before.state.v  # in a period, in W
        force = in_body(craft, task, observation(task, replace(now.state, v=gained), now.goal))
        axes = craft.dimension
        spins = len(filters.twist[0])
        turned = np.subtract(now.state.spin(), before.state.spin())
        units = np.abs(filters.push).max(), np.abs(filters.twist).max()
        right = [*(force[k] / units[0] for k in range(axes)), *(turned / units[1])]
        strongest = np.abs(right).max()
        assert strongest > 0.1
        # Exact but for the turn of B in a period, which a torque makes longer and longer.
        np.testing.assert_allclose(told, right, rtol=0, atol=0.02 * strongest)
        assert len(told) == axes + spins


@pytest.mark.parametrize(("drift", "response"), [(1e-3, 0.0), (0.1, 3.0)])
def test_no_reading_makes_it_lose_its_numbers(drift, response):
    """Not even of rotations that are none, without responses: quaternions of interfaces are made of unit length."""
    task = GoToPose()
    random = np.random.default_rng(3)
    body = layout(task, 3).body
    filters = made(FLYER, task, drift, response)
    memory = [np.zeros(COUNT)] * filters.width(body)
    for command in (next(commands(FLYER, 0.5, seed)) for seed in range(200)):
        read = list(random.normal(0.0, 10.0, (body.width, COUNT)))
        if response:
            states = (
                random_states(3, COUNT, k, 20.0, 20.0, 20.0) for k in random.integers(99, size=2)
            )
            read = in_body(FLYER, task, observation(task, *states))
        memory = filters.next_memory(body, read, memory, command)
        assert np.isfinite(memory).all()
        assert np.abs(memory).max() < 1e4  # readings of up to some 40 are never added up


class Windy(GoToPose):
    """Shows a number that grows with the place, and a vector that nothing changes."""

    def observation_terms(self, state: Any, goal: Any) -> Any:
        return (*super().observation_terms(state, goal), self.more(state))

    def more(self, state: Any) -> Any:
        return Scalar("gust", "-", state.p.x * 2.0)


class Constant(Windy):
    def more(self, state: Any) -> Any:
        return VectorInW("wind", "m/s", type(state.p)(*(x * 0.0 + 0.5 for x in state.p.columns())))


class Curved(Windy):
    def more(self, state: Any) -> Any:
        return VectorInW("there", "-", state.p.scale(state.v.dot(state.v) + state.p.dot(state.p)))


def test_what_a_filter_cannot_follow_is_told():
    for task, name in (
        (Windy(), "gust"),
        (Curved(), "there"),
        (TASKS["multi-task"](), "task data"),
    ):
        with pytest.raises(ConfigError, match=f"filters cannot follow the observed '{name}'"):
            made(PLATFORM, task, 1.0)
    assert made(PLATFORM, Constant(), 1.0).sensitivities[5] == (0.0, 0.0, 0.0)
