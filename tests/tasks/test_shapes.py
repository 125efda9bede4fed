"""Shapes: margins worked out by hand, in every library, and what must not change when all is moved."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest
import torch

from rans.model.fields import Vec2, Vec3
from rans.model.trace import Symbol
from rans.tasks.shapes import Ball, Cone, GlideSlope, Shape, SpeedLimit, nearest_first
from tests.support.states import planar

STILL = Vec2(0.0, 0.0)
THIRTY = math.radians(30.0)
ROUNDING = 1e-8
"""The softening of lengths makes those at zero 1e-9."""

CASES: list[tuple[Shape, tuple[float, ...], float]] = [
    # A 3-4-5 triangle from (1, 1) less the radius; the centre lies a radius deep.
    (Ball(Vec2(1.0, 1.0), STILL, 2.0), (4.0, 5.0), 3.0),
    (Ball(Vec2(1.0, 1.0), STILL, 2.0), (1.0, 1.0), -2.0),
    # From (1, 0, -1) it is 2, 3 and 6 away: 7 in all.
    (Ball(Vec3(1.0, 0.0, -1.0), Vec3(0.0, 0.0, 0.0), 0.5), (3.0, 3.0, 5.0), 6.5),
    # On the axis 0.4 from the apex the surface is 0.4 sin 30 degrees away; across from the apex it is cos 30.
    (Cone(STILL, Vec2(1.0, 0.0), THIRTY, 1.0), (0.4, 0.0), 0.2),
    (Cone(STILL, Vec2(1.0, 0.0), THIRTY, 1.0), (0.0, 0.2), -0.2 * math.sqrt(0.75)),
    # Behind the apex, and beyond the length, where everything is allowed, by 1 m.
    (Cone(STILL, Vec2(1.0, 0.0), THIRTY, 1.0), (-0.5, 0.0), -0.25),
    (Cone(STILL, Vec2(1.0, 0.0), THIRTY, 1.0), (0.0, -2.0), 1.0),
    (Cone(Vec3(0.0, 0.0, 1.0), Vec3(0.0, 0.0, 1.0), THIRTY, 2.0), (0.0, 0.0, 1.8), 0.4),
    # A slope of 45 degrees: 1 m up and 0.5 m aside is 0.5 / sqrt(2) inside, the reverse so much outside.
    (GlideSlope(STILL, Vec2(0.0, 1.0), math.pi / 4), (0.5, 1.0), 0.5 / math.sqrt(2.0)),
    (GlideSlope(STILL, Vec2(0.0, 1.0), math.pi / 4), (-1.0, 0.5), -0.5 / math.sqrt(2.0)),
]


@pytest.mark.parametrize(("shape", "point", "expected"), CASES)
def test_margins_by_hand_in_every_library(shape, point, expected):
    kind = Vec2 if len(point) == 2 else Vec3
    assert shape.gap(kind(*point)) == pytest.approx(expected, abs=ROUNDING)
    many = shape.gap(kind(*(np.full(3, x) for x in point)))
    np.testing.assert_allclose(many, expected, rtol=0, atol=ROUNDING)
    tensors = shape.gap(kind(*(torch.full((3,), x) for x in point)))
    # Single precision of numbers below 8.
    np.testing.assert_allclose(tensors.numpy(), expected, rtol=0, atol=1e-6)
    symbols = casadi.SX.sym("p", len(point))
    function = casadi.Function("gap", [symbols], [shape.gap(kind(*casadi.vertsplit(symbols)))])
    assert float(function(point)) == pytest.approx(expected, abs=ROUNDING)
    assert isinstance(shape.gap(kind(*(Symbol.input(f"x{k}") for k in range(len(point))))), Symbol)


def test_speed_limits_by_hand():
    """0.2 m/s at the point and 0.1 / s: 5 m away 0.7 m/s are allowed, and 0.5 m/s flown."""
    limit = SpeedLimit(Vec2(1.0, 1.0), 0.2, 0.1)
    assert limit.gap(Vec2(4.0, 5.0), Vec2(0.3, -0.4)) == pytest.approx(0.2, abs=ROUNDING)
    assert limit.gap(Vec2(1.0, 1.0), Vec2(0.3, -0.4)) == pytest.approx(-0.3, abs=ROUNDING)
    with pytest.raises(ValueError, match="needs a velocity"):
        limit.gap(Vec2(4.0, 5.0))
    state = planar(4.0, 5.0, v=(0.3, -0.4))
    (entry,) = limit.entries("limit", state)
    assert (entry.unit, entry.columns()[0]) == ("m/s", pytest.approx(0.2, abs=ROUNDING))


def test_balls_move():
    ball = Ball(Vec2(1.0, 1.0), Vec2(0.5, -1.0), 2.0).later(4.0)
    assert (ball.centre.x, ball.centre.y, ball.radius) == (3.0, -3.0, 2.0)
    assert ball.later(-4.0).centre == Vec2(1.0, 1.0)
    cone = CASES[3][0]
    assert cone.later(9.0) is cone


def test_what_is_observed_of_a_ball():
    """Way to the centre, relative velocity and margin; their targets are themselves, wherever one is."""
    ball = Ball(Vec2(4.0, 5.0), Vec2(0.5, -1.0), 2.0)
    state = planar(1.0, 1.0, v=(1.0, 1.0))
    entries = ball.entries("zone", state)
    found = [x for entry in entries for x in entry.columns()]
    assert found == pytest.approx([3.0, 4.0, -0.5, -2.0, 3.0])
    assert [row.name for entry in entries for row in entry.table()] == [
        "zone dx",
        "zone dy",
        "zone dv_x",
        "zone dv_y",
        "zone gap",
    ]
    assert [x for entry in entries for x in entry.target()] == found


def test_the_nearest_first_keeps_shared_numbers():
    """A radius that all zones share is a number, and stays one."""
    zones = [Ball(Vec2(np.array([x]), np.array([0.0])), STILL, 0.3) for x in (3.0, 2.0, 1.0)]
    near, *others = nearest_first(zones, Vec2(0.0, 0.0))
    assert [float(one.centre.x[0]) for one in (near, *others)] == [1.0, 2.0, 3.0]
    assert near.radius == 0.3
    assert isinstance(near.radius, float)
