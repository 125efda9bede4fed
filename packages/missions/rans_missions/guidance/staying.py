"""The law with which a craft stays at its goal in a drift, however long."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

from rans.extend import ClohessyWiltshire, Drift, Field, at_least, map_leaves, where, within
from rans_missions.orbits.elliptic import EllipticOrbit
from rans_missions.orbits.perturbed import PerturbedOrbit
from rans_missions.orbits.reach import velocity_to_reach

_COASTING_PART = 0.8
"""Part of both tolerances within which a craft coasts on: the rest is for what no coast foresees."""
_RETURN_TIME = 15.0
"""Time of a return to the goal, in those that the position tolerance takes at the speed tolerance. A faster return
costs more, and leaves less of the speed tolerance for errors."""
_RETURN_ANGLE = 0.5 * math.pi
"""Largest angle by which an orbit turns in a return, rad: in half a turn no velocity leads across the orbit."""
_RETURN_PERIODS = 10.0
"""Least time of a return, in control periods: burns last for one and displace a craft by a twentieth of the way."""
_STOP_DISTANCE = 0.2
"""Part of the position tolerance within which a return ends: twice the way of a period at least."""
_STOP_SPEED = 0.4
"""Least speed of a return that ends near the goal, in position tolerances over its time: half of its
speed at the end."""
_AWAY_PART = 0.5
"""Part of the position tolerance by which an equilibrium is away from the goal along an axis at most."""


def staying_velocity(
    drift: Drift,
    state: Any,
    goal: Any,
    period: float,
    position_tolerance: Field,
    velocity_tolerance: float,
    acceleration: Any = None,
) -> Any:
    """Velocity in W, m/s, with which a craft that has arrived stays at a goal where nothing pulls it away.

    It is the craft's own while a coast of one control period keeps within 0.8 of both tolerances. Elsewhere it
    is that of a coast to the goal, at about a fifteenth of the velocity tolerance from the edge of the position
    tolerance, in ten control periods at least and a quarter of an orbit at most. Near the goal the return ends: on
    a circular orbit with a velocity from which the craft circles around the goal and does not drift away,
    elsewhere at a low speed.

    On a circular orbit an acceleration a moves the equilibrium of Clohessy and Wiltshire (1960): radially by
    -a_x / (3 n^2), and across the orbit by a_z / n^2. The craft stays there, at most at half of the position
    tolerance along each axis, and within the tolerance that is left. Thrust balances what is left of the
    acceleration. Along the orbit, where no point is an equilibrium, that is all of it: no flight that stays needs
    less in the mean.

    Args:
        drift: motion of a free point without the acceleration.
        state: state, with a position and a velocity in W.
        goal: goal, with a position and a velocity in W.
        period: control period, s.
        position_tolerance: distance within which it stays, m.
        velocity_tolerance: speed within which it stays, m/s.
        acceleration: constant acceleration in W, m/s^2; None: none.
    """
    is_circular = isinstance(drift, ClohessyWiltshire | PerturbedOrbit)
    if acceleration is not None:
        # The acceleration moves the point of balance; thrust takes the rest.
        away = goal.p.scale(0.0)
        if is_circular:
            a_x, a_y, *aside = acceleration.columns()
            radial, across = -3.0 * drift.mean_motion**2, drift.mean_motion**2
            most = position_tolerance * _AWAY_PART
            x = within(a_x * (1.0 / radial), -most, most)
            side = [within(a_z * (1.0 / across), -most, most) for a_z in aside]
            away = type(goal.p)(x, 0.0 * x, *side)
            rest = (a_z - across * z for a_z, z in zip(aside, side, strict=True))
            acceleration = type(goal.p)(a_x - radial * x, a_y, *rest)
        moved = replace(state, p=state.p - away)
        left = position_tolerance - away.norm()
        velocity = staying_velocity(drift, moved, goal, period, left, velocity_tolerance)
        return velocity - acceleration.scale(period)
    time = position_tolerance * (_RETURN_TIME / velocity_tolerance)
    if is_circular or isinstance(drift, EllipticOrbit):
        time = within(time, 0.0, _RETURN_ANGLE / drift.mean_motion)
    time = at_least(time, _RETURN_PERIODS * period)
    distance, speed = (goal.p - state.p).norm(), (goal.v - state.v).norm()
    # Coast while that stays well inside, else return.
    coasts = (distance > position_tolerance * _STOP_DISTANCE) | (
        speed < position_tolerance * _STOP_SPEED / time
    )
    for after in (0.0, 0.5 * period, period):
        p, v = drift.carry(state.p, state.v, after)
        near = (goal.p - p).norm() < position_tolerance * _COASTING_PART
        slow = (goal.v - v).norm() < velocity_tolerance * _COASTING_PART
        coasts = coasts & near & slow
    back = velocity_to_reach(drift, state.p, goal.p, time + distance * 0.0)
    if is_circular:
        returned = distance < position_tolerance * _STOP_DISTANCE
        around = goal.v + circling(drift.mean_motion, state.p - goal.p)
        back = map_leaves(partial(where, returned), around, back)
    return map_leaves(partial(where, coasts), state.v, back)


def circling(mean_motion: float, p: Any) -> Any:
    """Velocity, m/s, with which a point at p from an equilibrium (Clohessy-Wiltshire) circles around it.

    The point moves on an ellipse, whose centre is the equilibrium and which is twice as long along the orbit as
    radially. In the closed solution of Clohessy and Wiltshire (1960) it does not drift if v_y = -2 n x, and the
    centre is at y - 2 v_x / n. Fields in W.
    """
    x, y, *aside = p.columns()
    return type(p)(0.5 * mean_motion * y, -2.0 * mean_motion * x, *(0.0 * z for z in aside))
