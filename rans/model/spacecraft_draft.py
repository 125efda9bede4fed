"""Commented spacecraft files from a few numbers, as `rans init` writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Any

from rans.errors import ConfigError, brief
from rans.languages import Toml
from rans.model.actuators import KINDS, WHOLE_PERIODS, Actuators, Pulsed, Throttle, Wheel
from rans.model.spacecraft import Spacecraft, Thruster

_MOST = 1e6
"""Largest accepted number; larger ones are in a wrong unit."""

LEAST = 1e-9
"""Smallest accepted mass, moment of inertia, side, force or number of a wheel, SI."""


def numbers_of_text(text: str, what: str, counts: Sequence[int]) -> tuple[float, ...]:
    """Numbers of a text, separated by commas or spaces.

    Args:
        text: text to read.
        what: name of the quantity in messages.
        counts: accepted numbers of values.

    Raises:
        ConfigError: the text does not hold one of these counts of finite numbers.
    """
    words = text.replace(",", " ").split()
    allowed = " or ".join(map(str, counts))
    try:
        result = tuple(map(float, words))
    except ValueError:
        result = ()
    if len(result) not in counts or not all(abs(x) <= _MOST for x in result):
        raise ConfigError(
            f"{what} must be {allowed} {'number' if allowed == '1' else 'numbers'}, such as "
            f"{', '.join(['0.1'] * counts[0])}, got {brief(text)}."
        )
    return result


def positive_number(text: str, what: str) -> float:
    """The number of a text, at least `LEAST`; raises as `numbers_of_text`."""
    (value,) = numbers_of_text(text, what, (1,))
    if value < LEAST:
        raise ConfigError(f"{what} must be at least {LEAST:g}, got {value:g}.")
    return value


def thruster_of(text: str, dimension: int) -> Thruster:
    """A thruster from "POSITION; DIRECTION; FORCE", such as "0.2, 0.1; 1, 0; 1.5" in the plane.

    Raises:
        ConfigError: there are not three parts, a part is wrong, the direction is zero, or the force not positive.
    """
    parts = text.split(";")
    if len(parts) != 3:
        raise ConfigError(
            "a thruster is its position (m), the direction of its force and its force (N), between "
            f'semicolons, such as "0.2, 0.1; 1, 0; 1.5", got {brief(text)}.'
        )
    position = _triple(numbers_of_text(parts[0], "the position of a thruster", (dimension,)))
    direction = _unit(
        _triple(numbers_of_text(parts[1], "the direction of a thruster", (dimension,))), text
    )
    force = positive_number(parts[2], "the force of a thruster")
    return Thruster(position, direction, force)


def wheel_of(text: str, dimension: int = 3) -> Wheel:
    """A reaction wheel from "AXIS; TORQUE; MOMENTUM; INERTIA", such as "0, 0, 1; 0.1; 0.7; 0.001".

    Raises:
        ConfigError: there are not four parts, a part is wrong or not positive, the axis is zero, or, in the plane,
            not upright.
    """
    parts = text.split(";")
    if len(parts) != 4:
        raise ConfigError(
            "a wheel is its axis, largest torque (N m), largest momentum (N m s) and moment of inertia "
            f'(kg m^2), between semicolons, such as "0, 0, 1; 0.1; 0.7; 0.001", got {brief(text)}.'
        )
    x, y, z = numbers_of_text(parts[0], "the axis of a wheel", (3,))
    if dimension == 2 and (x or y):
        raise ConfigError(
            f"the axis of a wheel in the plane is 0, 0, 1 or 0, 0, -1, got {brief(text)}."
        )
    values = [
        positive_number(part, f"the {name} of a wheel")
        for part, name in zip(parts[1:], ("torque", "momentum", "inertia"), strict=True)
    ]
    return Wheel(_unit((x, y, z), text), *values)


def box_inertia(mass: float, size: Sequence[float]) -> tuple[tuple[float, float, float], ...]:
    """Inertia of a uniform box of this mass (kg) and size (x, y, z; m) about its centre, kg m^2.

    I_xx = m (y^2 + z^2) / 12, and I_yy and I_zz likewise. In the plane a box has only x and y; its I_zz does not
    depend on the height, for which the mean of x and y is taken.
    """
    x, y = size[:2]
    z = size[2] if len(size) == 3 else (x + y) / 2.0
    ix, iy, iz = (mass * (a * a + b * b) / 12.0 for a, b in ((y, z), (z, x), (x, y)))
    return ((ix, 0.0, 0.0), (0.0, iy, 0.0), (0.0, 0.0, iz))


def actuators_of(
    kind: str, counts: int | None, least: float | None, largest: float | None
) -> Actuators:
    """Actuators of a kind, with those of `counts`, `least` and `most` that the kind has.

    Raises:
        ConfigError: the kind is unknown, a number is missing or does not belong to the kind, or it is out of range.
    """
    if kind not in KINDS:
        raise ConfigError(f"actuators are {', '.join(KINDS)}, got {brief(kind)}.")
    names = {field.name for field in fields(KINDS[kind])}
    limits: dict[str, Any] = {"counts": counts, "least": least, "most": largest}
    for name, value in limits.items():
        if value is not None and name not in names:
            why = f" ({WHOLE_PERIODS})" if kind == "on-off" else ""
            raise ConfigError(f"{kind} actuators have no {name}: leave out {name} {value:g}{why}.")
    if kind == "pulsed":
        if counts is None:
            raise ConfigError(
                "pulsed actuators need counts: into how many steps valves divide a control period, such as 100."
            )
        if least is not None and least != int(least):
            raise ConfigError(
                f"least of pulsed actuators is a number of counts, a whole number, got {least:g}."
            )
        return Pulsed(counts, int(least or 0))
    if kind == "throttle":
        return Throttle(least or 0.0, 1.0 if largest is None else largest)
    return KINDS[kind]()


def commented(craft: Spacecraft, origin: Sequence[str]) -> str:
    """TOML text of a spacecraft with the unit and meaning of every number and a place for its source.

    Args:
        craft: spacecraft; `rans.model.spacecraft_file.parse_spacecraft` reads it back.
        origin: lines that say how the file was made.
    """
    return "\n".join(_lines(craft, origin)) + "\n"


def _lines(craft: Spacecraft, origin: Sequence[str]) -> Iterator[str]:
    """Lines of the file, each number with its unit and a place for its source."""
    yield from (f"# {Toml.word(line)}" for line in origin)
    yield "# G is any frame fixed to the body. Write the source of every number beside it, or that it is"
    yield "# estimated."
    yield from _body_lines(craft)
    yield ""
    yield "[actuators]"
    yield from _actuator_lines(craft.actuators)
    if craft.propellant is not None:
        yield ""
        yield "[propellant]"
        yield f"mass = {craft.propellant.mass!r}  # kg in a full tank, part of the craft's mass; source:"
        yield f"specific_impulse = {craft.propellant.specific_impulse!r}  # s; source:"
    for index, thruster in enumerate(craft.thrusters):
        yield ""
        yield f"[[thruster]]  # {index}"
        yield f"position = {list(thruster.position)}  # m, in G"
        yield f"direction = {list(thruster.direction)}  # of the force, opposite to the exhaust"
        yield f"force = {thruster.force!r}  # N, when open; source:"
        if len(craft.supplies) > 1:
            yield f"supply = {thruster.supply}  # which feeds it"
    for index, wheel in enumerate(craft.wheels):
        yield ""
        yield f"[[wheel]]  # {index}"
        yield f"axis = {list(wheel.axis)}  # in G"
        yield f"max_torque = {wheel.max_torque!r}  # N m, of the motor; source:"
        yield f"max_momentum = {wheel.max_momentum!r}  # N m s, about the axis; source:"
        yield f"inertia = {wheel.inertia!r}  # kg m^2, about the axis; source:"


def _body_lines(craft: Spacecraft) -> Iterator[str]:
    """Keys of the body: name, dimension, mass properties and what drawings need."""
    size = craft.dimension
    yield f"name = {Toml.value(craft.name)}"
    where = "x, y and heading" if size == 2 else "position and attitude"
    yield f"dimension = {size}          # {where}"
    yield f"mass = {craft.mass!r}  # kg; source:"
    if size == 2:
        yield f"inertia = {craft.inertia[2][2]!r}  # kg m^2 about the centre of mass; source:"
    else:
        rows = ", ".join(str(list(row)) for row in craft.inertia)
        yield f"inertia = [{rows}]  # kg m^2 about the centre of mass, axes of G; source:"
    yield f"centre_of_mass = {list(craft.centre_of_mass)}  # m, in G; source:"
    yield f"radius = {craft.radius!r}  # m, for drawings"
    yield f'shape = "{craft.shape}"  # for drawings'
    sharing = (
        "the open thrusters share the force of one"
        if craft.thrust_sharing == "split"
        else "every open thruster gives its full force"
    )
    yield f'thrust_sharing = "{craft.thrust_sharing}"  # {sharing}'


def _actuator_lines(actuators: Actuators) -> Iterator[str]:
    """Lines of a file with the keys of the actuators: their kind, its numbers and what they mean."""
    meanings = {
        "counts": "steps into which valves divide a control period",
        "least": "shortest pulse, counts"
        if actuators.kind == "pulsed"
        else "least level, a share of full force",
        "most": "largest level, a share of full force",
        "always_lit": "whether engines cannot be shut",
    }
    yield f'kind = "{actuators.kind}"'
    for field in fields(actuators):
        value = Toml.value(getattr(actuators, field.name))
        yield f"{field.name} = {value}  # {meanings[field.name]}; source:"


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, *z = values
    return (x, y, z[0] if z else 0.0)


def _unit(vector: tuple[float, float, float], text: str) -> tuple[float, float, float]:
    length = sum(x * x for x in vector) ** 0.5
    if length == 0.0:
        raise ConfigError(f"a direction or axis must not be zero, got {brief(text)}.")
    x, y, z = (component / length for component in vector)
    return (x, y, z)
