"""A new spacecraft file, from numbers or from a spacecraft that comes with RANS."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rans.api.names import load_spacecraft
from rans.errors import ConfigError, RansWarning, brief
from rans.model.actuators import Wheel
from rans.model.foreign import Foreign, is_foreign, read_foreign
from rans.model.joined import Effectors, joined
from rans.model.pace import misfits
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.spacecraft_draft import (
    actuators_of,
    box_inertia,
    commented,
    thruster_of,
    wheel_of,
)
from rans.model.spacecraft_file import parse_spacecraft

if TYPE_CHECKING:
    from rans.model.authority import Authority

AUTHORITY_COLUMNS = ("axis", "forwards", "backwards", "acceleration")
"""Headings of `Draft.authority_rows`."""

_POSITION = {2: "X, Y", 3: "X, Y, Z"}
"""Position of a thruster in messages, by dimension."""


@dataclass(frozen=True)
class Draft:
    """A spacecraft and the commented TOML text that describes it."""

    spacecraft: Spacecraft
    text: str

    def __repr__(self) -> str:
        return f"<Draft of {self.spacecraft!r}>"

    def _repr_html_(self) -> str:
        from rans.show.pages.notebook import listed

        return listed(
            f"{self.spacecraft.name}: largest force and torque",
            AUTHORITY_COLUMNS,
            self.authority_rows(),
        )

    def authorities(self) -> tuple[Authority, ...]:
        """The largest force and torque along each axis, see `rans.model.authority.authorities`."""
        from rans.model.authority import authorities

        return authorities(self.spacecraft)

    def authority_rows(self) -> list[tuple[str, str, str, str]]:
        """Axis, largest force or torque each way, and the acceleration that the smaller one gives."""
        from rans.model.authority import authority_rows

        return authority_rows(self.authorities())

    def bearable(self) -> tuple[int, ...]:
        """Thrusters each of which may be dead while every force and torque stays possible."""
        from rans.randomization.faults import fault_sets

        if self.spacecraft.thruster_count < 2:
            return ()
        result = fault_sets(self.spacecraft, 1, "dead")
        return tuple(fault_set.thrusters[0] for fault_set in result if fault_set.recoverable)

    def write(
        self, file: str | Path, picture: str | Path | None = None, *, overwrite: bool = False
    ) -> None:
        """Write the file and, if asked for, a drawing of the thrusters (.svg, .png or .pdf).

        Raises:
            ConfigError: the file's name does not end in .toml, one of both exists and may not be overwritten,
                or the disk refused.
        """
        from rans.files import write_text

        check_target(Path(file), overwrite)
        if picture is not None:
            from rans.show.figures.picture_file import check_picture

            check_picture(Path(picture))
            check_free(Path(picture), overwrite)
        write_text(Path(file), self.text)
        if picture is not None:
            from rans.show.figures.layout_figure import draw_layout
            from rans.show.figures.picture_file import save_picture

            save_picture(draw_layout(self.spacecraft), Path(picture))


def begun(base: str | Path | Spacecraft | Foreign | None) -> Spacecraft | Foreign | None:
    """What a new spacecraft begins from: one of RANS, or what a URDF says of one.

    Raises:
        ConfigError: the spacecraft or file does not exist, or is damaged.
    """
    if base is None or isinstance(base, Foreign):
        return base
    if not isinstance(base, Spacecraft) and is_foreign(base):
        return read_foreign(Path(base))
    return load_spacecraft(base)


def init_spacecraft(
    name: str,
    *,
    base: str | Path | Spacecraft | Foreign | None = None,
    dimension: int | None = None,
    mass: float | None = None,
    inertia: float | Sequence[float] | None = None,
    size: Sequence[float] | None = None,
    centre_of_mass: Sequence[float] | None = None,
    thrusters: Sequence[str | Thruster] = (),
    wheels: Sequence[str | Wheel] = (),
    actuators: str | None = None,
    counts: int | None = None,
    least: float | None = None,
    most: float | None = None,
    radius: float | None = None,
    thrust_sharing: str | None = None,
) -> Draft:
    """Describe a new spacecraft by numbers, and return it with its commented TOML file.

    >>> draft = rans.init_spacecraft("mine", base="atmos", mass=16.0)
    >>> draft.spacecraft, draft.bearable()
    (<Spacecraft mine: 16 kg in the plane, thrusters 8 x 1.5 N>, (0, 1, 2, 3, 4, 5, 6, 7))

    Args:
        name: name of the spacecraft.
        base: begin from this spacecraft (name or TOML file) and keep its values where you give none; or from a file
            of other software: URDF (.urdf).
        dimension: 2: the plane, 3: space.
        mass: kg.
        inertia: kg m^2, about the centre of mass: one number, or in space three about the axes of the frame of the
            thruster positions.
        size: sides of a uniform box, m, in place of the inertia.
        centre_of_mass: m, in the frame of the thruster positions.
        thrusters: thrusters, each as "position;direction;force": "0.2,0.1;1,0;1.5" is at x 0.2 m and y 0.1 m and
            pushes along x with 1.5 N.
        wheels: reaction wheels, each as "axis;torque;momentum;inertia": "0,0,1;0.1;0.7;0.001" in N m, N m s and
            kg m^2.
        actuators: on-off, pulsed or throttle.
        counts: steps into which pulsed valves divide a control period.
        least: shortest pulse in counts, or least level of a throttle as a share of full force.
        most: largest level of a throttle, as a share of full force.
        radius: m, for drawings.
        thrust_sharing: none, or split: the open thrusters share the supply of one.

    Raises:
        ConfigError: something is missing, wrong or not physical.
    """
    settings: dict[str, Any] = {"name": name}
    if dimension is not None and dimension not in (2, 3):
        raise ConfigError(f"dimension must be 2 (plane) or 3 (space), got {brief(dimension)}.")
    # The base: a spacecraft, or a file of other software whose values fill what is not given.
    start = begun(base)
    origin = ["Written by rans init."]
    foreign: str | None = None
    if isinstance(start, Foreign):
        if dimension is None:
            raise ConfigError(
                f"{start.source} does not say whether it moves in the plane or in space: set dimension to 2 or 3, "
                "as in --set dimension=3."
            )
        foreign = start.source
        origin = [f"Written by rans init, from {foreign}."]
        for remark in start.remarks:
            origin.append(f"Of that file: {remark}.")
            warnings.warn(f"of {foreign}: {remark}.", RansWarning, stacklevel=2)
        mass = start.mass if mass is None else mass
        if start.inertia is not None and size is None:
            flat_inertia = _tensor(start.inertia[2][2], dimension)
            settings["inertia"] = start.inertia if dimension == 3 else flat_inertia
        if centre_of_mass is None:
            centre_of_mass = start.centre_of_mass[:dimension]
        thrusters = thrusters or start.thrusters(dimension)
        radius = start.radius if radius is None else radius
        start = None
    elif start is not None:
        origin = [f"Written by rans init, from {start.name}."]
    if start is not None and dimension not in (None, start.dimension):
        raise ConfigError(
            f"{start.name} has dimension {start.dimension}: another one needs other thrusters; leave out "
            "--from, in Python base."
        )
    flat = start.dimension if start is not None else dimension
    # Without a base everything that a craft cannot do without must be given.
    if start is None:
        lacking = {
            "dimension": dimension is None,
            "mass": mass is None,
            "inertia or size": inertia is None and size is None and "inertia" not in settings,
            "at least one thruster": not thrusters,
        }
        missing = [what for what, lacks in lacking.items() if lacks]
        if foreign is not None and missing == ["at least one thruster"]:
            raise ConfigError(
                f"{foreign} has a mass, and no thrusters that are read, which are links that a plugin of "
                "SpacecraftThrusterModel names, links whose names say thruster or nozzle, and thrusters of 42: "
                f"give each by --thruster '{_POSITION[dimension or 3]}; DIRECTION; FORCE' in m and N."
            )
        if missing:
            raise ConfigError(
                f"a spacecraft needs {', '.join(missing)}; or another craft to begin from, by --from NAME, in "
                "Python base=NAME."
            )
    assert flat is not None
    # Each given value replaces that of the base.
    if mass is not None:
        settings["mass"] = float(mass)
    heavy = settings.get("mass", start.mass if start is not None else 0.0)
    if inertia is not None:
        settings["inertia"] = _tensor(inertia, flat)
    elif size is not None:
        sides = _checked(size, "size", (flat,))
        settings["inertia"] = box_inertia(heavy, sides)
    if centre_of_mass is not None:
        x, y, *z = _checked(centre_of_mass, "centre_of_mass", (2, 3) if flat == 2 else (3,))
        settings["centre_of_mass"] = (x, y, z[0] if z else 0.0)
    if thrusters:
        settings["thrusters"] = tuple(
            thruster_of(thruster, flat) if isinstance(thruster, str) else thruster
            for thruster in thrusters
        )
    if wheels:
        settings["wheels"] = tuple(
            wheel_of(wheel) if isinstance(wheel, str) else wheel for wheel in wheels
        )
    if actuators is not None or counts is not None or least is not None or most is not None:
        usual = "on-off" if start is None else start.actuators.kind
        settings["actuators"] = actuators_of(actuators or usual, counts, least, most)
    if radius is not None:
        settings["radius"] = float(radius)
    if thrust_sharing is not None:
        settings["thrust_sharing"] = thrust_sharing
    # The text is read again, so that a draft is what its file will be.
    craft = Spacecraft(dimension=flat, **settings) if start is None else replace(start, **settings)
    of = f"of {foreign}" if foreign is not None else f"spacecraft {craft.name!r}"
    for misfit in misfits(craft):
        warnings.warn(f"{of}: {misfit}.", RansWarning, stacklevel=2)
    text = commented(craft, origin)
    return Draft(parse_spacecraft(text, name), text)


def join_spacecraft(
    first: str | Path | Spacecraft,
    second: str | Path | Spacecraft,
    position: Sequence[float],
    attitude: float | Sequence[float] = 0.0,
    *,
    effectors: Effectors = "both",
    name: str | None = None,
) -> Draft:
    """Describe two rigidly joined spacecraft, such as after docking, as one, and return it with its TOML file.

    >>> rans.join_spacecraft("atmos", "atmos", (0.4, 0.0), name="pair").spacecraft
    <Spacecraft pair: 35.6 kg in the plane, thrusters 16 x 1.5 N>

    Masses add up, and the inertia about the common centre of mass follows from the parallel axis theorem. The
    frame G of the first stays. Thrusters and wheels of the first come first.

    Args:
        first: name, TOML file or object.
        second: likewise, of the same dimension.
        position: origin of the second's frame G in that of the first, m: two numbers in the plane, three in space.
        attitude: of the second's G in that of the first: heading, rad, or in space a quaternion (w, x, y, z).
        effectors: "both", or "first": the second is a passive body, without its thrusters, with locked wheels.
        name: of the joined craft; None: FIRST-SECOND.

    Raises:
        ConfigError: the dimensions differ, a number is wrong, or the effectors of both cannot belong to one craft.
    """
    craft = joined(
        load_spacecraft(first), load_spacecraft(second), position, attitude, effectors, name
    )
    text = commented(craft, ["Written by rans.join_spacecraft."])
    return Draft(parse_spacecraft(text, craft.name), text)


def check_target(file: Path, overwrite: bool = False) -> None:
    """Refuse (`ConfigError`) what is no spacecraft file's name, or exists."""
    if file.suffix != ".toml":
        raise ConfigError(
            f"a spacecraft's file must end in .toml, as in {file.stem}.toml, got {str(file)!r}."
        )
    check_free(file, overwrite)


def check_free(file: Path, overwrite: bool = False) -> None:
    """Refuse (`ConfigError`) a file that exists, unless it may be overwritten."""
    if file.exists() and not overwrite:
        raise ConfigError(f"{file} exists: name another file, or delete it first.")


def _tensor(
    inertia: float | Sequence[float], dimension: int
) -> tuple[tuple[float, float, float], ...]:
    """Tensor (3, 3), kg m^2, of one moment for every axis, or in space of three."""
    if isinstance(inertia, int | float):
        moments = (float(inertia),) * 3
    else:
        counts = (1,) if dimension == 2 else (1, 3)
        checked = _checked(inertia, "inertia", counts)
        moments = checked * 3 if len(checked) == 1 else checked
    x, y, z = moments
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))


def _checked(values: Sequence[float], what: str, counts: Sequence[int]) -> tuple[float, ...]:
    if len(values) not in counts:
        allowed = " or ".join(map(str, counts))
        raise ConfigError(f"{what} must be {allowed} numbers, got {brief(tuple(values))}.")
    return tuple(map(float, values))
