"""Largest accelerations of a spacecraft, and checks of its sizes against each other, which find mistaken units."""

from __future__ import annotations

import math

import numpy as np

from rans.model.spacecraft import Spacecraft

_LARGE = 1.5
"""Factor on the radius beyond which a nozzle or the radius of gyration lies outside of a body. Of real craft
nozzles reach 1.22 of it (Apollo), and no body's radius of gyration exceeds its radius."""
_SMALL = 20.0
"""Factor between two lengths of a body that do not fit: real craft have a radius of gyration of 0.35 of their
radius or more, and of 0.62 to 0.8 of their farthest nozzle."""
_LIGHTEST = 0.01
"""kg/m^3 of a ball through the outermost thruster. Solar sails have about 0.1 (IKAROS: 310 kg, 7 m to a tip), the
space station 0.6; a file in mm has a billionth of what is meant, one in cm a millionth."""
_HEAVIEST = 22_600.0
"""kg/m^3 of a ball of the radius: osmium's, the densest matter."""
_STRONGEST = 30.0, 100.0
"""Accelerations, m/s^2 and rad/s^2, beyond which thrusters are too strong: of real craft they reach 8.7 (a Mars
lander), and 8 in the training of the agents for any craft."""
_PAIRED = 64
"""Vectors at most whose pairs begin a search: the pairs of a thousand are a million."""


def seconds_for_a_metre(craft: Spacecraft) -> float:
    """Least time from rest to rest over 1 m, s: half of it with all nozzles open that push the best way.

    Bang-bang: t = 2 sqrt(d / a). A spacecraft that first turns, or whose brakes are weaker, takes longer. Infinite
    without thrusters.
    """
    if not craft.thrusters:
        return math.inf
    forces = craft.wrenches[:, : craft.dimension]
    return 2.0 * math.sqrt(craft.mass / _strongest(craft, forces))


def seconds_for_half_a_turn(craft: Spacecraft) -> float:
    """Least time from rest to rest over half a turn about the best axis of B, s; infinite without torque.

    Bang-bang, t = 2 sqrt(angle / alpha), with thrusters and reaction wheels; a wheel's largest momentum is ignored.
    """
    torques = craft.wrenches[:, craft.dimension :]
    inertia = np.diag(np.array(craft.inertia))[-torques.shape[1] :]
    wheels = np.abs(np.array(craft.wheel_map)).sum(axis=0) if craft.wheels else 0.0
    further = sum(effector.largest_torque for effector in craft.further_effectors)
    alpha = max(
        float(np.max((np.abs(side) + wheels + further) / inertia))
        for side in (_sums(craft, torques), _sums(craft, -torques))
    )
    return math.inf if alpha == 0.0 else 2.0 * math.sqrt(math.pi / alpha)


def _sums(craft: Spacecraft, wrenches: np.ndarray) -> np.ndarray:
    """Largest sum of the positive parts along each axis; thrusters that share a supply give as much as one."""
    positive = np.maximum(wrenches, 0.0)
    return (
        positive.max(axis=0, initial=0.0)
        if craft.thrust_sharing == "split"
        else positive.sum(axis=0)
    )


def _strongest(craft: Spacecraft, forces: np.ndarray) -> float:
    """Largest force in any direction, N: that of the thrusters that push its own way."""
    if craft.thrust_sharing == "split":
        return float(np.linalg.norm(forces, axis=1).max())
    return longest_sum(forces)


def longest_sum(vectors: np.ndarray) -> float:
    """Length of the longest sum of a subset of these vectors (n, d).

    The longest sum contains exactly the vectors with a positive component along it. Repeated selection by that
    rule lengthens a sum until the subset no longer changes. It starts from the sums and differences of pairs, all
    of them up to `_PAIRED` vectors, and from random directions.
    """
    some = vectors[:: max(1, -(-len(vectors) // _PAIRED))]
    pairs = np.concatenate([some[:, None] + some, some[:, None] - some]).reshape(
        -1, vectors.shape[1]
    )
    sums = np.concatenate([pairs, np.random.default_rng(0).normal(size=(64, vectors.shape[1]))])
    for _ in range(8):
        sums = (sums @ vectors.T > 0.0) @ vectors
    return float(np.linalg.norm(sums, axis=1).max())


def misfits(craft: Spacecraft) -> list[str]:
    """Sizes of a body that do not fit its radius, each as a sentence; the usual cause is a unit."""
    radius = craft.radius
    arm = max((math.dist(t.position, craft.centre_of_mass) for t in craft.thrusters), default=0.0)
    tensor = np.array(craft.inertia)
    largest = tensor[2][2] if craft.dimension == 2 else float(np.linalg.eigvalsh(tensor).max())
    gyration = math.sqrt(largest / craft.mass)
    is_lighter_than_sails = craft.mass < _LIGHTEST * 4.0 / 3.0 * math.pi * arm**3
    result = []
    if gyration > _LARGE * radius:
        result.append(
            f"its inertia of {largest:g} kg m^2 is that of a body of {gyration:.3g} m about its centre, and its "
            f"radius is {radius:g} m: the usual cause is an inertia, a mass or a radius in other units"
        )
    if arm > _LARGE * radius:
        result.append(
            f"a thruster is {arm:.3g} m from the centre of mass, and its radius is {radius:g} m: the usual cause "
            "is a position, a centre of mass or a radius in other units"
        )
    if radius > _SMALL * max(gyration, arm):
        result.append(
            f"its radius is {radius:g} m, but its inertia is that of a body of {gyration:.3g} m about its centre, "
            f"and no thruster is farther than {arm:.3g} m from it: the usual cause is a radius in mm or cm"
        )
    elif not is_lighter_than_sails and arm and max(arm / gyration, gyration / arm) > _SMALL:
        result.append(
            f"its inertia of {largest:g} kg m^2 and mass of {craft.mass:g} kg are those of a body of {gyration:.3g}"
            f" m about its centre, and a thruster is {arm:.3g} m from it: the usual cause is a mass in g, or an "
            "inertia in other units"
        )
    if is_lighter_than_sails:
        result.append(
            f"a thruster is {arm:.3g} m from the centre of a mass of {craft.mass:g} kg, farther than on any solar "
            "sail: the usual cause are positions in mm or cm, or a mass in t"
        )
    density = craft.mass / (4.0 / 3.0 * math.pi * radius**3)
    if not result and density > _HEAVIEST:
        result.append(
            f"with {craft.mass:g} kg in a radius of {radius:g} m it is denser than osmium, {density:.3g} kg/m^3: "
            "the usual cause is a mass in g, or a radius in other units"
        )
    push = 4.0 / seconds_for_a_metre(craft) ** 2
    turn = 4.0 * math.pi / seconds_for_half_a_turn(craft) ** 2
    # Other doubts explain the accelerations.
    if not result and (push > _STRONGEST[0] or turn > _STRONGEST[1]):
        result.append(
            f"its thrusters accelerate it by {push:.3g} m/s^2 and {turn:.3g} rad/s^2: the usual cause is a force "
            "in mN, or a mass or an inertia in other units"
        )
    return result
