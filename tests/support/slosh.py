"""A craft with sloshing liquid, and its masses as a stranger would write them down."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import rans
from rans import Spacecraft
from rans.drawing import columns, rotations

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
    """Sums over the rigid part and the mass that swings, of N states."""

    momentum: np.ndarray
    """(N, 3), kg m/s."""
    angular: np.ndarray
    """About W's origin, (N, 3), N m s."""
    energy: np.ndarray
    """J, (N,)."""


def sums(craft: Spacecraft, states: Any) -> Sums:
    """Momentum, angular momentum and energy from the positions and velocities of both masses.

    The rigid part's mass, centre and inertia are those that make up the craft's with the mass at rest.
    """
    slosh = slosh_of(craft)
    hinge = np.array(slosh.hinge) - np.array(craft.centre_of_mass)
    rest = hinge + slosh.length * np.array(slosh.direction)
    rigid = craft.mass - slosh.mass
    offset = -slosh.mass / rigid * rest
    tensor = np.array(craft.inertia)
    for mass, arm in ((slosh.mass, rest), (rigid, offset)):
        tensor = tensor - mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    turn = rotations(states)

    def in_world(vectors: Any) -> np.ndarray:
        return np.einsum("nij,nj->ni", turn, np.broadcast_to(vectors, (len(turn), 3)))

    if craft.dimension == 3:
        spin = columns(states.w)
        rod, slip = np.transpose(states.stores[:3]), np.transpose(states.stores[3:6])
    else:
        angle, rate = states.stores
        along = np.arctan2(slosh.direction[1], slosh.direction[0]) + angle
        spin = np.outer(states.w, [0.0, 0.0, 1.0])
        rod = np.stack([np.cos(along), np.sin(along), 0.0 * along], axis=1)
        slip = np.cross(np.outer(rate, [0.0, 0.0, 1.0]), rod)
    momentum: Any = 0.0
    angular = in_world(spin @ tensor)
    energy = 0.5 * np.einsum("ni,ij,nj->n", spin, tensor, spin)
    for mass, arm, slipping in (
        (rigid, offset, np.zeros(3)),
        (slosh.mass, hinge + slosh.length * rod, slosh.length * slip),
    ):
        at = columns(states.p) + in_world(arm)
        v = columns(states.v) + in_world(np.cross(spin, arm) + slipping)
        momentum = momentum + mass * v
        angular = angular + mass * np.cross(at, v)
        energy = energy + 0.5 * mass * (v**2).sum(axis=1)
    return Sums(momentum, angular, energy)
