"""Flights in Drake against the same flights with our equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from rans import Timing
from rans.episode.scenario import scenarios
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import (
    DrakeEnv,
    DrakeMover,
    fly_in_drake,
    replay,
)
from rans.tasks import GoToPose, gymnasium_ids
from tests.support.crafts import ANY_CRAFT, nasty_planar, nasty_spatial, random_states
from tests.support.random_flights import Random
from validation.study.sampling import Restless, gap

TASK = GoToPose()
CRAFTS = [replace(nasty_planar(), thrust_sharing="split"), nasty_spatial()]
by_name = pytest.mark.parametrize("craft", CRAFTS, ids=lambda craft: craft.name)


@by_name
def test_replay_repeats_a_flight_and_takes_relaxed_thrust(craft):
    timing = Timing(episode_steps=10)
    starts = scenarios(TASK, craft, 9, 4)
    flight = fly_in_drake(craft, TASK, Restless(craft, 3), starts, timing)
    second = map_leaves(lambda x: float(x[2]), starts.start)
    again = replay(craft, second, flight.commands[:, 2], timing)
    track = map_leaves(lambda x: x[:, 2], flight.states)
    assert max(gap(again, track).values()) < 1e-12  # rounding of bodies integrated together
    half = replay(craft, second, flight.commands[:, 2] * 0.5, timing)
    assert gap(half, track)["position"] > 1e-3, (
        "a relaxed command is not taken for an open thruster"
    )


def test_replay_does_not_wrap_the_heading():
    craft = nasty_planar()
    start = map_leaves(lambda x: float(x[0]), replace(random_states(2, 1, 0), w=np.array([3.0])))
    track = replay(craft, start, np.zeros((50, 5)), Timing())
    assert track.attitude.angle[-1] == pytest.approx(start.attitude.angle + 30.0, abs=1e-11)


def test_a_craft_that_hardly_turns_flies_an_orbit_in_long_steps():
    """Its steps of half a second are as good as a fifth of them: both are far below a micrometre."""

    @dataclass(frozen=True)
    class Orbit(GoToPose):
        @property
        def drift(self) -> Drift:
            return ClohessyWiltshire(0.001027)

    craft = load_spacecraft("floating-platform")
    weak = replace(
        craft, thrusters=tuple(replace(one, force=1e-4 * one.force) for one in craft.thrusters)
    )
    starts = scenarios(Orbit(), weak, seed=1, count=2)
    timing = Timing(10.0, 1, 2)
    flown = []
    for max_step in (None, 0.1):
        flight = fly_in_drake(weak, Orbit(), Random(weak), starts, timing, max_step=max_step)
        flown.append(np.stack(leaves(flight.states)))
    np.testing.assert_allclose(flown[0], flown[1], rtol=0, atol=1e-9)
    mover = DrakeMover(weak, timing, Orbit().drift)
    assert mover._step_for(starts.start) == 0.5


# Every task with a craft that the shipped one does not resemble, by turns in the plane and in space.
NASTY = {
    gymnasium_ids(task)[2 + number % 2]: (nasty_planar, nasty_spatial)[number % 2]()
    for number, task in enumerate(ANY_CRAFT)
}


def drake(name: str, **kwargs: Any) -> gymnasium.Env[Any, Any]:
    env = gymnasium.make(name.replace("-v0", "-Drake-v0"), **kwargs).unwrapped
    assert isinstance(env, DrakeEnv)
    return env


@pytest.mark.parametrize("name", NASTY)
def test_gymnasium_and_sb3_find_nothing_wrong(name):
    check_env(drake(name), skip_render_check=True)
    check_env_for_sb3(drake(name))


def flown(env: Any) -> list[Any]:
    random = np.random.default_rng(3)
    results = []
    for seed in (5, None):
        env.reset(seed=seed)
        ended = False
        while not ended:
            action = random.integers(0, 2, env.action_space.shape)
            results.append(env.step(action))
            ended = results[-1][2] or results[-1][3]
    return results
