"""Two spacecraft that are rigidly joined, such as after docking, as one spacecraft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rans import load_spacecraft
from rans.api.drafting import Draft
from rans.extend import ConfigError, Spacecraft, brief, counted


class Lump(NamedTuple):
    """Mass properties of a rigid body."""

    mass: float
    """kg."""
    centre: np.ndarray
    """Centre of mass (3,), m, in a frame that several bodies have in common."""
    inertia: np.ndarray
    """About it, (3, 3), kg m^2, axes of that frame."""


def lumped(bodies: Sequence[Lump]) -> Lump:
    """One rigid body of several, of which one has a mass, by the parallel axis theorem."""
    mass = sum(body.mass for body in bodies)
    centre = np.sum([body.mass * body.centre for body in bodies], axis=0) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        arm = body.centre - centre
        inertia += body.inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Lump(mass, centre, 0.5 * (inertia + inertia.T))


def join_spacecraft(
    first: str | Path | Spacecraft,
    second: str | Path | Spacecraft,
    position: Sequence[float],
    attitude: float | Sequence[float] = 0.0,
    *,
    effectors: Literal["both", "first"] = "both",
    name: str | None = None,
) -> Draft:
    """Describe two rigidly joined spacecraft, such as after docking, as one, and return it with its TOML file.

    >>> rans.join_spacecraft("atmos", "atmos", (0.4, 0.0), name="pair").spacecraft
    <Spacecraft pair: 35.6 kg in the plane, thrusters 16 x 1.5 N>

    Masses add up, the centre of mass is theirs together, and the inertia about it follows from the parallel axis
    theorem. The frame G of the first stays. Thrusters and wheels of the first come first. Drawings have a sphere
    around both.

    Args:
        first: name, TOML file or object.
        second: likewise, of the same dimension.
        position: origin of the second's frame G in that of the first, m: two numbers in the plane, three in space.
        attitude: of the second's G in the first's: heading, rad, or in space a quaternion (w, x, y, z) of any
            length; 0: axes are parallel.
        effectors: "both", or "first": the second is a passive body, without its thrusters, with locked wheels.
        name: of the joined craft; None: FIRST-SECOND.

    Raises:
        ConfigError: dimensions differ, numbers are wrong, or the effectors of both cannot belong to one craft.
    """
    first, second = load_spacecraft(first), load_spacecraft(second)
    dimension = first.dimension
    if second.dimension != dimension:
        raise ConfigError(
            f"{first.name} moves in {'the plane' if dimension == 2 else 'space'} and {second.name} does not: both "
            "must have the same dimension."
        )
    if effectors not in ("both", "first"):
        raise ConfigError(f"effectors must be both or first, got {brief(effectors)}.")
    offset = np.zeros(3)
    offset[:dimension] = _numbers(position, dimension, "position")
    rotation = _rotation(attitude, dimension)
    if effectors == "both":
        _check_effectors(first, second)

    inertia = np.array(second.inertia)
    if effectors == "first":
        # The inertia of a craft is without that of its wheels about their axes; locked wheels turn with it.
        for wheel in second.wheels:
            inertia = inertia + wheel.inertia * np.outer(wheel.axis, wheel.axis)
    whole = [
        Lump(first.mass, np.array(first.centre_of_mass), np.array(first.inertia)),
        Lump(
            second.mass,
            offset + rotation @ np.array(second.centre_of_mass),
            rotation @ inertia @ rotation.T,
        ),
    ]
    both = lumped(whole)

    # Effectors, those of the second turned and moved.
    thrusters = first.thrusters
    wheels = first.wheels
    if effectors == "both":
        supplies = 1 + max((thruster.supply for thruster in first.thrusters), default=-1)
        thrusters += tuple(
            replace(
                thruster,
                position=_triple(offset + rotation @ np.array(thruster.position)),
                direction=_triple(rotation @ np.array(thruster.direction)),
                supply=supplies + thruster.supply,
            )
            for thruster in second.thrusters
        )
        wheels += tuple(
            replace(wheel, axis=_triple(rotation @ np.array(wheel.axis))) for wheel in second.wheels
        )
    reach = max(
        float(np.linalg.norm(body.centre - both.centre)) + craft.radius
        for craft, body in zip((first, second), whole, strict=True)
    )
    craft = replace(
        first,
        name=name or f"{first.name}-{second.name}",
        mass=both.mass,
        inertia=tuple(_triple(row) for row in both.inertia),
        centre_of_mass=_triple(both.centre),
        thrusters=thrusters,
        wheels=wheels,
        radius=reach,
    )
    return Draft.of(craft, ["Written by rans.join_spacecraft."])


def _check_effectors(first: Spacecraft, second: Spacecraft) -> None:
    """Refuse (`ConfigError`) effectors of two craft that one craft cannot have."""
    advice = "the second's can be left out (effectors first)"
    if first.actuators != second.actuators:
        raise ConfigError(
            f"the thrusters of {first.name} are {_mode(first)}, and those of {second.name} {_mode(second)}: a "
            f"spacecraft has thrusters of one kind, so {advice}."
        )
    for craft in (first, second):
        several = craft.propellant is not None or craft.further_effectors
        if several or craft.thrust_sharing != "none":
            raise ConfigError(
                f"{craft.name} has a tank, a shared supply or further effectors, which a craft has once: "
                f"{advice}."
            )


def _mode(craft: Spacecraft) -> str:
    """Command mode of its thrusters as in its file, such as "pulsed (counts 20, least 1)"."""
    settings = ", ".join(f"{key} {value:g}" for key, value in asdict(craft.actuators).items())
    return f"{craft.actuators.kind} ({settings})" if settings else craft.actuators.kind


def _numbers(values: object, count: int, what: str) -> np.ndarray:
    """Finite numbers as an array (count,), or `ConfigError`."""
    try:
        found = np.atleast_1d(np.array(values, dtype=float))
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        needed = counted(count, "finite number")
        raise ConfigError(f"the {what} must be {needed}, got {brief(values)}.")
    return found


def _rotation(attitude: float | Sequence[float], dimension: int) -> np.ndarray:
    """Rotation matrix (3, 3) of a heading in the plane, and of a quaternion or of 0, which is none, in space."""
    if dimension == 2:
        heading = _numbers(attitude, 1, "attitude in the plane, a heading in rad,")
        return Rotation.from_euler("z", heading[0]).as_matrix()
    if isinstance(attitude, int | float) and attitude == 0:
        return np.eye(3)
    quaternion = _numbers(attitude, 4, "attitude")
    if np.linalg.norm(quaternion) == 0.0:
        raise ConfigError("the attitude must not be a quaternion of zeros.")
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    # Zeros of either sign are one number in files.
    x, y, z = (float(u) + 0.0 for u in vector)
    return (x, y, z)
