"""Spacecraft from TOML files, read strictly: an unknown key is an error.

Errors name the key and its place; `to_toml` writes what this reads, and tests go both ways.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import shlex
import warnings
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rans.base.errors import (
    ConfigError,
    RansWarning,
    brief,
    is_finite,
    meant,
    meant_file,
    one_of,
    text_of_name,
)
from rans.base.files import distinct, first_line, read_text
from rans.base.languages import Toml
from rans.base.registry import Registry, typed
from rans.base.structure import LARGEST_TOML, read_toml, refuse_other_file, structure
from rans.model.actuators import KINDS, WHOLE_PERIODS, Actuators, OnOff, Propellant, Wheel
from rans.model.foreign import is_foreign
from rans.model.pace import misfits
from rans.model.spacecraft import Spacecraft, Thruster

_REQUIRED = ("name", "dimension", "mass", "inertia")
_VALUES = ("name", "mass", "inertia", "radius", "thrust_sharing", "shape")
"""Keys whose values `Spacecraft` has as they are, and refuses where they are wrong."""
_OPTIONAL = {*_VALUES, "centre_of_mass", "actuators", "propellant", "thruster", "wheel", "effector"}


class DescribedSpacecraft(NamedTuple):
    """A spacecraft and its TOML text."""

    text: str
    craft: Spacecraft


def _described(found: Any) -> DescribedSpacecraft:
    """Spacecraft with its text, from a TOML text, a `Spacecraft`, or a function that returns one."""
    if not isinstance(found, str):
        found = _made(found)
        found = to_toml(found)
    return DescribedSpacecraft(found, _build(read_toml(found)))


def _made(found: Any) -> Spacecraft:
    """Spacecraft from itself, from a function, or from a subclass of `Spacecraft`; nothing else is called."""
    is_function = callable(found) and not isinstance(found, type)
    if is_function or _is_spacecraft_class(found):
        try:
            found = found()
        except Exception as error:  # code of other packages may raise anything
            raise ConfigError(f"{type(error).__name__}: {first_line(error)}.") from error
    if not isinstance(found, Spacecraft):
        got = f"the class {found.__name__}" if isinstance(found, type) else type(found).__name__
        raise ConfigError(
            "it must be a rans.Spacecraft, a function that makes one, or a TOML file of "
            f"the package, got {got}."
        )
    return found


def _is_spacecraft_class(found: Any) -> bool:
    return isinstance(found, type) and issubclass(found, Spacecraft)


_UNREAD = {
    ".xml": "MJCF is not read; write it as URDF for `rans init FILE.toml --from FILE`",
    ".xacro": "xacro is a macro language; `xacro {name} > {stem}` writes the URDF that `rans init` reads",
    **dict.fromkeys(
        (".sdf", ".usd", ".usda", ".usdc", ".yaml", ".yml", ".json"),
        "it is not read, and URDF is; `rans init {stem}.toml` writes a file for the numbers of a spacecraft",
    ),
}
"""What to write for files of other software that no package reads, by their suffixes."""


def _instead(file: str) -> str:
    """What to write in place of a file of other software; empty: nothing is known of such files."""
    if is_foreign(file):
        return "`rans init {stem}.toml --from {name}` makes a spacecraft of the file"
    return _UNREAD.get(Path(file).suffix.lower(), "")


SPACECRAFT = Registry(
    "spacecraft",
    "rans.spacecraft",
    {
        name: "rans.data.spacecraft"
        for name in sorted(
            file.name.removesuffix(".toml")
            for file in (resources.files("rans") / "data/spacecraft").iterdir()
        )
    },
    _described,
    ", or a file whose name ends in .toml",
    files=_instead,
)
"""Spacecraft by name."""


def _effector_class(found: Any) -> Any:
    """The class, checked to be a dataclass with members of `rans.effectors.effector.Effector`."""
    members = ("commands", "stores", "largest_torque", "begin")
    has_all = isinstance(found, type) and all(hasattr(found, name) for name in members)
    if not has_all or not dataclasses.is_dataclass(found):
        raise ConfigError(
            "it must be a dataclass derived from rans.effectors.effector.Effector, got "
            f"{brief(found)}."
        )
    return found


EFFECTORS: Registry[Any] = Registry("kind of effector", "rans.effector", {}, _effector_class)
"""Kinds of effectors, registered by packages: a table with the name of a kind is an effector of a craft, and an
``[[effector]]`` table has it as its ``kind``."""


USUAL: dict[int, str] = {2: "floating-platform", 3: "free-flyer"}
"""Default spacecraft by dimension."""


def spacecraft_names() -> list[str]:
    """Names of the spacecraft of RANS and of installed packages.

    >>> from rans.model.spacecraft_file import spacecraft_names
    >>> "atmos" in spacecraft_names()
    True
    """
    return list(SPACECRAFT)


def load_spacecraft(name_or_file: str | Path | Spacecraft) -> Spacecraft:
    """Load a spacecraft by name (`spacecraft_names`), as MODULE:NAME, or from a path that ends in ``.toml``.

    A `Spacecraft` is returned as is.

    >>> rans.load_spacecraft("free-flyer")
    <Spacecraft free-flyer: 5.32 kg in space, thrusters 16 x 1 N>

    Raises:
        ConfigError: the name or file does not exist, or does not describe a spacecraft.
    """
    if isinstance(name_or_file, Spacecraft):
        return name_or_file
    registered = text_of_name("spacecraft", name_or_file, Spacecraft)
    return (
        read_spacecraft(Path(registered))
        if registered.endswith(".toml")
        else SPACECRAFT[registered].craft
    )


def read_spacecraft(file: Path) -> Spacecraft:
    """Spacecraft of a TOML file, such as that of a run folder or of an exported agent.

    Raises:
        ConfigError: the file cannot be read, or does not describe a spacecraft.
    """
    craft = parse_spacecraft(_file_text(str(file)), str(file))
    for misfit in misfits(craft):
        warnings.warn(f"spacecraft {craft.name!r}: {misfit}.", RansWarning, stacklevel=3)
    return craft


def spacecraft_text(name_or_file: str | Path) -> str:
    """TOML text that `load_spacecraft` reads for a name or path.

    Raises:
        ConfigError: the name does not exist, or the file cannot be read.
    """
    name = str(name_or_file)
    return _file_text(name) if name.endswith(".toml") else SPACECRAFT[name].text


def _file_text(given: str) -> str:
    """Text of a user's file, of limited size."""
    file = Path(given)
    if not os.path.exists(file) and not meant_file(file):
        _, _, alone = given.rpartition("@")
        if os.path.exists(alone):
            raise ConfigError(f"name the spacecraft alone, {alone}, not {given}.")
        raise ConfigError(
            f"there is no spacecraft file {given}: `rans init {shlex.quote(given)}` writes one to change, and "
            "`rans list SPACECRAFT` prints the names of those that come with RANS."
        )
    return read_text(file, LARGEST_TOML, "the spacecraft file ")


