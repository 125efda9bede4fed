"""What episodes draw: distributions, independence, and what each fault, kick, swing and sensor does."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from rans.episode import Episode, World, step
from rans.errors import ConfigError
from rans.model.case import Case
from rans.model.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.model.faults import fault_sets
from rans.model.fields import leaves
from rans.model.random import Draws
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import draws, scenarios
from rans.tasks import GoToPose
from tests.worlds import EFFECTS

PLATFORM, FLYER = load_spacecraft("floating-platform"), load_spacecraft("free-flyer")
CRAFTS = {2: PLATFORM, 3: FLYER}
BOTH = pytest.mark.parametrize("dimension", [2, 3])
COUNT = 10_000
LIKELY = 1e-4
"""Least probability of what is seen, if drawn as stated; the seed is fixed, so nothing is left to luck."""
TASK = GoToPose(fail_distance=1e3, fail_spin=1e3)


def begun(conditions: Conditions, dimension: int = 2, count: int = COUNT) -> tuple[World, Draws, Episode]:
    world, own = World(CRAFTS[dimension], TASK, conditions=conditions), draws(11, count)
    starts = scenarios(TASK, world.craft, 11, count)
    return world, own, world.begin(starts.start, starts.goal, 0, own)


def case(conditions: Conditions, dimension: int = 2, count: int = COUNT) -> Any:
    return begun(conditions, dimension, count)[2].case


def assert_uniform(values: Any, low: float, high: float) -> None:
    assert np.shape(values) == (COUNT,)
    assert low <= np.min(values)
    assert np.max(values) <= high
    # Standard error of the mean of uniform numbers; five of them are passed once in two million.
    assert np.mean(values) == pytest.approx((low + high) / 2, abs=5 * (high - low) / math.sqrt(12 * COUNT))
    assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > LIKELY


UNIFORM: dict[str, tuple[Conditions, Callable[[Case], Any], float, float]] = {
    "mass": (Conditions(BodyConditions(mass=(0.7, 1.4))), lambda c: c.body.mass / PLATFORM.mass, 0.7, 1.4),
    "inertia": (Conditions(BodyConditions(inertia=(0.5, 2.0))),
                lambda c: c.body.inertia[0] / PLATFORM.inertia[2][2], 0.5, 2.0),
    "centre": (Conditions(BodyConditions(centre=(0.01, 0.03))),
               lambda c: np.hypot(*c.body.centre), 0.01, 0.03),
    "thrust": (Conditions(thrusters=ThrusterConditions(thrust=(0.7, 1.3))),
               lambda c: c.body.gain[5], 0.7, 1.3),
    "pressure": (Conditions(thrusters=ThrusterConditions(pressure=(0.8, 1.0))),
                 lambda c: c.body.gain[2], 0.8, 1.0),
    "droop": (Conditions(thrusters=ThrusterConditions(droop=(0.1, 0.3))), lambda c: c.body.droop, 0.1, 0.3),
    "latency": (Conditions(thrusters=ThrusterConditions(latency=(0.02, 0.1))),
                lambda c: c.lag and c.lag.latency, 0.02, 0.1),
    "fall": (Conditions(thrusters=ThrusterConditions(fall=(0.02, 0.1))),
             lambda c: c.lag and c.lag.fall, 0.02, 0.1),
    "least on": (Conditions(thrusters=ThrusterConditions(least_on=(0.0, 0.6))),
                 lambda c: c.hold and c.hold.on, 0.0, 0.6),
    "fault's time": (Conditions(faults=FaultConditions(count=1.0, time=(1.0, 20.0))),
                     lambda c: c.fault and c.fault.begins, 1.0, 20.0),
    "force": (Conditions(disturbances=DisturbanceConditions(force=(0.1, 0.3))),
              lambda c: c.push and c.push.force.norm(), 0.1, 0.3),
    "torque": (Conditions(disturbances=DisturbanceConditions(torque=(0.1, 0.3))),
               lambda c: c.push and abs(c.push.torque), 0.1, 0.3),
    "its direction": (Conditions(disturbances=DisturbanceConditions(force=0.3)),
                      lambda c: c.push and np.arctan2(c.push.force.y, c.push.force.x), -math.pi, math.pi),
    "kick": (Conditions(disturbances=DisturbanceConditions(kicks=2, kick=(0.1, 0.3))),
             lambda c: c.kicks[1].impulse.force.norm(), 0.1, 0.3),
    "bias": (Conditions(sensors=SensorsConditions(velocity=SensorConditions(bias=(0.01, 0.02)))),
             lambda c: c.sensors and c.sensors.bias and c.sensors.bias[2].norm(), 0.01, 0.02),
}


@pytest.mark.parametrize("name", UNIFORM)
def test_ranges_are_uniform_within_their_bounds(name: str) -> None:
    conditions, value, low, high = UNIFORM[name]
    assert_uniform(value(case(conditions)), low, high)


@BOTH
def test_a_number_is_no_distribution(dimension: int) -> None:
    late = ThrusterConditions(latency=0.05, command_delay=0.1)
    fixed = case(Conditions(BodyConditions(mass=1.2), late), dimension)
    assert fixed.body.mass == CRAFTS[dimension].mass * 1.2
    assert fixed.lag.latency == pytest.approx(0.15)


def test_thrusts_are_drawn_one_by_one_and_pressure_for_all() -> None:
    thrust = np.array(case(EFFECTS["thrust"]).body.gain)
    own = np.array(case(Conditions(thrusters=ThrusterConditions(thrust=(0.7, 1.3)))).body.gain)
    assert np.abs(np.corrcoef(own) - np.eye(8)).max() < 5 / math.sqrt(COUNT)  # five standard errors
    ratio = thrust / own
    np.testing.assert_allclose(ratio, ratio[:1].repeat(8, axis=0), rtol=1e-12)
    assert_uniform(ratio[0], 0.8, 1.0)


def test_directions_in_space_are_uniform_on_the_sphere() -> None:
    push = case(EFFECTS["push"], 3).push
    for vector in (push.force, push.torque):  # Archimedes: every coordinate is
        for x in vector.columns():
            assert_uniform(x / vector.norm(), -1.0, 1.0)


PARTS: dict[str, Callable[[Any], Any]] = {
    "body": lambda c: (c.body.mass, c.body.inertia, c.body.centre),
    "thrust": lambda c: (c.body.gain, c.body.droop),
    "latency": lambda c: c.lag.latency,
    "hold": lambda c: c.hold,
    "push": lambda c: c.push,
    "swing": lambda c: c.swing,
    "kicks": lambda c: c.kicks,
    "faults": lambda c: c.fault.begins,
}


@BOTH
@pytest.mark.parametrize("effect", PARTS)
def test_an_effect_draws_the_same_beside_others(effect: str, dimension: int) -> None:
    alone, among = (PARTS[effect](case(EFFECTS[name], dimension, 50)) for name in (effect, "all"))
    assert leaves(alone)
    for a, b in zip(leaves(alone), leaves(among), strict=True):
        assert np.array_equal(a, b)


def test_whatever_is_switched_on_starts_and_goals_stay() -> None:
    *_, now = begun(EFFECTS["all"], count=20)
    usual = scenarios(TASK, PLATFORM, 11, 20)
    assert np.array_equal(leaves((now.state, now.goal)), leaves((usual.start, usual.goal)))


# Faults.


def health(conditions: FaultConditions, time: float = 0.0, count: int = COUNT) -> Any:
    """Gains and leaks, (thrusters, N) each."""
    body = case(Conditions(faults=conditions), count=count).body_at(time)
    return [np.array([np.broadcast_to(x, count) for x in part]) for part in (body.gain, body.leak)]


@pytest.mark.parametrize(("kind", "gain", "leak"), [
    ("dead", (0.0, 0.0), (0.0, 0.0)), ("stuck-open", (0.0, 0.0), (1.0, 1.0)),
    ("stuck", (0.0, 0.0), (0.3, 0.8)), ("weak", (0.3, 0.8), (0.0, 0.0))])
def test_each_kind_does_what_it_says(kind: Any, gain: Any, leak: Any) -> None:
    gains, leaks = health(FaultConditions(count=1.0, kinds=(kind,), share=(0.3, 0.8)))
    hit = (gains != 1.0) | (leaks != 0.0)
    assert (hit.sum(axis=0) == 1).all()
    for values, (low, high) in ((gains[hit], gain), (leaks[hit], leak)):
        assert low <= values.min()
        assert values.max() <= high
        assert low == high or values.std() > 0.1  # of a uniform range of a half: 0.14


def test_faults_hit_distinct_thrusters_each_pair_as_likely() -> None:
    gains, _ = health(FaultConditions(count=2.0, kinds=("dead",)))
    assert ((gains == 0.0).sum(axis=0) == 2).all()
    first, second = np.array([np.nonzero(column == 0.0)[0] for column in gains.T]).T
    seen = np.bincount(first * 8 + second, minlength=64)
    pairs = [a * 8 + b for a in range(8) for b in range(a + 1, 8)]
    assert stats.chisquare(seen[pairs]).pvalue > LIKELY


def test_as_many_fail_as_are_drawn_and_kinds_are_as_likely() -> None:
    gains, leaks = health(FaultConditions(count=(0.0, 2.0), kinds=("dead", "stuck-open")))
    number = (gains == 0.0).sum(axis=0)
    assert stats.chisquare(np.bincount(number, minlength=3)).pvalue > LIKELY
    dead = (leaks[gains == 0.0] == 0.0).sum()
    assert stats.binomtest(int(dead), int(number.sum())).pvalue > LIKELY


@BOTH
@pytest.mark.parametrize("kind", ["dead", "stuck-open"])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("among", ["recoverable", "unrecoverable"])
def test_sets_that_are_recoverable_or_not_are_each_as_likely(among: Any, count: int, kind: Any,
                                                             dimension: int) -> None:
    faults = FaultConditions(float(count), (kind,), among=among)
    expected = {one.thrusters for one in fault_sets(CRAFTS[dimension], count, kind)
                if one.recoverable == (among == "recoverable")}
    if not expected:
        with pytest.raises(ConfigError, match=f"un.* of 1 {kind} thruster, but .* has none; `rans faults`"):
            case(Conditions(faults=faults), dimension)
        return
    body = case(Conditions(faults=faults), dimension).body_at(0.0)
    hit = np.array([np.broadcast_to(x, COUNT) for x in body.gain]) == 0.0
    assert (np.array([np.broadcast_to(x, COUNT) for x in body.leak])[hit] == (kind == "stuck-open")).all()
    seen = Counter(tuple(np.flatnonzero(column).tolist()) for column in hit.T)
    assert set(seen) == expected
    assert stats.chisquare(list(seen.values())).pvalue > LIKELY


def test_recoverable_faults_are_as_many_and_of_each_kind_as_often_and_pairs_fail_alike() -> None:
    conditions = FaultConditions(count=(0.0, 2.0), among="recoverable")
    gains, leaks = health(conditions)
    number, stuck = (gains == 0.0).sum(axis=0), (leaks == 1.0).sum(axis=0)
    assert stats.chisquare(np.bincount(number, minlength=3)).pvalue > LIKELY
    assert ((stuck == 0) | (stuck == number)).all()
    assert stats.binomtest(int((stuck > 0).sum()), int((number > 0).sum())).pvalue > LIKELY


def test_kinds_with_sets_of_their_own_keep_them() -> None:
    """Of a craft whose thruster 0 is too strong for the others to balance, it cannot be stuck open."""
    first, *others = PLATFORM.thrusters
    strong = replace(PLATFORM, thrusters=(replace(first, force=20.0), *others))
    faults = FaultConditions(1.0, ("dead", "stuck-open"), among="recoverable")
    own = draws(11, COUNT)
    world = World(strong, TASK, conditions=Conditions(faults=faults))
    body = world.recalled(Episode(None, None), own).case.body_at(0.0)  # type: ignore[union-attr]
    assert (np.array(body.gain[0]) == 0.0).any()
    assert not np.array(body.leak[0]).any()
    dead = (np.array(body.gain) == 0.0) & (np.array(body.leak) == 0.0)
    assert stats.binomtest(int(dead.any(axis=0).sum()), COUNT).pvalue > LIKELY
    assert stats.chisquare(dead.sum(axis=1)).pvalue > LIKELY


def test_a_fault_begins_with_the_period_in_which_its_time_has_come() -> None:
    faults = FaultConditions(count=1.0, kinds=("dead",), time=1.0)
    for time, many in ((0.0, 0), (0.8, 0), (1.0, 20), (1.2, 20), (24.8, 20)):
        assert (health(faults, time, 20)[0] == 0.0).sum() == many


def test_who_does_not_fail_keeps_the_thrust_it_drew() -> None:
    """And who is stuck open gives all of it."""
    drawn = Conditions(thrusters=ThrusterConditions(thrust=(0.7, 0.9)),
                       faults=FaultConditions(count=1.0, kinds=("stuck-open",), time=5.0))
    found = case(drawn, count=50)
    sound, failed = found.body_at(0.0), found.body_at(5.0)
    whole = np.array(failed.gain) + np.array(failed.leak)
    np.testing.assert_allclose(whole, np.array(sound.gain), rtol=1e-15)
    assert ((np.array(failed.leak) > 0.0).sum(axis=0) == 1).all()


# What pushes.


def disturbances(found: Case, steps: int, period: float = 0.2) -> np.ndarray:
    """(steps, components, N)."""
    return np.array([leaves(found.disturbance(np.float64(k), period)) for k in range(steps)])


@BOTH
def test_kicks_give_their_impulse_in_one_period(dimension: int) -> None:
    kicked = DisturbanceConditions(kicks=1, kick=0.5, kick_spin=0.1)
    found = case(Conditions(disturbances=kicked), dimension, 40)
    pushed = disturbances(found, 125)
    assert ((pushed != 0.0).any(axis=1).sum(axis=0) == 1).all()
    total = pushed.sum(axis=0) * 0.2
    np.testing.assert_allclose(np.linalg.norm(total[:dimension], axis=0), 0.5, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(total[dimension:], axis=0), 0.1, rtol=1e-12)


def test_a_kicked_spacecraft_is_faster_by_impulse_over_mass() -> None:
    kicked = DisturbanceConditions(kicks=2, kick=(0.1, 0.5))
    world, own, now = begun(Conditions(disturbances=kicked), count=10)
    first = now.state
    for _ in range(125):
        now = step(world, now, tuple(np.zeros((8, 10))), own).episode
    gained = now.state.v - first.v
    both: Any = [kick.impulse.force for kick in now.case.kicks]  # type: ignore[union-attr]
    for axis in ("x", "y"):
        expected = sum(getattr(force, axis) for force in both) / PLATFORM.mass
        np.testing.assert_allclose(getattr(gained, axis), expected, rtol=0, atol=1e-13)


def test_moments_of_kicks_are_any_period_of_the_episode() -> None:
    found = case(Conditions(disturbances=DisturbanceConditions(kicks=1, kick=1.0)))
    seen = np.bincount(found.kicks[0].step.astype(int))
    assert len(seen) == 125
    assert stats.chisquare(seen).pvalue > LIKELY


def test_a_swing_has_its_value_in_the_middle_of_each_period() -> None:
    """One of 8 s: a sine through the middles, fitted by least squares, has the phase that was drawn."""
    slow = DisturbanceConditions(slow_force=0.3, slow_torque=0.1, slow_period=8.0)
    found = case(Conditions(disturbances=slow), count=30)
    pushed, t = disturbances(found, 80), (np.arange(80) + 0.5) * 0.2
    wave = np.column_stack([np.sin(math.pi / 4 * t), np.cos(math.pi / 4 * t)])
    (a, b), left, *_ = np.linalg.lstsq(wave, pushed[:, 2], rcond=None)
    assert left.max() < 1e-25
    phase = np.arctan2(b, a)  # of a torque either way: half a turn on where it is negative
    np.testing.assert_allclose(np.sin(phase - found.swing.phase), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(a, b), 0.1, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(pushed[:, :2], axis=1).max(axis=0), 0.3, rtol=0.005)  # at best


# What sensors tell.

def sensors(what: str, sizes: tuple[float, ...]) -> SensorsConditions:
    """With so much of it in position, attitude, velocity and spin."""
    names = ("position", "attitude", "velocity", "spin")
    each: Any = {name: SensorConditions(**{what: size}) for name, size in zip(names, sizes, strict=True)}
    return SensorsConditions(**each)


def errors(world: World, own: Draws, now: Episode) -> list[np.ndarray]:
    """Of position, attitude, velocity and spin: components of what is told beside the truth, (.., N)."""
    told, true = world.sensed(now, own), now.state
    turn = true.attitude.to(told.attitude)
    if world.craft.dimension == 2:
        return [np.array((told.p - true.p).columns()), np.array([turn.angle]),
                np.array((told.v - true.v).columns()), np.array([told.w - true.w])]
    return [np.array((told.p - true.p).columns()), 2.0 * np.array([turn.x, turn.y, turn.z]),
            np.array((told.v - true.v).columns()), np.array((told.w - true.w).columns())]


@BOTH
def test_noise_is_normal_and_new_in_every_component_and_period(dimension: int) -> None:
    sizes = (0.02, 0.01, 0.03, 0.04)
    noisy = Conditions(sensors=sensors("noise", sizes))
    world, own, now = begun(noisy, dimension)
    first = errors(world, own, now)
    second = errors(world, own, replace(now, clock=now.clock + 1))
    for size, a, b in zip(sizes, first, second, strict=True):
        for x in (*a, *b):
            assert stats.kstest(x / size, "norm").pvalue > LIKELY
        both = np.abs(np.corrcoef([*a, *b]) - np.eye(2 * len(a)))
        assert both.max() < 5 / math.sqrt(COUNT)
    assert np.array_equal(errors(world, own, now)[0], first[0]), "a moment is told once"


@BOTH
def test_a_bias_is_the_same_in_every_period(dimension: int) -> None:
    sizes = (0.1, 0.02, 0.2, 0.3)
    world, own, now = begun(Conditions(sensors=sensors("bias", sizes)), dimension, 20)
    first = errors(world, own, now)
    for _ in range(3):
        now = step(world, now, tuple(np.ones((len(world.craft.thrusters), 20))), own).episode
    for size, a, b in zip(sizes, first, errors(world, own, now), strict=True):
        np.testing.assert_allclose(np.linalg.norm(a, axis=0), size, rtol=1e-4)  # 2 sin(0.01) is 0.02 - 3e-7
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)


@BOTH
def test_late_readings_are_states_of_so_many_periods_ago(dimension: int) -> None:
    world, own, now = begun(Conditions(sensors=SensorsConditions(delay=(0.0, 3.0))), dimension, 40)
    delay = np.asarray(now.case.sensors.delay)  # type: ignore[union-attr]
    assert sorted(set(delay)) == [0.0, 1.0, 2.0, 3.0]
    track = [np.array(leaves(now.state))]
    for k in range(8):
        told = np.array(leaves(world.sensed(now, own)))
        for n in range(40):
            assert np.array_equal(told[:, n], track[max(k - int(delay[n]), 0)][:, n])
        now = step(world, now, tuple(np.ones((len(world.craft.thrusters), 40))), own).episode
        track.append(np.array(leaves(now.state)))


def test_where_a_reading_drops_out_the_last_one_stands() -> None:
    lost = Conditions(sensors=SensorsConditions(position=SensorConditions(noise=0.01, dropout=0.3),
                                                attitude=SensorConditions(noise=0.01)))
    world, own, now = begun(lost)
    before, repeated = world.sensed(now, own), []
    for _ in range(3):
        now = step(world, now, tuple(np.ones((8, COUNT))), own).episode
        told = world.sensed(now, own)
        same = [getattr(told.p, axis) == getattr(before.p, axis) for axis in ("x", "y")]
        assert np.array_equal(*same), "of both components or none"
        repeated.append(same[0])
        assert not (told.attitude.angle == before.attitude.angle).any()
        fresh = ~same[0]
        assert np.abs(told.p.x - now.state.p.x)[fresh].max() < 0.06  # six standard deviations
        before = told
    for gone in repeated:
        assert stats.binomtest(int(gone.sum()), COUNT, 0.3).pvalue > LIKELY
    assert abs(np.corrcoef(repeated[0], repeated[1])[0, 1]) < 5 / math.sqrt(COUNT)
