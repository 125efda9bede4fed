"""Safety filter of throttles, which brakes: flights that want to break a limit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_missions.guard import FlownBackup, safety_filter
from rans_missions.guard.expected import Expected
from rans_missions.guard.manoeuvres import braking_command
from rans_missions.tasks import Dock, Hold
from scipy.stats import norm

from rans import Conditions, SensorConditions, SensorsConditions, ThrusterConditions, Timing
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Episode, Setup, World, step
from rans.model.fields import Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import fly_in_drake
from tests.support.ramming import Ramming

DEPUTY = load_spacecraft("afrl-deputy")
NOISY = SensorsConditions(
    position=SensorConditions(noise=0.1), velocity=SensorConditions(noise=0.01)
)


@pytest.mark.slow
@pytest.mark.parametrize("flying", [fly, fly_in_drake])
def test_the_speed_limit_of_docking_is_kept(flying):
    task = Dock()
    starts = scenarios(task, DEPUTY, seed=3, count=4)
    timing = Timing(10.0, None, 6, checks=10)
    free = flying(DEPUTY, task, Ramming(), starts, timing)
    assert free.violated().all()
    kept = flying(DEPUTY, task, Ramming(), starts, timing, guard=FlownBackup())
    assert not kept.violated().any()
    assert kept.guarded.mean() > 0.5
    # It is not braked more than it must be: towards the target at nearly the limit.
    assert min(kept.margins["speed"][-1]) < 0.05


def edge_of_safety(world: World, guard: FlownBackup, count: int) -> tuple[Any, Any]:
    """States and goals around a keep-out ball, as fast towards it as the filter calls safe, by bisection."""
    starts = scenarios(world.task, world.craft, seed=8, count=count)
    goal = map_leaves(lambda x: np.broadcast_to(np.asarray(x, float), count).copy(), starts.goal)
    rng = np.random.default_rng(8)
    p = rng.normal(size=(3, count))
    p *= rng.uniform(52.0, 95.0, count) / np.linalg.norm(p, axis=0)
    way = 15.0 * rng.normal(size=(3, count)) - p
    way /= np.linalg.norm(way, axis=0)
    slow = np.zeros(count)
    fast = np.full(count, 3.0)
    for _ in range(5):
        middle = 0.5 * (slow + fast)
        state = replace(starts.start, p=Vec3(*p), v=Vec3(*(way * middle)))
        safe = guard.safe(world, state, goal)
        slow = np.where(safe, middle, slow)
        fast = np.where(safe, fast, middle)
    return replace(starts.start, p=Vec3(*p), v=Vec3(*(way * slow))), goal


def worst_commands(world: World, state: Any, goal: Any, count: int) -> np.ndarray:
    """Commands (N, 6) that reduce the distance from the ball after braking from the next state, by differences."""

    def after(command: np.ndarray) -> np.ndarray:
        here, there = state, goal
        least = np.full(count, np.inf)
        for k in range(5):
            fields = tuple(command.T) if k == 0 else braking_command(world, here, there)
            outcome = step(world, Episode(here, there, clock=np.full(count, k)), fields)
            here, there = outcome.episode.state, outcome.episode.goal
            for margin in outcome.margins.values():
                least = np.minimum(least, margin)
        return least

    middle = np.full((count, 6), 0.5)
    rest = after(middle)
    slopes = [after(middle + 0.1 * row) - rest for row in np.eye(6)]
    return (np.array(slopes).T < 0.0).astype(float)


@pytest.mark.parametrize(("count", "periods"), [(2, 2), pytest.param(8, 6, marks=pytest.mark.slow)])
def test_safe_states_stay_safe_against_an_adversary_with_gradients(count, periods):
    """From the edge of what the filter calls safe, with commands that lead to the ball by its own braking."""
    task = Hold()
    craft = load_spacecraft("vbar-chaser")
    guard = FlownBackup()
    world = World(Setup(craft, task, task.timing))
    state, goal = edge_of_safety(world, guard, count)
    assert guard.safe(world, state, goal).all()
    for k in range(periods):
        desired = worst_commands(world, state, goal, count)
        command, changed = guard.admitted(world, state, goal, tuple(desired.T))
        outcome = step(world, Episode(state, goal, clock=np.full(count, k)), command)
        state, goal = outcome.episode.state, outcome.episode.goal
        assert min(margin.min() for margin in outcome.margins.values()) >= guard.slack
        assert guard.safe(world, state, goal).all()
        if k == 0:
            assert changed.mean() > 0.5


def test_a_keep_out_ball_is_kept_though_thrust_is_weak():
    """Along an axis the chaser's 0.02 m/s^2 need 25 s and 6.25 m to stop from 0.5 m/s, after 5 m in this period.

    So it may coast for a period 62 m from the target of a ball of 50 m, and from 60 m it brakes.
    """
    task = Hold()
    craft = load_spacecraft("vbar-chaser")
    world = World(Setup(craft, task, task.timing))
    starts = scenarios(task, craft, seed=1, count=1)
    start, goal = map_leaves(
        lambda x: float(x[0]) if np.ndim(x) else x, (starts.start, starts.goal)
    )
    guard = safety_filter(Setup(craft, task))
    shut = (0.0,) * len(craft.commands)
    for distance, changed in ((100.0, False), (62.0, False), (60.0, True)):
        place = Vec3(0.0, distance, 0.0)
        state = replace(start, p=place, v=Vec3(0.0, -0.5, 0.0))
        assert guard.admitted(world, state, goal, shut)[1] is changed


def test_the_reserve_is_what_rare_readings_are_off_by():
    """Hold, whose ball has a slope of 1: of 260 periods a one-sided error of one in 20 x 260 is 3.55 deviations.

    An error of the velocity counts for 10 s, and the time to stop twice the mean speed of 2,600 s at 0.02 m/s^2.
    """
    task = Hold()
    setup = Setup(load_spacecraft("vbar-chaser"), task, task.timing, Conditions(sensors=NOISY))
    assert task.timing.episode_steps == 260
    expected = Expected.of(setup)
    starts = scenarios(task, setup.craft, seed=0, count=64)
    way = np.linalg.norm(
        [np.asarray(x) for x in (starts.start.p - starts.goal.p).columns()], axis=0
    )
    braking = 10.0 + 2.0 * way.max() / 2600.0 / 0.02
    deviations = -norm.ppf(0.05 / 260.0)
    assert deviations == pytest.approx(3.55, abs=0.01)
    reserve = deviations * math.hypot(0.1, 0.01 * braking)
    assert dict(expected.reserve)["keep-out"] == pytest.approx(reserve, rel=1e-4)


def test_a_mixture_is_expected_with_all_of_its_parts():
    """As one part is that has the most noise and all delays, whichever comes first."""
    noisy = Conditions(sensors=NOISY)
    late = Conditions(thrusters=ThrusterConditions(command_delay=10.0))
    both = Conditions(sensors=NOISY, thrusters=ThrusterConditions(command_delay=(0.0, 10.0)))
    task = Dock()

    def expected(conditions):
        return Expected.of(Setup(DEPUTY, task, task.timing, conditions))

    assert expected(replace(noisy, others=(late,))) == expected(both)
    assert expected(replace(late, others=(noisy,))) == expected(both)
    assert expected(noisy) != expected(both)
