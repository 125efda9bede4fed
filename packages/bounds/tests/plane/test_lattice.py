"""The lattice is the motion: indices, quanta and responses against the equations every engine shares."""

import dataclasses
import itertools
import math
import sys
import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rans_bounds.flight import state_after
from rans_bounds.goal_set import GoalSet, pulse
from rans_bounds.plane.dual import Relaxation
from rans_bounds.plane.lattice import Lattice

from rans import ConfigError, Thruster
from rans.model.actuators import Pulsed, Throttle
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from tests.support.states import planar
from tests.support.tiny_lattice import PERIOD, lopsided, through

PLATFORM = load_spacecraft("floating-platform")
numbers = st.floats(-2.0, 2.0, allow_subnormal=False)


def test_unequal_thrusters():
    lattice = Lattice(lopsided(), PERIOD)
    assert list(lattice.multiples) == [1, -1, 2, -1, 0]
    assert lattice.torque == pytest.approx(0.3)
    assert lattice.pulse is None
    assert lattice.next_fuel(0.01, {1}) == 0.01


def test_a_quantum_that_no_thruster_has():
    """Torques of 0.2, -0.3 and 0.5 N m are 2, -3 and 5 times 0.1."""
    arms = (0.2, -0.3, 0.5)
    nozzles = tuple(
        dataclasses.replace(t, position=(arm, 0.0, 0.0), direction=(0.0, 1.0, 0.0), force=1.0)
        for t, arm in zip(PLATFORM.thrusters, arms, strict=False)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they push in one direction only
        lattice = Lattice(dataclasses.replace(PLATFORM, thrusters=nozzles), PERIOD)
    assert list(lattice.multiples) == [2, -3, 5]
    assert lattice.torque == pytest.approx(0.1)
    assert lattice.quanta_per_fuel == pytest.approx(5 / PERIOD)
    assert list(lattice.torque_range) == list(range(-3, 8))
    assert lattice.drift(10) < 1e-12


@given(
    choices=st.lists(st.integers(0, 2**30), min_size=6, max_size=6), start=st.tuples(*[numbers] * 6)
)
def test_effects_are_the_motion(choices, start):
    craft = lopsided()
    lattice = Lattice(craft, PERIOD)
    path = np.array(choices) % len(lattice.patterns.torque)
    first = PlanarState(Vec2(*start[:2]), Heading(start[2]), Vec2(*start[3:5]), start[5])
    final = state_after(craft, first, lattice.patterns.commands[path], PERIOD)
    relaxation = Relaxation(lattice, first, final, GoalSet(), 6, None)
    speed, way = relaxation.effects(path, path)
    # the engines' six-node rule is good to 1e-9 of the thrust's effect at 2 rad a period
    assert complex(speed.sum()) + complex(*relaxation.miss[:2]) == pytest.approx(0, abs=1e-9)
    assert complex(way.sum()) + complex(*relaxation.miss[2:]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("fuel", "net", "expected"),
    [
        (0.0, {0}, 0.0),
        (0.01, {0}, 0.4),
        (0.4, {0}, 0.4),
        (0.401, {0}, 0.8),
        (4.0097, {0}, 4.4),
        (0.01, {1}, 0.2),
        (0.3, {-3}, 0.6),
        (0.61, {-3}, 1.0),
        (0.41, {0, 1}, 0.6),
        (0.41, {0, 2}, 0.8),
    ],
)
def test_fuel_comes_in_pulses(fuel, net, expected):
    assert Lattice(PLATFORM, 0.2).next_fuel(fuel, net) == pytest.approx(expected)


@pytest.mark.parametrize("actuators", [Pulsed(20), Throttle()], ids=str)
def test_who_may_open_for_a_part_of_a_period_has_no_lattice(actuators):
    """Half a pulse would be off it: neither a certificate nor rounding up to whole pulses holds for him."""
    craft = dataclasses.replace(PLATFORM, actuators=actuators)
    with pytest.raises(ConfigError, match=f"does not cover its {actuators.kind} actuators"):
        Lattice(craft, 0.2)
    assert pulse(PLATFORM, 0.2) == pytest.approx(0.2)
    assert pulse(craft, 0.2) is None


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_nozzles_along_lines_through_the_centre_have_one_spin(turn, scale):
    """Their torques of rounding, 1e-17 N m for 1 N, would be quanta of which others are 1e16 multiples."""
    centre = (0.1, 0.2, 0.0)
    slanted = [
        Thruster((0.1 + 0.3 * x, 0.2 + 0.3 * y, 0.0), (x, y, 0.0), scale)
        for x, y in ((math.cos(k + turn), math.sin(k + turn)) for k in range(5))
    ]
    craft = dataclasses.replace(PLATFORM, thrusters=tuple(slanted), centre_of_mass=centre)
    lattice = Lattice(craft, PERIOD)
    assert (lattice.multiples == 0).all()
    assert (lattice.patterns.torque == 0).all()
    rest = planar()
    assert lattice.net_spins(GoalSet(), rest, rest) == {0}
    with pytest.raises(ConfigError, match="misses by"):
        lattice.net_spins(GoalSet(spin=0.1), dataclasses.replace(rest, w=0.11), rest)


def test_spin_off_the_lattice():
    lattice = Lattice(PLATFORM, PERIOD)
    rest = planar()
    spinning = dataclasses.replace(rest, w=2.4 * lattice.spin)
    with pytest.raises(ConfigError, match=r"misses by 0\.121 rad/s"):
        lattice.net_spins(GoalSet(), spinning, rest)
    assert lattice.net_spins(GoalSet(spin=0.13), spinning, rest) == {-2}
    assert lattice.net_spins(GoalSet(spin=0.2), spinning, rest) == {-2, -3}


def test_missing_numba_is_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    for name in ("compiled", "plane.lattice_kernel"):
        monkeypatch.delitem(sys.modules, f"rans_bounds.{name}", raising=False)
        monkeypatch.delattr(f"rans_bounds.{name}", raising=False)
    rest = planar()
    with pytest.raises(ConfigError, match=r"pip install .*\[optimal\]"):
        Relaxation(Lattice(PLATFORM, PERIOD), rest, rest, GoalSet(), 3, None)


def test_in_whole_pulses_the_next_fuel_is_one_that_exists():
    """Two of the nozzles turn nothing: any number of pulses ends with any spin there is."""
    lattice = Lattice(through(), PERIOD)
    fuels = set()
    for choice in itertools.product(range(16), repeat=2):
        commands = np.array([[n >> i & 1 for i in range(4)] for n in choice])
        fuels.add((int((commands @ lattice.multiples).sum()), int(commands.sum())))
    for net, pulses in fuels:
        assert lattice.next_fuel((pulses - 0.5) * PERIOD, {net}) == pytest.approx(pulses * PERIOD)
        assert lattice.fuel_above((pulses - 1) * PERIOD, {net}) == pytest.approx(pulses * PERIOD)
