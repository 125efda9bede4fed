"""What a sloshing liquid refuses: bodies, conditions, drifts and control periods."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.extend import Body, ConfigError, Drift, Spacecraft, bounds, largest
from rans.model.body import numbers
from rans_missions.slosh.swinging import DECAY, MOST_STEPS, STEP, paces

if TYPE_CHECKING:
    from rans_missions.slosh.liquid import Slosh

MOST = 1.0 - 1e-3
"""Largest fraction of a mass or an inertia that the liquid may have."""
_STABLE = 2.5
"""Longest step times the rate at which friction stops the rod under conditions, whose steps are those of the
designed craft; the method is stable up to 2.78."""


def check_body(slosh: Slosh, craft: Spacecraft, body: Body) -> None:
    """Refuse bodies that leave no rigid craft around the liquid.

    Args:
        slosh: of the craft.
        craft: as designed.
        body: of numbers, or of arrays or tensors (N,).

    Raises:
        ConfigError: the liquid at rest has all of the inertia.
    """
    # As in the check of the spacecraft, with what each body has of mass, inertia and centre of mass.
    mass = numbers(body.mass)
    fraction = slosh.mass / craft.mass
    offsets = body.centre or (0.0,) * craft.dimension
    away = [
        point - centre - numbers(offset)
        for point, centre, offset in zip(
            slosh.point(), craft.centre_of_mass, (*offsets, 0.0)[:3], strict=True
        )
    ]
    adds = fraction * mass * sum(x**2 for x in away) / (1.0 - fraction)
    tensor = np.stack(np.broadcast_arrays(*(numbers(x) for x in body.inertia)), axis=-1)
    moment = tensor[..., 0]
    if craft.dimension == 3:
        moments = np.linalg.eigvalsh(tensor[..., ((0, 1, 2), (1, 3, 4), (2, 4, 5))])
        moment = 0.5 * moments.sum(axis=-1) - moments[..., -1]
    adds, moment = np.broadcast_arrays(adds, moment)
    # What the liquid at rest adds must leave an inertia above 0.
    wrong = np.atleast_1d(adds > moment * MOST)
    if wrong.any():
        first = np.flatnonzero(wrong)[0]
        raise ConfigError(
            f"the body leaves no inertia to {craft.name!r} without its sloshing liquid: at rest that adds "
            f"{np.atleast_1d(adds)[first]:.4g} kg m^2 of {np.atleast_1d(moment)[first]:.4g} kg m^2. Give it less "
            "mass, or more inertia."
        )


def check_conditions(slosh: Slosh, craft: Spacecraft, conditions: Any) -> None:
    """Refuse (`ConfigError`) masses, inertias and centres of mass that leave no rigid craft around the liquid."""
    for body in extreme_bodies(slosh, craft, conditions):
        try:
            check_body(slosh, craft, body)
        except ConfigError as error:
            raise ConfigError(f"Conditions: {error} Or narrow their ranges.") from None


def extreme_bodies(slosh: Slosh, craft: Spacecraft, conditions: Any) -> list[Body]:
    """Bodies that leave least of a rigid craft, or for which friction may stop the rod fastest.

    Those have the least inertia and the extremes of the masses. The centre of mass is as designed, or as far as can
    be from the mass at rest.
    """
    size = craft.dimension
    away = np.subtract(craft.centre_of_mass, slosh.point())[:size]
    distance = float(np.linalg.norm(away))
    away = away / distance if distance > 0.0 else np.eye(size)[0]
    designed = Body.of(craft)
    bodies = []
    for part in (conditions, *conditions.others):
        body = part.body
        least = bounds(body.inertia)[0]
        for mass, shift in product(bounds(body.mass), (0.0, largest(body.centre))):
            bodies.append(
                replace(
                    designed,
                    mass=mass * craft.mass,
                    inertia=tuple(least * x for x in designed.inertia),
                    centre=tuple((shift * away).tolist()),
                )
            )
    return bodies


def check_flight(
    slosh: Slosh, craft: Spacecraft, drift: Drift, period: float, conditions: Any
) -> None:
    """Refuse drifts, control periods and conditions for which the motion of a pendulum is not computed.

    Args:
        slosh: of the craft.
        craft: as designed.
        drift: motion of a free point.
        period: control period, s.
        conditions: conditions; None: nominal.

    Raises:
        ConfigError: an orbit pulls, or friction stops the rod too fast for the control period.
    """
    if not drift.in_straight_lines:
        raise ConfigError(
            f"spacecraft {craft.name!r} has [slosh], which is computed in free flight and uniform gravity only, "
            f"and the task's drift is {drift.name}: take [slosh] out of its file for missions on an orbit."
        )
    pace, decay = paces(slosh, craft)
    if period * decay / DECAY > MOST_STEPS:
        limit = slosh.damping * MOST_STEPS * DECAY / (period * decay)
        raise ConfigError(
            f"spacecraft {craft.name!r}: slosh damping must be at most {limit:.3g} N m s at a control period of "
            f"{period:g} s, got {slosh.damping:g}: the rod would stop within {1 / decay:.2g} s. The usual cause is "
            "a damping ratio in its place."
        )
    # The longest steps that pieces of a period may have: those of the designed craft.
    step = min(period, STEP / pace, DECAY / decay if decay > 0.0 else math.inf)
    step = max(step, period / MOST_STEPS)
    # The steps are those of the designed craft; conditions may need shorter ones.
    bodies = []
    if conditions is not None:
        check_conditions(slosh, craft, conditions)
        bodies = extreme_bodies(slosh, craft, conditions)
    fastest = max((paces(slosh, craft, body)[1] for body in bodies), default=0.0)
    if step * fastest > _STABLE:
        raise ConfigError(
            f"Conditions of body.mass, body.inertia and body.centre stop the rod of {craft.name!r} within "
            f"{1 / fastest:.2g} s, too fast for steps of {step:.2g} s: narrow the ranges, or lower the damping in "
            "the spacecraft's file."
        )