def parse_spacecraft(text: str, source: str) -> Spacecraft:
    """Spacecraft from a TOML text; messages begin with the source.

    Its keys are the fields of `Spacecraft`, with the tables

    - ``[[thruster]]`` for each thruster,
    - ``[actuators]`` with the ``kind`` of the actuators and its settings,
    - ``[[wheel]]`` for each reaction wheel,
    - ``[propellant]`` if thrusters use propellant,
    - a table with the name of a kind of `EFFECTORS`, such as ``[slosh]``, for a further effector of this kind,
    - ``[[effector]]`` for each further effector, with its ``kind`` (of `EFFECTORS`, or MODULE:NAME) and settings,

    A planar spacecraft may have positions and directions of two numbers, and its inertia as one number.

    Raises:
        ConfigError: a key or value is wrong; the message names the source, the key, the value and the bound.
    """
    try:
        table = read_toml(text)
        refuse_other_file(table, "spacecraft")
        return _build(table)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error


def spacecraft_label(craft: Spacecraft) -> str:
    """Label of a spacecraft in file names: its name, with a digest unless it comes with RANS."""
    text = to_toml(craft)
    if SPACECRAFT.comes_with_rans(craft.name) and to_toml(SPACECRAFT[craft.name].craft) == text:
        return craft.name
    return distinct(craft.name, text)


def to_toml(craft: Spacecraft) -> str:
    """TOML text from which `parse_spacecraft` reads the same spacecraft, up to rounding of directions.

    Agents' folders have this text, and stored certificates its digest: a new key must be left out at its default.
    """
    return "\n".join(f"{heading}{_lines(table)}" for heading, table in sections(craft))


def sections(craft: Spacecraft, every: bool = False) -> Iterator[tuple[str, dict[str, Any]]]:
    """Tables of the file of a craft with their headings, in order.

    Args:
        craft: any.
        every: whether settings of actuators that have their defaults are among them.
    """
    table: dict[str, Any] = dataclasses.asdict(craft)
    parts = {key: table.pop(key) for key in ("actuators", "propellant", "thrusters", "wheels")}
    del table["further_effectors"]
    yield "", table
    usual = {} if every or craft.actuators.kind == "pulsed" else vars(type(craft.actuators))
    settings = {
        key: x for key, x in parts["actuators"].items() if key not in usual or x != usual[key]
    }
    yield "[actuators]\n", {"kind": craft.actuators.kind} | settings
    if (tank := parts["propellant"]) is not None:
        if tank["position"] is None:
            del tank["position"], tank["radius"]
        yield "[propellant]\n", tank
    for each in parts["thrusters"]:
        if len(craft.supplies) == 1:
            del each["supply"]
        yield "[[thruster]]\n", each
    for each in parts["wheels"]:
        yield "[[wheel]]\n", each
    for effector in craft.further_effectors:
        kind = effector_kind(effector)
        settings = dataclasses.asdict(effector)
        if kind in EFFECTORS:
            yield f"[{kind}]\n", settings
        else:
            typed(kind)  # which files of this process may then name
            yield "[[effector]]\n", {"kind": kind} | settings


