"""Allocation against SciPy's non-negative least squares; rounding keeps the impulse."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import nnls

from rans import ConfigError, Spacecraft
from rans.control.allocation import Allocation, Rounding
from rans.model.actuators import Pulsed, Throttle
from rans.model.dynamics import thrust
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import nasty_planar, nasty_spatial

CRAFTS = [
    load_spacecraft("floating-platform"),
    load_spacecraft("free-flyer"),
    nasty_planar(),
    nasty_spatial(),
]
by_name = pytest.mark.parametrize("craft", CRAFTS, ids=lambda craft: craft.name)


def wrenches(craft: Spacecraft, size: float, count: int) -> np.ndarray:
    """Random wrenches of a share of what the strongest thruster gives, (count, 3 or 6)."""
    columns = np.array(craft.wrench_map).T
    generator = np.random.default_rng(11)
    return size * generator.uniform(-1, 1, (count, len(columns))) * np.abs(columns).max(axis=1)


@by_name
def test_commands_are_the_smallest(craft):
    """Least squares with a price of 1e-4 on the commands finds the smallest to about 1e-4 of it."""
    columns = np.array(craft.wrench_map).T
    size = np.abs(columns).max(axis=1, keepdims=True)
    priced = np.vstack([columns / size, 1e-4 * np.eye(columns.shape[1])])
    allocation = Allocation(craft)
    for wanted in wrenches(craft, 0.01, 20):
        best, _ = nnls(priced, np.append(wanted / size.T, np.zeros(columns.shape[1])))
        found = allocation.commands(wanted[None])[0]
        assert np.linalg.norm(found) <= np.linalg.norm(best) * (1 + 1e-4)
        np.testing.assert_allclose(found, best, atol=1e-3 * float(np.linalg.norm(best)))


@by_name
@pytest.mark.parametrize("sharing", ["none", "split"])
def test_out_of_reach_keeps_the_direction(craft, sharing):
    allocation = Allocation(replace(craft, thrust_sharing=sharing))  # type: ignore[arg-type]
    wanted = wrenches(craft, 50.0, 50)
    command = allocation.commands(wanted)
    load = command.max(axis=1) if sharing == "none" else command.sum(axis=1)
    np.testing.assert_allclose(load, 1.0, atol=1e-12)
    given_ = command @ np.array(craft.wrench_map)
    # Newton's 1e-9 of 50 thrusters' wrenches
    np.testing.assert_allclose(given_ * allocation.load(wanted)[:, None], wanted, atol=1e-7)


def test_uncontrollable_spacecraft_is_refused():
    platform = load_spacecraft("floating-platform")
    with pytest.warns(UserWarning, match="cannot push and turn"):
        lame = Spacecraft("lame", 2, platform.mass, platform.inertia, platform.thrusters[:2])
    with pytest.raises(ConfigError, match="'lame' cannot be steered: its 2 thrusters"):
        Allocation(lame)


def test_a_thruster_in_other_units_is_refused_by_name():
    """The other seven steer; with it their wrenches are lost to rounding. At 1e5 N there is enough left."""
    platform = load_spacecraft("floating-platform")
    first, *others = platform.thrusters
    odd = replace(platform, thrusters=(replace(first, force=1e9), *others))
    with pytest.raises(
        ConfigError, match=r"'floating-platform' cannot be steered.* force in other units"
    ):
        Allocation(odd)
    force, torque = Allocation(
        replace(odd, thrusters=(replace(first, force=1e5), *others))
    ).authority()
    assert force > 0
    assert torque > 0


@by_name
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1), load=st.floats(0.0, 1.0))
def test_rounding_keeps_the_impulse(craft, seed, load):
    """However long it runs, what is given differs from what was wanted by a few pulses.

    Rounding that forgets would be wrong by up to half a pulse per thruster and period: by tens to
    hundreds of pulses after these 200 periods of constant commands; 2.6 were seen at worst in 2,000.
    """
    columns = np.array(craft.wrench_map)
    command = load * np.random.default_rng(seed).uniform(0, 1, (3, len(columns)))
    modulator = Rounding(craft, 0.2)
    modulator.reset(3)
    pulses = np.stack([modulator.round(command @ columns) for _ in range(200)])
    assert set(np.unique(pulses)) <= {0.0, 1.0}
    owed = np.cumsum((command - pulses) @ columns, axis=0)
    assert (np.abs(owed) <= 4.0 * np.abs(columns).max(axis=0)).all()


def test_shared_thrust_opens_pairs_that_do_not_turn():
    """1 N along a diagonal: two nozzles on opposite sides share it, and their torques cancel."""
    craft = replace(CRAFTS[0], thrust_sharing="split")
    modulator = Rounding(craft, 0.2)
    modulator.reset(1)
    side = math.sqrt(0.5)
    pulse = modulator.round(np.array([[side, -side, 0.0]]))[0]
    opened = np.array(craft.wrench_map)[pulse > 0]
    assert len(opened) == 2
    np.testing.assert_allclose(opened.mean(axis=0), [side, -side, 0.0], atol=1e-9)
    assert not modulator.round(np.zeros((1, 3))).any()  # nothing is left to pay


@by_name
@pytest.mark.parametrize("sharing", ["none", "split"])
def test_no_change_of_two_thrusters_would_be_closer(craft, sharing):
    """Measured with the engines' own thrust sharing and kinetic energy, one pattern at a time."""
    craft = replace(craft, thrust_sharing=sharing)  # type: ignore[arg-type]
    wanted = wrenches(craft, 0.3, 5)
    modulator = Rounding(craft, 0.2)
    modulator.reset(5)
    inertia = np.array(craft.inertia)[-1:, -1:] if craft.dimension == 2 else np.array(craft.inertia)
    reachable = wanted / np.maximum(Allocation(craft).load(wanted), 1.0)[:, None]

    def energy(pulse, aim):
        given_ = np.array(thrust(craft, tuple(pulse))) @ np.array(craft.wrench_map)
        force, torque = np.split(aim - given_, [craft.dimension])
        return float(force @ force / craft.mass + torque @ np.linalg.solve(inertia, torque))

    for pulse, aim in zip(modulator.round(wanted), reachable, strict=True):
        least = energy(pulse, aim)
        for flips in (*combinations(range(len(pulse)), 1), *combinations(range(len(pulse)), 2)):
            other = pulse.copy()
            other[list(flips)] = 1.0 - other[list(flips)]
            assert energy(other, aim) >= least - 1e-9


