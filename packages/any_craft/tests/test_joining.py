"""Two joined spacecraft: numbers by hand, and what does not depend on how they are described."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rans_any_craft.joining import join_spacecraft
from scipy.spatial.transform import Rotation

from rans import Spacecraft
from rans.model.actuators import Wheel
from rans.model.spacecraft_file import load_spacecraft


def joined(*args, **named):
    return join_spacecraft(*args, **named).spacecraft


def box(name: str, sides: tuple[float, float, float], density: float = 100.0) -> Spacecraft:
    """A uniform box about the origin of G, with the thrusters of the free flyer."""
    x, y, z = sides
    mass = density * x * y * z
    moments = (y * y + z * z, z * z + x * x, x * x + y * y)
    inertia = tuple(
        tuple(mass * moment / 12.0 * (k == n) for n in range(3)) for k, moment in enumerate(moments)
    )
    base = load_spacecraft("free-flyer")
    return replace(base, name=name, mass=mass, inertia=inertia, centre_of_mass=(0.0, 0.0, 0.0))  # pyrefly: ignore[bad-argument-type]


def test_two_boxes_end_to_end_are_the_longer_box():
    """Boxes of 0.4 m and 0.6 m along x make one of 1 m, whose centre is 0.3 m from that of the first."""
    both = joined(box("a", (0.4, 0.2, 0.3)), box("b", (0.6, 0.2, 0.3)), (0.5, 0.0, 0.0))
    whole = box("whole", (1.0, 0.2, 0.3))
    assert both.mass == pytest.approx(whole.mass)
    np.testing.assert_allclose(both.inertia, whole.inertia, atol=1e-12)
    np.testing.assert_allclose(both.centre_of_mass, (0.3, 0.0, 0.0), atol=1e-12)
    assert both.name == "a-b"
    assert both.thruster_count == 32


def test_thrusters_of_the_second_stand_where_they_are():
    """In the plane: one at (0.1, 0.2) along x, seen from a frame at (1, 0) that is turned by a quarter."""
    first = Spacecraft.planar("first", 10.0, 1.0, [((0.0, 0.0), (1.0, 0.0), 1.0), *RING])
    second = Spacecraft.planar("second", 30.0, 2.0, [((0.1, 0.2), (1.0, 0.0), 3.0), *RING])
    both = joined(first, second, (1.0, 0.0), math.pi / 2.0, name="pair")
    moved = both.thrusters[len(first.thrusters)]
    np.testing.assert_allclose(moved.position, (0.8, 0.1, 0.0), atol=1e-12)
    np.testing.assert_allclose(moved.direction, (0.0, 1.0, 0.0), atol=1e-12)
    assert (moved.force, moved.supply) == (3.0, 1)
    # Centre 0.75 m along x; 1 + 2 + 10 x 0.75^2 + 30 x 0.25^2 = 10.5 kg m^2.
    np.testing.assert_allclose(both.centre_of_mass, (0.75, 0.0, 0.0), atol=1e-12)
    assert both.inertia[2][2] == pytest.approx(10.5)
    passive = joined(first, second, (1.0, 0.0), effectors="first")
    assert passive.thrusters == first.thrusters
    assert passive.mass == 40.0


def test_wheels_that_are_left_out_are_locked():
    """Their moments about their axes, which the file leaves out, turn with the craft: 1 + 2 + 0.3 kg m^2."""
    first = Spacecraft.planar("first", 10.0, 1.0, RING)
    wheel = Wheel((0.0, 0.0, -1.0), 0.1, 0.5, 0.3)
    second = Spacecraft.planar("second", 30.0, 2.0, RING, wheels=(wheel,))
    locked = joined(first, second, (0.0, 0.0), effectors="first")
    assert locked.inertia[2][2] == pytest.approx(3.3)
    assert joined(first, second, (0.0, 0.0)).inertia[2][2] == pytest.approx(3.0)


RING: list[Any] = [
    ((x, y), (u, v), 1.0)
    for x, y, u, v in (
        (0.2, 0.1, -1.0, 0.0),
        (0.2, -0.1, -1.0, 0.0),
        (-0.2, 0.1, 1.0, 0.0),
        (-0.2, -0.1, 1.0, 0.0),
        (0.0, 0.2, 0.0, -1.0),
        (0.0, -0.2, 0.0, 1.0),
    )
]


def test_either_craft_may_come_first():
    """The twists of all thrusters, in the frame of the first, are the same up to their order and that frame."""
    spheres = load_spacecraft("spheres")
    other = replace(box("b", (0.2, 0.2, 0.3)), actuators=spheres.actuators)
    position, turn = np.array([0.3, 0.1, -0.2]), Rotation.from_euler("xyz", (0.3, -0.5, 1.1))
    one = joined(spheres, other, position.tolist(), turn.as_quat(scalar_first=True).tolist())
    back = turn.inv()
    two = joined(
        other, spheres, (-back.apply(position)).tolist(), back.as_quat(scalar_first=True).tolist()
    )
    forces, torques = np.split(np.array(one.wrench_map), 2, axis=1)
    turned = np.hstack([back.apply(forces), back.apply(torques)])
    order = [*range(16, 28), *range(16)]
    np.testing.assert_allclose(np.array(two.wrench_map)[order], turned, atol=1e-12)
