"""The one step, whoever drives it: what tasks read is found, worlds pull, goals move, NaN ends an episode."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from rans import Conditions, Engine, SensorConditions, SensorsConditions, Timing
from rans.episode.flight import fly
from rans.episode.scenario import Scenario, draws, scenarios
from rans.episode.step import Episode, Setup, World, step
from rans.model.drift import ClohessyWiltshire, Drift, step_goal
from rans.model.dynamics import PlanarState, State
from rans.model.fields import Field, Heading, Vec2, leaves, map_leaves
from rans.model.random import Draws
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import (
    GoToPose,
    MultiTask,
    Transition,
)
from rans.tasks.derived import watches_switching
from rans.tasks.observation_terms import ObservationTerm, Scalar, VectorInW
from tests.support.random_flights import Random
from tests.support.states import planar
from tests.support.switching import SwitchingGoToPose
from validation.study.conditions import Watching

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
BOTH = pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)


@dataclass(frozen=True)
class Chase(GoToPose):
    """A goal that drifts and turns on an orbit so low that 25 s of it are felt: a tenth of a turn."""

    mean_motion: float = 0.025
    """rad/s."""

    @property
    def drift(self) -> Drift:
        return ClohessyWiltshire(self.mean_motion)

    def sample(self, random: Any) -> tuple[State, State]:
        start, goal = super().sample(random)
        moving = random.moving(random.direction().scale(0.05), goal.attitude, random.spin(0.1))
        return start, replace(moving, p=random.direction().scale(0.5))

    def later(self, goal: Any, time: Field) -> Any:
        return step_goal(goal, self.drift, time)


@dataclass(frozen=True)
class Counting(GoToPose):
    """Charges moved valves without a word to anybody, and shows one vector and one scalar more."""

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        more = VectorInW("wind_", "m/s", state.v), Scalar("gust", "m", state.p.x)
        return (*super().observation_terms(state, goal), *more)

    def reward(self, transition: Transition) -> dict[str, Field]:
        moved = [
            abs(new - old) for new, old in zip(transition.command, transition.previous, strict=True)
        ]
        return {"moved": -sum(moved)}


@BOTH
def test_engine_environment_and_flight_take_the_same_steps(craft):
    task = Chase()
    timing = Timing(episode_steps=20)
    pilot = Random(craft)
    flight = fly(craft, task, pilot, scenarios(task, craft, seed=9, count=2), timing)
    assert np.abs(flight.goals.p.x[-1] - flight.goals.p.x[0]).min() > 0.01
    engine = Engine(craft, task, 2, timing, seed=9, dtype=torch.float64)
    name = "rans/GoToPose2D-v0" if craft.dimension == 2 else "rans/GoToPose3D-v0"
    env: Any = gymnasium.make(name, spacecraft=craft, task=task, timing=timing).unwrapped
    env.reset(seed=9)
    for k, command in enumerate(flight.commands[:19]):
        result = engine.step(torch.from_numpy(command))
        _, reward, *_ = env.step(command[0])
        here, there = (
            map_leaves(lambda x, i=k: np.asarray(x)[i + 1], tree)  # type: ignore[misc]
            for tree in (flight.states, flight.goals)
        )
        # the same operations in another order: rounding of 25 s of float64
        np.testing.assert_allclose(leaves(engine.state), leaves(here), rtol=0, atol=1e-11)
        np.testing.assert_allclose(leaves(engine.goal), leaves(there), rtol=0, atol=1e-11)
        np.testing.assert_allclose(
            leaves(env.state), [x[0] for x in leaves(here)], rtol=0, atol=1e-11
        )
        np.testing.assert_allclose([reward], result.reward[:1], rtol=0, atol=1e-9)


def test_what_a_reward_reads_is_found_not_promised():
    """Eight valves open, then shut: 8 each time, in the batch as in the single environment."""
    assert not watches_switching(GoToPose(), PLATFORM)
    assert watches_switching(SwitchingGoToPose(), PLATFORM)
    assert not watches_switching(MultiTask(), PLATFORM)
    assert watches_switching(MultiTask(go_to_pose=SwitchingGoToPose()), PLATFORM)
    engine = Engine(PLATFORM, Counting(), 2, seed=1)
    env = gymnasium.make("rans/GoToPose2D-v0", task=Counting()).unwrapped
    env.reset(seed=1)
    for command in (torch.ones(2, 8), torch.zeros(2, 8)):
        assert engine.step(command).reward.tolist() == [-8.0, -8.0]
        assert env.step(command[0].numpy())[1] == -8.0


@dataclass(frozen=True)
class OnlyTorch(GoToPose):
    """Calls a tensor's own method, which no symbol has."""

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        return {name: error.clip(0.0, 9.0) for name, error in super().errors(state, goal).items()}