@pytest.mark.parametrize("craft", CRAFTS[:2], ids=lambda craft: craft.name)
def test_no_two_open_thrusters_cancel(craft):
    """Both crafts are made of opposed pairs, so patterns tie; impulse that does nothing must not be spent."""
    modulator = Rounding(craft, 0.2)
    modulator.reset(64)
    columns = np.array(craft.wrench_map)
    pairs = combinations(range(len(columns)), 2)
    opposed = [(i, j) for i, j in pairs if np.allclose(columns[i] + columns[j], 0.0, atol=1e-12)]
    assert len(opposed) == len(columns) // 2
    for wanted in np.split(wrenches(craft, 1.5, 64 * 20), 20):
        opened = modulator.round(wanted)
        for i, j in opposed:
            assert not (opened[:, i] * opened[:, j]).any()


def test_rest_opens_nothing_and_forgets():
    craft = CRAFTS[0]
    modulator = Rounding(CRAFTS[0], 0.2)
    modulator.reset(2)
    wanted = np.repeat(0.5 * np.array(craft.wrench_map)[2:3], 2, axis=0)
    modulator.round(wanted)
    pulses = [modulator.round(wanted, np.array([True, False]))[:, 2], modulator.round(wanted)[:, 2]]
    assert np.array_equal(pulses, [[0.0, 1.0], [0.0, 0.0]])


