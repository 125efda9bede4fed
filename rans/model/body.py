"""Mass properties and thruster health of a spacecraft, which may differ between episodes.

Every engine, kernel and Drake take it as it is; values are numbers or fields (N,), SI, about the centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.base.errors import ConfigError, checked
from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft, emptied, is_rigid_body

_MOMENTS = {
    1: {"I_zz": "> 0"},
    6: {"I_xx": "> 0", "I_xy": "", "I_xz": "", "I_yy": "> 0", "I_yz": "", "I_zz": "> 0"},
}
"""The bound of every moment of inertia, by how many there are."""


@dataclass(frozen=True)
class Mounting:
    """True position and direction of a thruster, axes of B: two entries each in the plane, three in space."""

    offset: tuple[Field, ...]
    """Vector from the designed position to the true one, m."""
    direction: tuple[Field, ...]
    """Unit vector of the force on the spacecraft."""


@dataclass(frozen=True)
class Body:
    """Mass properties and thruster health: floats, or arrays (N,) where spacecraft differ.

    A thruster that is commanded the share c of its force gives gain * c + leak. Dead is (gain, leak) = (0, 0),
    stuck open is (0, 1), stuck at a share s is (0, s), and weak is for example (0.6, 0).
    """

    mass: Field
    """Mass, kg."""
    inertia: tuple[Field, ...]
    """Moments of inertia about the true centre of mass, axes of B, kg m^2. Plane: (I_zz,). Space: the six
    entries (I_xx, I_xy, I_xz, I_yy, I_yz, I_zz)."""
    centre: tuple[Field, ...] = ()
    """Offset from the nominal centre of mass to the true one, axes of B, m: two entries in the plane, three in
    space; empty: no offset. States refer to the true centre of mass."""
    gain: tuple[Field, ...] = ()
    """Factor on the commanded share, one per thruster; empty: each is 1."""
    leak: tuple[Field, ...] = ()
    """Share of full force that is always given, one per thruster; empty: each is 0."""
    droop: Field | None = None
    """Droop of each supply, see `rans.model.dynamics.thrust`; None: that of the craft."""
    mountings: tuple[Mounting, ...] = ()
    """True position and direction of each thruster; empty: as designed."""

    @classmethod
    def of(cls, craft: Spacecraft) -> Body:
        """Body of a spacecraft as designed."""
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = craft.inertia
        count = craft.thruster_count
        moments = (zz,) if craft.dimension == 2 else (xx, xy, xz, yy, yz, zz)
        return cls(craft.mass, moments, (0.0,) * craft.dimension, (1.0,) * count, (0.0,) * count)

    def emptied(self, craft: Spacecraft) -> Body:
        """The body of a craft with propellant when its tank is empty, as arrays (N,) or of no dimension."""
        inertia = tuple(map(numbers, self.inertia))
        centre = tuple(map(numbers, self.centre or (0.0,) * craft.dimension))
        mass, inertia, centre = emptied(craft, numbers(self.mass), inertia, centre)
        return replace(self, mass=mass, inertia=inertia, centre=centre)


def in_memory(body: Body, nominal: Body, count: int, field: Callable[[Any], Any]) -> Body:
    """Checked copy of a body for N spacecraft, with a field in memory for every value that differs among them.

    Args:
        body: numbers, or arrays or tensors (N,); empty entries take the nominal values.
        nominal: body as designed.
        count: number of spacecraft, N.
        field: copies an array to the memory of the engine.

    Raises:
        ConfigError: a mass is not positive, an inertia tensor is not that of a rigid body, a gain or a leak is
            negative, a number is not finite, an array has not N entries, or the craft has another dimension or
            number of thrusters.
    """
    # Check the dimension before any value is copied.
    if len(checked("body", body, Body).inertia) != len(nominal.inertia):
        raise ConfigError(
            f"the body has {len(body.inertia)} moments of inertia; in "
            f"{'the plane it has 1' if len(nominal.inertia) == 1 else 'space it has 6'}."
        )

    def in_fields(
        bounds: Mapping[str, str], written: tuple[Any, ...], usual: tuple[Any, ...]
    ) -> tuple[Any, ...]:
        """Values as fields, in the order of ``bounds``; what was not written is usual. A wrong count is refused."""
        if len(written or usual) != len(usual):
            raise ConfigError(
                f"the body's {next(iter(bounds)).split()[0]} has {len(written)} entries; this "
                f"craft needs {len(usual)}."
            )
        return tuple(
            _placed(*bound, value, count, field)
            for bound, value in zip(bounds.items(), written or usual, strict=True)
        )

    # Missing values are those of the nominal body.
    thrusters = range(len(nominal.gain))
    result = Body(
        _placed("mass", "> 0", body.mass, count, field),
        in_fields(_MOMENTS[len(nominal.inertia)], body.inertia, nominal.inertia),
        in_fields(
            {f"centre {axis}": "" for axis in "xyz"[: len(nominal.centre)]},
            body.centre,
            nominal.centre,
        ),
        in_fields({f"gain of thruster {i}": ">= 0" for i in thrusters}, body.gain, nominal.gain),
        in_fields({f"leak of thruster {i}": ">= 0" for i in thrusters}, body.leak, nominal.leak),
        mountings=_mountings_in_memory(body.mountings, len(thrusters), count, field),
    )
    if len(body.inertia) == 6:
        _check_rigid(body.inertia)
    return result


def check_stores(craft: Spacecraft, body: Body) -> None:
    """Refuse bodies that leave no craft around its propellant, or that its further effectors cannot have.

    Args:
        craft: any.
        body: of numbers, or of arrays or tensors (N,).

    Raises:
        ConfigError: there is as much propellant as the craft has mass, or more; or a further effector
            refuses the body (`Effector.check_body`).
    """
    least = float(np.min(numbers(body.mass)))
    tank = craft.propellant
    if tank is not None and tank.mass > least * (1.0 - 1e-3):
        raise ConfigError(
            f"the body's mass, {least:g} kg, includes a full tank, and the propellant of {craft.name!r}, "
            f"{tank.mass:g} kg, may be 99.9 % of it at most. The usual cause is the mass with an empty tank."
        )
    if tank is not None and not np.all(is_rigid_body(body.emptied(craft).inertia, 1e-6)):
        raise ConfigError(
            f"the body leaves no rigid craft to {craft.name!r} with an empty tank: without {tank.mass:g} kg at "
            "the tank's position its inertia is not that of a body. Give it more inertia, or less propellant."
        )
    for effector in craft.further_effectors:
        effector.check_body(craft, body)


def _mountings_in_memory(
    mountings: tuple[Mounting, ...], thrusters: int, count: int, field: Callable[[Any], Any]
) -> tuple[Mounting, ...]:
    """Checked copy of mountings of all thrusters, or of none, as numbers or ``count`` rows; see `in_memory`."""
    if len(mountings) not in (0, thrusters):
        raise ConfigError(
            f"the body's mountings have {len(mountings)} entries; this craft needs {thrusters}."
        )

    def vector(name: str, entries: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(_placed(name, "", x, count, field) for x in entries)

    return tuple(
        Mounting(
            vector(f"offset of thruster {i}", mounting.offset),
            vector(f"direction of thruster {i}", mounting.direction),
        )
        for i, mounting in enumerate(mountings)
    )


def _placed(name: str, bound: str, value: Any, count: int, field: Callable[[Any], Any]) -> Any:
    """Checked number, or checked field of one number per spacecraft."""
    values = numbers(value)
    if values.shape not in ((), (count,)):
        raise ConfigError(
            f"{name} must be one number or one for each of {count:,} spacecraft, got an "
            f"array of shape {values.shape}."
        )
    wrong = ~np.isfinite(values) | {"": False, "> 0": values <= 0, ">= 0": values < 0}[bound]
    if wrong.any():
        raise ConfigError(
            f"{name} must be finite{bound and f' and {bound}'}, got "
            f"{float(values[wrong].flat[0])!r}."
        )
    return field(values) if values.ndim else float(values)


def _check_rigid(inertia: tuple[Any, ...]) -> None:
    """Reject moments of inertia (kg m^2, also arrays) that no body has, with a tolerance for float32."""
    entries = np.stack(np.broadcast_arrays(*map(numbers, inertia)), axis=-1)
    wrong = ~is_rigid_body(tuple(np.moveaxis(entries, -1, 0)), 1e-6)
    if wrong.any():
        tensor = entries[wrong].reshape(-1, 6)[0][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
        moments = ", ".join(f"{moment:.4g}" for moment in np.linalg.eigvalsh(tensor))
        raise ConfigError(
            "principal moments of inertia must be > 0 and none above the sum of the other two, "
            f"got {moments} kg m^2."
        )


def numbers(value: Any) -> np.ndarray:
    """NumPy array (float64) of a number, an array, or a tensor on any device."""
    return np.asarray(value.detach().cpu() if hasattr(value, "detach") else value, dtype=np.float64)