def test_a_task_that_symbols_cannot_follow_flies_all_the_same():
    engine, usual = (Engine(PLATFORM, task, 2, seed=1) for task in (OnlyTorch(), GoToPose()))
    assert not watches_switching(OnlyTorch(), PLATFORM)
    with pytest.warns(
        UserWarning, match="steps slower, .* more than arithmetic on fields: 'Symbol'"
    ):
        first = engine.step(torch.ones(2, 8)).reward
    # The usual step is machine code, whose last digits differ.
    torch.testing.assert_close(first, usual.step(torch.ones(2, 8)).reward, rtol=1e-5, atol=1e-6)
    for _ in range(2):
        torch.testing.assert_close(
            engine.step(torch.ones(2, 8)).reward,
            usual.step(torch.ones(2, 8)).reward,
            rtol=1e-5,
            atol=1e-6,
        )


@pytest.mark.parametrize("way", [(1e8, 0.0), (0.0, 1e8), (-1e25, 0.0), (math.nan, 0.0)])
def test_an_episode_ends_before_a_state_that_no_craft_reaches(way):
    """A jump of 1e8 m, or to 1e8 m/s, within 0.2 s; the observation is of the state before."""
    place, speed = way

    def move(state, inputs):
        return (replace(state, p=state.p + Vec2(place, 0.0), v=state.v + Vec2(0.0, speed)),)

    start = PlanarState(Vec2(1.0, 2.0), Heading(0.5), Vec2(0.1, 0.2), 0.3)
    goal = planar()
    world = World(Setup(PLATFORM, GoToPose(fail_distance=1e30)))
    outcome = step(world, Episode(start, goal), (0.0,) * 8, move=move)
    assert outcome.lost
    assert outcome.failed
    assert not outcome.truncated
    assert leaves(outcome.episode.state) == leaves(start)
    assert math.isfinite(outcome.reward)
    # Numbers as large are no fault: they are those of a craft that moved so before.
    far = replace(start, p=Vec2(1e12, 0.0), v=Vec2(1e9, 0.0))
    assert not step(world, Episode(far, goal), (0.0,) * 8).lost


def under(conditions: Conditions, count: int = 1) -> tuple[World, Scenario, Draws, Episode]:
    world = World(Setup(PLATFORM, GoToPose(), conditions=conditions))
    own = draws(3, count)
    starts = scenarios(world.task, PLATFORM, seed=3, count=count)
    return world, starts, own, world.begin(starts.start, starts.goal, 0, own)


BLIND = Conditions(sensors=SensorsConditions(SensorConditions(bias=50.0)))
"""Told to be 50 m away, far behind where the task fails."""


def test_reward_and_ends_are_of_the_true_state():
    world, starts, own, now = under(BLIND, count=4)
    truth = World(Setup(PLATFORM, GoToPose()))
    usual = truth.begin(starts.start, starts.goal)
    for _ in range(5):
        shut = tuple(np.zeros((8, 4)))
        outcome = step(world, now, shut, own)
        expected = step(truth, usual, shut)
        for a, b in (
            (outcome.reward, expected.reward),
            (outcome.terminated, expected.terminated),
            (outcome.reached, expected.reached),
        ):
            assert np.array_equal(a, b)
        assert not outcome.terminated.any()
        now = outcome.episode
        usual = expected.episode
    assert (world.sensed(now, own).p - now.state.p).norm() == pytest.approx([50.0] * 4)


def test_controllers_are_told_what_sensors_tell():
    pilot = Watching(PLATFORM, 1)
    starts = scenarios(GoToPose(), PLATFORM, seed=3, count=2)
    flight = fly(
        PLATFORM,
        GoToPose(),
        pilot,
        starts,
        Timing(episode_steps=5),
        conditions=BLIND,
        draws=draws(3, 2),
    )
    goal = np.array(starts.goal.p.columns())
    for k, (told, seen) in enumerate(zip(pilot.states, pilot.seen, strict=True)):
        true = np.array(leaves(flight.states))[:, k]
        assert np.hypot(*(told - true)[:2]) == pytest.approx([50.0] * 2)
        assert np.array_equal(told[3:5], true[3:5])
        away = np.hypot(seen[:, 6], seen[:, 7])  # the way to go, m
        np.testing.assert_allclose(away, np.hypot(*(goal - told[:2])), rtol=1e-6)
