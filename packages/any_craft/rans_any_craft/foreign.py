"""What a file of other software says of a spacecraft; what it does not say is that of another one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rans import Thruster
from rans.extend import ConfigError, Spacecraft

_OUT_OF_PLANE = 1e-3
"""Part of a force along z that is laid into the plane. People type angles with two to five digits: 3.1416 is off by
7e-6 rad, 90 degrees as 1.57 by 8e-4, and a force turned by a milliradian loses 5e-7 of itself."""
_FORCE = 1.0
"""N that stand for a force that a file does not say: that of the paper's thrusters."""


@dataclass(frozen=True)
class Nozzle:
    """A thruster whose force may be unknown."""

    name: str
    position: tuple[float, float, float]
    """m, in G."""
    direction: tuple[float, float, float]
    """Unit vector of the force, in G."""
    force: float | None
    """N; None: the file does not say it."""


@dataclass(frozen=True)
class Foreign:
    """What a file of other software says of a spacecraft, in its root frame G."""

    source: str
    """Name of the file and how it was read, for the first line of the new one."""
    mass: float
    """kg."""
    inertia: tuple[tuple[float, float, float], ...] | None
    """kg m^2 about the centre of mass, axes of G; None: the file has none."""
    centre_of_mass: tuple[float, float, float]
    """m, in G."""
    nozzles: tuple[Nozzle, ...] = ()
    remarks: tuple[str, ...] = ()
    """What the file says and a spacecraft of RANS cannot have, or what it does not say and is assumed; clauses."""

    def spacecraft(self, name: str, usual: Spacecraft) -> tuple[Spacecraft, tuple[str, ...]]:
        """The spacecraft, and remarks with what it has of another one because the file does not say it.

        Args:
            name: name of the spacecraft.
            usual: the other one, which moves in the plane or in space as this one.

        Raises:
            ConfigError: a force acts out of the plane of a planar craft, or a number is not physical.
        """
        remarks = list(self.remarks)
        dimension = usual.dimension
        inertia = self.inertia
        if inertia is None:
            remarks.append(f"it has no inertia, and the one here is that of {usual.name}")
            inertia = usual.inertia
        elif dimension == 2:
            about_z = inertia[2][2]
            inertia = ((about_z, 0.0, 0.0), (0.0, about_z, 0.0), (0.0, 0.0, about_z))
        unsaid = [nozzle.name for nozzle in self.nozzles if nozzle.force is None]
        if unsaid:
            remarks.append(
                f"it does not say the force of {', '.join(unsaid)}, and {_FORCE:g} N here stands for it"
            )
        thrusters = tuple(self._thruster(nozzle, dimension) for nozzle in self.nozzles)
        if not thrusters:
            remarks.append(
                "it has no link that a plugin of SpacecraftThrusterModel names, nor one whose name says thruster "
                f"or nozzle, and the thrusters here are those of {usual.name}"
            )
        x, y, z = self.centre_of_mass
        centre = (x, y, z if dimension == 3 else 0.0)
        levers = [math.dist(thruster.position, centre) for thruster in thrusters]
        craft = Spacecraft(
            name=name,
            dimension=dimension,
            mass=self.mass,
            inertia=inertia,
            centre_of_mass=centre,
            thrusters=thrusters or usual.thrusters,
            radius=round(max(levers), 4) if any(levers) else usual.radius,
        )
        return craft, tuple(remarks)

    def _thruster(self, nozzle: Nozzle, dimension: int) -> Thruster:
        """The thruster of a nozzle; raises (`ConfigError`) if it pushes a planar craft out of the plane."""
        force = _FORCE if nozzle.force is None else nozzle.force
        if dimension == 3:
            return Thruster(nozzle.position, nozzle.direction, force)
        x, y, _ = nozzle.position
        along_x, along_y, across = nozzle.direction
        if abs(across) > _OUT_OF_PLANE:
            raise ConfigError(
                f"{nozzle.name} of {self.source} pushes along z, {abs(across):.2g} of its force out of the plane: "
                "choose dimension 3, or turn it in that file."
            )
        length = math.hypot(along_x, along_y)
        return Thruster((x, y, 0.0), (along_x / length, along_y / length, 0.0), force)
