"""Commented spacecraft files from a few numbers, as `rans init` writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields

from rans.languages import Toml
from rans.model.actuators import Actuators
from rans.model.spacecraft import Spacecraft


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
        if craft.propellant.position is not None:
            yield f"position = {list(craft.propellant.position)}  # m, of the tank in G"
            yield f"radius = {craft.propellant.radius!r}  # m, of the tank"
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
