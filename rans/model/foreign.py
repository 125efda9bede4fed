"""Spacecraft of other software's files, which packages read: what such a file says of one, and which file is one.

A reader of the group ``rans.importers``, by the suffix of its files, makes a `Foreign` of a file's text.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rans.errors import ConfigError
from rans.files import read_text
from rans.model.spacecraft import MOST_THRUSTERS
from rans.registry import Registry

FORMATS = (".urdf",)
"""Suffixes of URDF."""
_LARGEST = 2**24
"""Bytes: descriptions have some ten thousand, their meshes lie in other files."""
_OUT_OF_PLANE = 1e-3
"""Part of a force along z that is laid into the plane. People type angles with two to five digits: 3.1416 is off by
7e-6 rad, 90 degrees as 1.57 by 8e-4, and a force turned by a milliradian loses 5e-7 of itself."""


@dataclass(frozen=True)
class Nozzle:
    """A thruster whose force, or position, may be unknown."""

    name: str
    position: tuple[float, float, float] | None
    """m, in G; None: the file does not say it."""
    direction: tuple[float, float, float]
    """Unit vector of the force, in G."""
    force: float | None
    """N; None: the file does not say it."""

    def text(self, dimension: int) -> str:
        """The thruster as "POSITION; DIRECTION; FORCE" of `rans init`, with two coordinates in the plane."""
        where = ["POSITION"] if self.position is None else self.position[:dimension]
        force = "FORCE" if self.force is None else self.force
        parts = (where, self.direction[:dimension], [force])
        return "; ".join(", ".join(_number(x) for x in part) for part in parts)


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

    @property
    def radius(self) -> float | None:
        """Distance of the outermost thruster from the centre of mass, m, for drawings; None without thrusters."""
        levers = [
            math.dist(nozzle.position, self.centre_of_mass)
            for nozzle in self.nozzles
            if nozzle.position is not None
        ]
        return round(max(levers), 4) if any(levers) else None

    def thrusters(self, dimension: int) -> tuple[str, ...]:
        """All thrusters as "POSITION; DIRECTION; FORCE".

        Raises:
            ConfigError: a position or force is missing, or a force acts out of the plane of a planar craft.
        """
        if dimension == 2:
            for nozzle_pose in self.nozzles:
                across = abs(nozzle_pose.direction[2])
                if across > _OUT_OF_PLANE:
                    raise ConfigError(
                        f"{nozzle_pose.name} of {self.source} pushes along z, {across:.2g} of its force out of the "
                        "plane: set dimension to 3 or give thrusters of the plane with --thruster."
                    )
        if any(nozzle.force is None or nozzle.position is None for nozzle in self.nozzles):
            missing = "force" if all(nozzle.position for nozzle in self.nozzles) else "position"
            texts = " ".join(f"--thruster '{nozzle.text(dimension)}'" for nozzle in self.nozzles)
            raise ConfigError(
                f"{self.source} does not say the {missing} of its thrusters; give each of them, with metres and "
                f"newtons in place of words in capitals: {texts}"
            )
        return tuple(nozzle.text(dimension) for nozzle in self.nozzles)


Importer = Callable[[str, str], Foreign]
"""Reads the text of a file, whose name messages have."""
IMPORTERS: Registry[Importer] = Registry(
    kind="reader of spacecraft files",
    group="rans.importers",
    built_in={},
    checked=lambda importer: importer,
)


def is_foreign(name: object) -> bool:
    """Whether a name is that of a file that `read_foreign` reads, by its suffix."""
    return Path(str(name)).suffix.lower() in FORMATS


def read_foreign(file: Path) -> Foreign:
    """Mass properties and thrusters of a URDF.

    Raises:
        ConfigError: the file cannot be read, is damaged, or describes what is not one rigid body; or no installed
            package reads such files.
    """
    suffix = file.suffix.lower()
    text = read_text(file, _LARGEST, "the spacecraft file ")
    try:
        draft = IMPORTERS[suffix[1:]](text, file.name)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from error
    if len(draft.nozzles) > MOST_THRUSTERS:
        raise ConfigError(
            f"{file} has {len(draft.nozzles)} thrusters, and a spacecraft at most {MOST_THRUSTERS}."
        )
    return draft


def _number(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.12g}"
