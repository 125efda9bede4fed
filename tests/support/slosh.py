"""A craft with sloshing liquid, and its masses as a stranger would write them down."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import rans
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft

SLOSH = rans.Slosh(1.064, 0.06, (0.05, 0.03, 0.0), (-0.6, 0.8, 0.0), 0.002)
SLOSHING = replace(
    rans.load_spacecraft("floating-platform"), name="sloshing", further_effectors=(SLOSH,)
)
"""The floating platform, of whose mass 20 % swing."""

IN_SPACE_SLOSH = rans.Slosh(0.8, 0.05, (0.03, -0.02, 0.04), (-0.48, 0.6, 0.64), 0.004)
IN_SPACE = replace(
    rans.load_spacecraft("free-flyer"),
    name="sloshing in space",
    inertia=((0.15, 0.01, -0.005), (0.01, 0.12, 0.015), (-0.005, 0.015, 0.2)),
    further_effectors=(IN_SPACE_SLOSH,),
)
"""A craft with different moments of inertia, of whose mass 15 % swing."""


def slosh_of(craft: Spacecraft) -> Any:
    """The liquid of a craft that has one."""
    (slosh,) = craft.further_effectors
    return slosh


class Sums(NamedTuple):
    """Sums over the rigid part and the mass that swings, with fields of the states' shape."""

    momentum: np.ndarray
    """(2 or 3, ...), kg m/s."""
    angular: np.ndarray
    """About W's origin, N m s; a vector (3, ...) in space."""
    energy: np.ndarray
    """J."""


def sums(craft: Spacecraft, states: Any) -> Sums:
    """Momentum, angular momentum and energy from the positions and velocities of both masses.

    The rigid part's mass, centre and inertia are those that make up the craft's with the mass at rest.
    """
    slosh = slosh_of(craft)
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


def sums_in_space(craft: Spacecraft, states: Any) -> Sums:
    """As `sums`, with rotation matrices."""
    slosh = slosh_of(craft)
    hinge = np.array(slosh.hinge) - np.array(craft.centre_of_mass)
    rest = hinge + slosh.length * np.array(slosh.direction)
    rigid = craft.mass - slosh.mass
    offset = -slosh.mass / rigid * rest
    tensor = np.array(craft.inertia)
    for mass, arm in ((slosh.mass, rest), (rigid, offset)):
        tensor = tensor - mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    quaternion = np.array(leaves(states.attitude))
    turn = Rotation.from_quat(np.roll(quaternion, -1, axis=0).T).as_matrix()

    def in_world(vectors: Any) -> np.ndarray:
        return np.einsum("nij,nj->ni", turn, np.broadcast_to(vectors, (len(turn), 3)))

    spin = np.transpose(leaves(states.w))
    rod, slip = np.transpose(states.stores[:3]), np.transpose(states.stores[3:6])
    momentum = 0.0
    angular = in_world(spin @ tensor)
    energy = 0.5 * np.einsum("ni,ij,nj->n", spin, tensor, spin)
    for mass, arm, slipping in (
        (rigid, offset, np.zeros(3)),
        (slosh.mass, hinge + slosh.length * rod, slosh.length * slip),
    ):
        at = np.transpose(leaves(states.p)) + in_world(arm)
        v = np.transpose(leaves(states.v)) + in_world(np.cross(spin, arm) + slipping)
        momentum = momentum + mass * v.T
        angular = angular + mass * np.cross(at, v)
        energy = energy + 0.5 * mass * (v**2).sum(axis=1)
    return Sums(np.array(momentum), angular.T, energy)