def effector_kind(effector: object) -> str:
    """Kind of a further effector in files: its name in `EFFECTORS`, else MODULE:NAME."""
    for name in EFFECTORS:
        with contextlib.suppress(ConfigError):  # of a package that cannot be imported
            if EFFECTORS[name] is type(effector):
                return name
    return f"{type(effector).__module__}:{type(effector).__qualname__}"


def _lines(table: dict[str, Any]) -> str:
    """TOML lines of a table of texts, numbers and lists."""
    return "".join(f"{key} = {Toml.value(value)}\n" for key, value in table.items())


def _build(table: dict[str, Any]) -> Spacecraft:
    """The spacecraft of a table: keys and kinds of the values of parts are checked here, bounds by `Spacecraft`."""
    allowed = sorted({*_REQUIRED, *_OPTIONAL, *EFFECTORS})
    for key in table:
        if key not in allowed:
            raise ConfigError(
                f"unknown key {brief(key)} in the file{meant(key, allowed)}; known are {', '.join(allowed)}."
            )
    for key in _REQUIRED:
        if key not in table:
            raise ConfigError(f"the key {brief(key)} is missing.")
    flat = table["dimension"] != 3
    values = {key: _numbers(table[key]) for key in _VALUES if key in table}
    if not isinstance(moment := values["inertia"], tuple):
        values["inertia"] = ((moment, 0.0, 0.0), (0.0, moment, 0.0), (0.0, 0.0, moment))
    if "centre_of_mass" in table:
        values["centre_of_mass"] = _numbers(_vector(table["centre_of_mass"], flat))
    if "actuators" in table:
        values["actuators"] = _actuators(table["actuators"])
    if "propellant" in table:
        values["propellant"] = _part(Propellant, table["propellant"], "propellant", flat)
    named = [_part(EFFECTORS[kind], table[kind], kind, flat) for kind in EFFECTORS if kind in table]
    return Spacecraft(
        dimension=table["dimension"],
        thrusters=_parts(table, "thruster", lambda _: Thruster, flat),
        wheels=_parts(table, "wheel", lambda _: Wheel, flat),
        further_effectors=(*named, *_parts(table, "effector", _kind, flat)),
        **values,
    )


def _parts(
    table: dict[str, Any], key: str, kind: Callable[[dict[str, Any]], Any], flat: bool
) -> tuple[Any, ...]:
    """Parts of the tables ``[[key]]`` in their order; ``kind`` takes the class of a part from its table."""
    tables = table.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(each, dict) for each in tables):
        raise ConfigError(f"{key} must be [[{key}]] tables, got {brief(tables)}.")
    return tuple(
        _part(kind(each), each, f"{key} {index}", flat)
        for index, each in enumerate(map(dict, tables))
    )


def _kind(table: dict[str, Any]) -> Any:
    """Class of an effector by its ``kind``, which is taken out of its table."""
    if "kind" not in table:
        raise ConfigError('every [[effector]] table has a key "kind".')
    return EFFECTORS[table.pop("kind")]


def _part(kind: Any, table: Any, where: str, flat: bool) -> Any:
    """Part of a craft of a class from its table, where vectors of planar craft may have two numbers (`_vector`)."""
    if not isinstance(table, dict):
        raise ConfigError(f"{where} must be a table, got {brief(table)}.")
    vectors = {
        field.name: _vector(table[field.name], flat, field.name in ("direction", "axis"))
        for field in dataclasses.fields(kind)
        if field.name in table and "tuple[float, float, float]" in str(field.type)
    }
    return structure(table | vectors, kind, where)


def _vector(value: Any, flat: bool, is_unit: bool = False) -> Any:
    """A vector of two numbers with z = 0 in the plane, and of unit length if one is meant; others as they are."""
    if not isinstance(value, list):
        return value
    if flat and len(value) == 2:
        value = [*value, 0.0]
    if not is_unit or len(value) != 3 or not all(map(is_finite, value)):
        return value
    length = math.hypot(*value)
    is_written = abs(length - 1.0) < 1e-15  # the rounding of a unit vector that was written
    return value if length == 0.0 or is_written else [x / length for x in value]


def _numbers(value: Any) -> Any:
    """Lists as tuples and whole numbers as real ones; all else as it is, for `Spacecraft` to refuse."""
    if isinstance(value, list):
        return tuple(map(_numbers, value))
    return float(value) if type(value) is int and is_finite(value) else value


def _actuators(table: Any) -> Actuators:
    """The kind of valves of a file with its numbers, by `KINDS`; unknown kinds and keys are refused."""
    if not isinstance(table, dict) or "kind" not in table:
        raise ConfigError(f'actuators must be a table with the key "kind", got {brief(table)}.')
    settings = dict(table)
    kind = settings.pop("kind")
    one_of("the kind of actuators", kind, KINDS)
    where = f"actuators of the kind {brief(kind)}"
    if KINDS[kind] is OnOff and settings:
        raise ConfigError(f"unknown key {brief(next(iter(settings)))} in {where}: {WHOLE_PERIODS}.")
    return structure(settings, KINDS[kind], where)
