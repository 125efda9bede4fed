"""A craft with sloshing liquid, and its masses as a stranger would write them down."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import rans
from rans.model.spacecraft import Spacecraft

SLOSH = rans.Slosh(1.064, 0.06, (0.05, 0.03, 0.0), (-0.6, 0.8, 0.0), 0.002)
SLOSHING = replace(rans.load_spacecraft("floating-platform"), name="sloshing", slosh=SLOSH)
"""The floating platform, of whose mass 20 % swing."""


class Sums(NamedTuple):
    """Sums over the rigid part and the mass that swings, with fields of the states' shape."""

    momentum: np.ndarray
    """(2, ...), kg m/s."""
    angular: np.ndarray
    """About W's origin, N m s."""
    energy: np.ndarray
    """J."""


def sums(craft: Spacecraft, states: Any) -> Sums:
    """Momentum, angular momentum and energy from the positions and velocities of both masses.

    The rigid part's mass, centre and inertia are those that make up the craft's with the mass at rest.
    """
    slosh = craft.slosh
    assert slosh is not None
    centre = np.array(craft.centre_of_mass[:2])
    hinge = np.array(slosh.hinge[:2]) - centre
    toward = np.arctan2(slosh.direction[1], slosh.direction[0])
    rest = hinge + slosh.length * np.array(slosh.direction[:2])
    rigid = craft.mass - slosh.mass
    offset = -slosh.mass / rigid * rest
    inertia = craft.inertia[2][2] - slosh.mass * rest @ rest - rigid * offset @ offset
    theta = np.asarray(states.attitude.angle)
    spin = np.asarray(states.w)
    angle, rate = map(np.asarray, states.stores[:2])
    origin = np.stack([states.p.x, states.p.y])
    speed = np.stack([states.v.x, states.v.y])

    def turned(vector: Any, by: np.ndarray) -> np.ndarray:
        x, y = vector
        return np.stack([np.cos(by) * x - np.sin(by) * y, np.sin(by) * x + np.cos(by) * y])

    def perpendicular(vector: np.ndarray) -> np.ndarray:
        return np.stack([-vector[1], vector[0]])

    at_rigid = turned(offset, theta)
    to_hinge = turned(hinge, theta)
    rod = turned((slosh.length, 0.0), theta + toward + angle)
    momentum, angular, energy = np.zeros_like(origin), 0.5 * 0.0 * spin, 0.5 * inertia * spin**2
    angular = angular + inertia * spin
    for mass, place, moving in (
        (rigid, at_rigid, spin * perpendicular(at_rigid)),
        (
            slosh.mass,
            to_hinge + rod,
            spin * perpendicular(to_hinge) + (spin + rate) * perpendicular(rod),
        ),
    ):
        at, v = origin + place, speed + moving
        momentum = momentum + mass * v
        angular = angular + mass * (at[0] * v[1] - at[1] * v[0])
        energy = energy + 0.5 * mass * (v[0] ** 2 + v[1] ** 2)
    return Sums(momentum, angular, energy)