def forgetful():
    """A craft, and the rounding of its commands that carries nothing."""
    modulator = Rounding(CRAFTS[0], 0.2, np.zeros(3, bool))
    modulator.reset(1)
    return CRAFTS[0], modulator


def test_what_is_not_carried_is_forgotten_within_reach_only():
    """Half a nozzle's thrust opens nothing; more than there is opens in its direction on average."""
    craft, modulator = forgetful()
    small = 0.4 * np.array(craft.wrench_map)[2:3]
    assert not any(modulator.round(small).any() for _ in range(20))
    wanted = np.array([[30.0, 10.0, 0.0]])
    total = sum(modulator.round(wanted) @ np.array(craft.wrench_map) for _ in range(100))
    cosine = (total @ wanted.T).item() / np.linalg.norm(total) / np.linalg.norm(wanted)
    assert cosine > 0.999  # 100 pulses, off by a few


def test_what_saturates_is_carried_whatever_else_is_not():
    """1.5 times what there is, in a direction that no pattern has: the impulse of all there is, to 2 pulses.
    Forgetting would repeat one pattern and be off by its error a hundred times."""
    craft, modulator = forgetful()
    wanted = np.array([[1.0, 0.3, 0.0]])
    wanted *= 1.5 / Allocation(craft).load(wanted)[0]
    given_ = sum(modulator.round(wanted) @ np.array(craft.wrench_map) for _ in range(100))
    assert np.abs(given_ - 100 * wanted / 1.5)[0, :2].max() < 2.0


@pytest.mark.parametrize("craft", [nasty_planar(), nasty_spatial()], ids=lambda craft: craft.name)
def test_authority_is_there_in_both_senses(craft):
    """Along the weakest axis and sense it is all there is; along no other more is asked for than there is."""
    allocation = Allocation(craft)
    size = craft.degrees_of_freedom
    for reach, axes in zip(
        allocation.authority(), (range(craft.dimension), range(craft.dimension, size)), strict=True
    ):
        wrenches = np.array(
            [sense * reach * np.eye(size)[axis] for axis in axes for sense in (1.0, -1.0)]
        )
        loads = allocation.load(wrenches)
        assert loads.max() == pytest.approx(
            1.0, rel=1e-6
        )  # the allocation is exact to 1e-9 of a wrench
        assert loads.min() < 0.99  # they differ, so that the weakest shows


def test_throttled_thrusters_give_the_wanted_wrench_and_owe_nothing():
    craft = replace(CRAFTS[0], actuators=Throttle())
    proportional = Rounding(craft, 0.2)
    proportional.reset(3)
    wanted = np.array([[0.3, -0.2, 0.05], [0.0, 0.0, 0.0], [50.0, 0.0, 0.0]])
    for _ in range(3):
        commands = proportional.round(wanted, np.array([False, False, False]))
        given = commands @ np.array(craft.wrench_map)
        np.testing.assert_allclose(given[:2], wanted[:2], atol=1e-9)
        # More than there is becomes as much as there is, and is not owed afterwards.
        assert commands[2].max() == pytest.approx(1.0)
    assert not proportional.round(wanted, np.array([True] * 3)).any()


def test_what_pulses_round_off_is_given_later():
    """Of pulses in tenths of a period, of two at least, a force of 0.05 N needs one in some periods only: its
    mean over 200 periods is off by less than a pulse."""
    craft = replace(CRAFTS[0], actuators=Pulsed(10, 2))
    pulsed = Rounding(craft, 0.2)
    pulsed.reset(1)
    wanted = np.array([[0.05, 0.02, 0.0]])
    total = np.zeros(3)
    for _ in range(200):
        [command] = pulsed.round(wanted)
        counts = np.floor(command * 10 + 0.5)
        total += np.where(counts < 2, 0.0, counts / 10) @ np.array(craft.wrench_map)
    np.testing.assert_allclose(total / 200, wanted[0], atol=1.0 / 200)
