"""What sensors tell: noise, bias, delays and dropouts are what conditions say."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from rans import Conditions, SensorConditions, SensorsConditions, Timing
from rans.episode.step import Episode, World, step
from rans.model.fields import Quat, leaves
from rans.model.random import Draws
from tests.support.draws import BOTH, COUNT, LIKELY, begun


def sensors(what: str, sizes: tuple[float, ...]) -> SensorsConditions:
    """With so much of it in position, attitude, velocity and spin."""
    names = ("position", "attitude", "velocity", "spin")
    each: Any = {
        name: SensorConditions(**{what: size}) for name, size in zip(names, sizes, strict=True)
    }
    return SensorsConditions(**each)


def errors(world: World, own: Draws, now: Episode) -> list[np.ndarray]:
    """Of position, attitude, velocity and spin: components of what is told beside the truth, (.., N)."""
    told = world.sensed(now, own)
    true = now.state
    turn = true.attitude.to(told.attitude)
    if world.craft.dimension == 2:
        return [
            np.array((told.p - true.p).columns()),
            np.array([turn.angle]),
            np.array((told.v - true.v).columns()),
            np.array([told.w - true.w]),
        ]
    return [
        np.array((told.p - true.p).columns()),
        2.0 * np.array([turn.x, turn.y, turn.z]),
        np.array((told.v - true.v).columns()),
        np.array((told.w - true.w).columns()),
    ]


@BOTH
def test_noise_is_normal_and_new_in_every_component_and_period(dimension):
    sizes = (0.02, 0.01, 0.03, 0.04)
    noisy = Conditions(sensors=sensors("noise", sizes))
    world, own, now = begun(noisy, dimension)
    first = errors(world, own, now)
    second = errors(world, own, replace(now, clock=now.clock + 1))
    for size, a, b in zip(sizes, first, second, strict=True):
        for x in (*a, *b):
            assert stats.kstest(x / size, "norm").pvalue > LIKELY
    assert np.array_equal(errors(world, own, now)[0], first[0]), "a moment is told once"
    # No quantity repeats the noise of another, in this period or the next.
    everything = np.concatenate([*first, *second])
    both = np.abs(np.corrcoef(everything) - np.eye(len(everything)))
    assert both.max() < 5 / math.sqrt(COUNT)


def test_attitudes_err_about_the_axes_of_the_body():
    """R_told = R_true exp(error): a bias as it was drawn, and noise as that of a craft that is upright."""

    def rotations(attitude):
        parts = np.broadcast_arrays(attitude.x, attitude.y, attitude.z, attitude.w)
        return Rotation.from_quat(np.stack(parts, axis=1))

    for what in ("bias", "noise"):
        world, own, now = begun(Conditions(sensors=sensors(what, (0.0, 0.3, 0.0, 0.0))), 3, 50)
        whole = np.ones(50)
        upright = Quat(whole, 0.0 * whole, 0.0 * whole, 0.0 * whole)
        level = replace(now, state=replace(now.state, attitude=upright))
        error = rotations(world.sensed(level, own).attitude)
        if what == "bias":
            drawn = now.parameters.sensors.bias[1]  # type: ignore[index, union-attr]
            expected = np.stack(drawn.columns(), axis=1)
            np.testing.assert_allclose(error.as_rotvec(), expected, rtol=0, atol=1e-12)
        told = rotations(world.sensed(now, own).attitude)
        true = rotations(now.state.attitude)
        # Rounding; in W the error would be turned by the attitude, some 0.3 rad away.
        np.testing.assert_allclose((told.inv() * true * error).magnitude(), 0.0, atol=1e-12)


@BOTH
def test_a_bias_is_the_same_in_every_period(dimension):
    sizes = (0.1, 0.02, 0.2, 0.3)
    world, own, now = begun(Conditions(sensors=sensors("bias", sizes)), dimension, 20)
    first = errors(world, own, now)
    for _ in range(3):
        now = step(world, now, tuple(np.ones((len(world.craft.thrusters), 20))), own).episode
    for size, a, b in zip(sizes, first, errors(world, own, now), strict=True):
        np.testing.assert_allclose(
            np.linalg.norm(a, axis=0), size, rtol=1e-4
        )  # 2 sin(0.01) is 0.02 - 3e-7
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-12)


@BOTH
def test_all_readings_stand_while_sensors_have_stopped(dimension):
    """For 1.25 s in every 5 s, from another moment on in every episode; in between they are of this period."""
    noise = sensors("noise", (0.02, 0.01, 0.03, 0.04))
    stopping = replace(noise, outage=1.25)
    world, own, now = begun(Conditions(sensors=stopping), dimension, 200)
    world = replace(world, setup=world.setup._replace(timing=Timing(control_period=0.25)))
    before = world.sensed(now, own)
    stopped = []
    for _ in range(40):
        now = step(world, now, tuple(np.ones((len(world.craft.thrusters), 200))), own).episode
        told = world.sensed(now, own)
        same = [np.asarray(a == b) for a, b in zip(leaves(told), leaves(before), strict=True)]
        assert all(np.array_equal(one, same[0]) for one in same), "all of them or none"
        new = ~same[0]
        assert np.abs(told.p.x - now.state.p.x)[new].max() < 0.12  # six standard deviations
        stopped.append(same[0])
        before = told
    gone = np.array(stopped)
    assert (gone[:20].sum(axis=0) == 5).all()
    assert np.array_equal(gone[:20], gone[20:])
    begins = np.argmax(gone[:20] & ~np.roll(gone[:20], 1, axis=0), axis=0)
    assert stats.chisquare(np.bincount(begins, minlength=20)).pvalue > LIKELY


@BOTH
def test_late_readings_are_states_of_so_many_periods_ago(dimension):
    world, own, now = begun(Conditions(sensors=SensorsConditions(delay=(0.0, 3.0))), dimension, 40)
    delay = np.asarray(now.parameters.sensors.delay)  # type: ignore[union-attr]
    assert sorted(set(delay)) == [0.0, 1.0, 2.0, 3.0]
    track = [np.array(leaves(now.state))]
    for k in range(8):
        told = np.array(leaves(world.sensed(now, own)))
        for n in range(40):
            assert np.array_equal(told[:, n], track[max(k - int(delay[n]), 0)][:, n])
        now = step(world, now, tuple(np.ones((len(world.craft.thrusters), 40))), own).episode
        track.append(np.array(leaves(now.state)))


def test_where_a_reading_drops_out_the_last_one_stands():
    lost = Conditions(
        sensors=SensorsConditions(
            position=SensorConditions(noise=0.01, dropout=0.3),
            attitude=SensorConditions(noise=0.01),
        )
    )
    world, own, now = begun(lost)
    before = world.sensed(now, own)
    repeated = []
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
