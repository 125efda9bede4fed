"""Flights in Drake against the same flights with our equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from rans.flight import fly
from rans.model.body import Body
from rans.model.drift import ClohessyWiltshire, Drift
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.reference.flight import (
    DrakeEnv,
    DrakeMover,
    fly_in_drake,
    replay,
)
from rans.scenario import scenarios
from rans.tasks import GoToPose, gymnasium_ids, observation_width
from tests.support.crafts import ANY_CRAFT, nasty_planar, nasty_spatial, random_states
from tests.support.played import Played
from tests.support.random_flights import Random
from validation.study.conditions import Watching
from validation.study.sampling import Restless, gap

TASK = GoToPose()
CRAFTS = [replace(nasty_planar(), thrust_sharing="split"), nasty_spatial()]
by_name = pytest.mark.parametrize("craft", CRAFTS, ids=lambda craft: craft.name)


@by_name
def test_closed_loop_agrees_with_our_equations(craft: Spacecraft) -> None:
    """The same decisions, so the same commands, and states within the accuracy of 64 substeps."""
    timing = Timing(substeps=64, episode_steps=10)
    starts = scenarios(TASK, craft, 5, 2)
    ours = fly(craft, TASK, Restless(craft, 1), starts, timing)
    drake = fly_in_drake(craft, TASK, Restless(craft, 1), starts, timing)
    assert np.array_equal(drake.commands, ours.commands)
    assert 0.05 < ours.commands.mean() < 0.95, "a controller that does something"
    assert max(gap(drake.states, ours.states).values()) < 1e-8  # truncation over 2 s
    assert (drake.engine, drake.controller) == ("drake", "restless")


@dataclass(frozen=True)
class Low(GoToPose):
    """On an orbit so low that a second of it is felt."""

    @property
    def drift(self) -> Drift:
        return ClohessyWiltshire(0.2)


@by_name
def test_other_bodies_on_an_orbit_fly_alike(craft: Spacecraft) -> None:
    """Each spacecraft with a mass and a weak thruster of its own; both matter by centimetres and more."""
    timing = Timing(substeps=16, episode_steps=5)
    starts = scenarios(TASK, craft, 5, 3)
    count = len(craft.thrusters)
    body = replace(
        Body.of(craft),
        mass=np.array([4.0, 7.0, 12.0]),
        gain=(np.array([1.0, 0.3, 0.0]), *(1.0,) * (count - 1)),
    )
    ours = fly(craft, Low(), Restless(craft, 1), starts, timing, body=body)
    drake = fly_in_drake(craft, Low(), Restless(craft, 1), starts, timing, body)
    assert max(gap(drake.states, ours.states).values()) < 1e-8  # truncation over 1 s
    for other in (
        fly_in_drake(craft, TASK, Restless(craft, 1), starts, timing, body),
        fly_in_drake(craft, Low(), Restless(craft, 1), starts, timing),
    ):
        assert max(gap(other.states, ours.states).values()) > 0.01
    commands = drake.commands[:, 0]
    start = map_leaves(lambda x: float(x[0]), starts.start)
    alone = fly(
        craft, Low(), Played(commands[:, None]), map_leaves(lambda x: x[:1], starts), timing
    )
    again = replay(craft, start, commands, timing, Low().drift)
    for told, flown in zip(leaves(again.p), leaves(alone.states.p), strict=True):
        np.testing.assert_allclose(told, flown[:, 0], rtol=0, atol=1e-8)


@by_name
def test_controllers_see_what_the_task_shows(craft: Spacecraft) -> None:
    watching = Watching(craft, 2)
    flight = fly_in_drake(
        craft, TASK, watching, scenarios(TASK, craft, 0, 3), Timing(episode_steps=15)
    )
    assert {x.shape for x in watching.seen} == {(3, observation_width(GoToPose(), craft.dimension))}
    assert {x.dtype for x in watching.seen} == {np.dtype(np.float32)}
    # The flight records the states that were seen: headings wrapped, quaternions of unit length.
    assert np.array_equal(
        np.array(leaves(flight.states))[:, :-1], np.stack(watching.states, axis=1)
    )


@by_name
def test_replay_repeats_a_flight_and_takes_relaxed_thrust(craft: Spacecraft) -> None:
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


def test_replay_does_not_wrap_the_heading() -> None:
    craft = nasty_planar()
    start = map_leaves(lambda x: float(x[0]), replace(random_states(2, 1, 0), w=np.array([3.0])))
    track = replay(craft, start, np.zeros((50, 5)), Timing())
    assert track.attitude.angle[-1] == pytest.approx(start.attitude.angle + 30.0, abs=1e-11)


def test_a_craft_that_hardly_turns_flies_an_orbit_in_long_steps() -> None:
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
    timing = Timing(10.0, 1, 4)
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
SHIPPED = ["rans/GoToPose2D-v0", "rans/GoToPose3D-v0"]


def drake(name: str, **kwargs: Any) -> gymnasium.Env[Any, Any]:
    env = gymnasium.make(name.replace("-v0", "-Drake-v0"), **kwargs).unwrapped
    assert isinstance(env, DrakeEnv)
    return env


@pytest.mark.parametrize("name", NASTY)
def test_gymnasium_and_sb3_find_nothing_wrong(name: str) -> None:
    check_env(drake(name), skip_render_check=True)
    check_env_for_sb3(drake(name))


@pytest.mark.parametrize(
    ("name", "nasty"), [*((name, True) for name in [*NASTY][1::2]), (SHIPPED[1], False)]
)
def test_same_rewards_and_ends_as_the_fast_environment(name: str, nasty: bool) -> None:
    """Two episodes of a seed under the same random commands, at a step size that plays no part."""
    craft: dict[str, Any] = {"spacecraft": NASTY[name]} if nasty else {}
    timing = Timing(substeps=32, episode_steps=8)
    ours, judge = (flown(make(name, timing=timing, **craft)) for make in (gymnasium.make, drake))
    for (seen, reward, *ends, info), (
        seen_in_drake,
        reward_in_drake,
        *ends_in_drake,
        info_in_drake,
    ) in zip(ours, judge, strict=True):
        # 8 periods at 32 substeps are true to 1e-8 m; rewards change at most by 4 a metre (1 / scale,
        # up to 20 for narrow ones); observations are rounded to float32, 5e-7 of a way of 4 m.
        assert reward_in_drake == pytest.approx(reward, abs=2e-7)
        np.testing.assert_allclose(seen_in_drake, seen, atol=1e-6)
        assert ends_in_drake == ends
        assert info_in_drake["reward_terms"] == pytest.approx(info["reward_terms"], abs=2e-7)
        assert info_in_drake.keys() == info.keys()


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
