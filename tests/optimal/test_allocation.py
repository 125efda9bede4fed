"""Allocation against SciPy's non-negative least squares; rounding keeps the impulse."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from rans.errors import ConfigError
from rans.optimal.allocation import Allocation
from rans.optimal.rounding import SigmaDelta
from rans.spacecraft import Spacecraft
from rans.spacecraft_file import load_spacecraft
from tests.crafts import nasty_planar, nasty_spatial

CRAFTS = [load_spacecraft("floating-platform"), load_spacecraft("free-flyer"), nasty_planar(),
          nasty_spatial()]
by_name = pytest.mark.parametrize("craft", CRAFTS, ids=lambda craft: craft.name)


def wrenches(craft: Spacecraft, size: float, count: int) -> np.ndarray:
    """Random wrenches of a share of what the strongest thruster gives, (count, 3 or 6)."""
    columns = np.array(craft.wrench_map).T
    generator = np.random.default_rng(11)
    return size * generator.uniform(-1, 1, (count, len(columns))) * np.abs(columns).max(axis=1)


@by_name
def test_commands_give_the_wrench(craft: Spacecraft) -> None:
    wanted = wrenches(craft, 0.01, 200)  # small enough for every layout here to reach
    command = Allocation(craft).commands(wanted)
    assert command.min() >= 0
    assert command.max() < 1
    # Newton stops at 1e-9 of a thruster's wrench, of at most 1.9 N
    np.testing.assert_allclose(command @ np.array(craft.wrench_map), wanted, atol=2e-9)


@by_name
def test_commands_are_the_smallest(craft: Spacecraft) -> None:
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
def test_out_of_reach_keeps_the_direction(craft: Spacecraft, sharing: str) -> None:
    allocation = Allocation(replace(craft, thrust_sharing=sharing))  # type: ignore[arg-type]
    wanted = wrenches(craft, 50.0, 50)
    command = allocation.commands(wanted)
    load = command.max(axis=1) if sharing == "none" else command.sum(axis=1)
    np.testing.assert_allclose(load, 1.0, atol=1e-12)
    given_ = allocation.within_reach(wanted)
    cosine = (given_ * wanted).sum(1) / np.linalg.norm(given_, axis=1) / np.linalg.norm(wanted, axis=1)
    np.testing.assert_allclose(cosine, 1.0, atol=1e-8)  # the same 1e-9, relative


def test_pairs_by_hand() -> None:
    """1 N along body x: four nozzles at 45 degrees share it, and their opposites stay shut."""
    command = Allocation(CRAFTS[0]).commands(np.array([[1.0, 0.0, 0.0]]))[0]
    pushing = np.array(CRAFTS[0].wrench_map)[:, 0] > 0
    np.testing.assert_allclose(command, np.where(pushing, 0.25 / np.sqrt(0.5), 0.0), atol=1e-12)


def test_platform_authority_by_hand() -> None:
    """Four of the eight 1 N nozzles push along each body axis at 45 degrees, four turn it at 0.31 m."""
    platform = load_spacecraft("floating-platform")
    assert Allocation(platform).authority() == pytest.approx((4 * math.sqrt(0.5), 4 * 0.31), rel=1e-6)
    shared = replace(platform, thrust_sharing="split")
    assert Allocation(shared).authority() == pytest.approx((math.sqrt(0.5), 0.31), rel=1e-6)


def test_uncontrollable_spacecraft_is_refused() -> None:
    platform = load_spacecraft("floating-platform")
    with pytest.warns(UserWarning, match="cannot push and turn"):
        lame = Spacecraft("lame", 2, platform.mass, platform.inertia, platform.thrusters[:2])
    with pytest.raises(ConfigError, match="'lame' cannot be steered: its 2 thrusters"):
        Allocation(lame)


@by_name
@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), load=st.floats(0.0, 1.0))
def test_rounding_keeps_the_impulse(craft: Spacecraft, seed: int, load: float) -> None:
    """However long it runs, what is given differs from what was wanted by a few pulses.

    Rounding that forgets would be wrong by up to half a pulse per thruster and period: by tens to
    hundreds of pulses after these 200 periods of constant commands; 2.6 were seen at worst in 2,000.
    """
    columns = np.array(craft.wrench_map)
    command = load * np.random.default_rng(seed).uniform(0, 1, (3, len(columns)))
    modulator = SigmaDelta(craft)
    modulator.reset(3)
    pulses = np.stack([modulator.round(command @ columns) for _ in range(200)])
    assert set(np.unique(pulses)) <= {0.0, 1.0}
    owed = np.cumsum((command - pulses) @ columns, axis=0)
    assert (np.abs(owed) <= 4.0 * np.abs(columns).max(axis=0)).all()


def test_half_a_thruster_opens_every_other_period() -> None:
    craft = CRAFTS[0]
    modulator = SigmaDelta(craft)
    modulator.reset(1)
    wanted = 0.5 * np.array(craft.wrench_map)[2:3]
    pulses = np.concatenate([modulator.round(wanted) for _ in range(6)])
    expected = np.zeros((6, 8))
    expected[1::2, 2] = 1.0
    assert np.array_equal(pulses, expected)


def test_shared_thrust_opens_one_at_a_time() -> None:
    craft = replace(CRAFTS[0], thrust_sharing="split")
    modulator = SigmaDelta(craft)
    modulator.reset(20)
    for wanted in np.random.default_rng(2).uniform(-0.3, 0.3, (50, 20, 3)):
        assert modulator.round(wanted).sum(axis=1).max() <= 1.0


def test_reset_forgets() -> None:
    modulator, wanted = SigmaDelta(CRAFTS[0]), 0.5 * np.array(CRAFTS[0].wrench_map)[2:3]
    modulator.reset(1)
    modulator.round(wanted)
    modulator.reset(1)
    assert not modulator.round(wanted).any()
