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
from collections.abc import Callable, Collection
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rans.errors import ConfigError, RansWarning, brief, meant, meant_file, text_of_name
from rans.files import distinct, first_line, read_text
from rans.languages import Toml
from rans.model.actuators import KINDS, WHOLE_PERIODS, Actuators, OnOff, Propellant, Wheel
from rans.model.foreign import FORMATS
from rans.model.pace import misfits
from rans.model.spacecraft import Spacecraft, Thruster
from rans.registry import Registry, typed
from rans.structure import LARGEST_TOML, read_toml, refuse_other_file, structure

_REQUIRED = ("name", "dimension", "mass", "inertia")
_OPTIONAL = {"thruster", "wheel", "effector"} | {f.name for f in dataclasses.fields(Spacecraft)} - {
    "thrusters",
    "wheels",
    "further_effectors",
    *_REQUIRED,
}


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
    files={
        **dict.fromkeys(
            FORMATS, "`rans init {stem}.toml --from {name}` makes a spacecraft of the file"
        ),
        ".xml": "MJCF is not read; write it as URDF for `rans init FILE.toml --from FILE`",
        ".xacro": "xacro is a macro language; `xacro {name} > {stem}` writes the URDF that `rans init` reads",
        **dict.fromkeys(
            (".sdf", ".usd", ".usda", ".usdc", ".yaml", ".yml", ".json"),
            "it is not read; `rans init {stem}.toml` writes a file for the numbers of a spacecraft",
        ),
    },
)
"""Spacecraft by name."""


def _effector_class(found: Any) -> Any:
    """The class, checked to be a dataclass with the members of `rans.model.spacecraft.FurtherEffector`."""
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
    table: dict[str, Any] = dataclasses.asdict(craft)
    del table["further_effectors"]
    defaults = {f.name: f.default for f in dataclasses.fields(craft.actuators)}
    entries = table.pop("actuators").items()
    actuators = {"kind": craft.actuators.kind} | {
        key: value
        for key, value in entries
        if value != defaults[key] or craft.actuators.kind == "pulsed"
    }
    tank = table.pop("propellant")
    if tank is not None and tank["position"] is None:
        del tank["position"], tank["radius"]
    propellant = "" if tank is None else f"\n[propellant]\n{_lines(tank)}"
    wheels = "".join(f"\n[[wheel]]\n{_lines(each)}" for each in table.pop("wheels"))
    single = len(craft.supplies) == 1
    thrusters = "".join(
        "\n[[thruster]]\n"
        + _lines({key: value for key, value in each.items() if not (single and key == "supply")})
        for each in table.pop("thrusters")
    )
    further = "".join(_effector_lines(effector) for effector in craft.further_effectors)
    tables = f"{propellant}{thrusters}{wheels}{further}"
    return f"{_lines(table)}\n[actuators]\n{_lines(actuators)}{tables}"


def effector_kind(effector: object) -> str:
    """Kind of a further effector in files: its name in `EFFECTORS`, else MODULE:NAME."""
    for name in EFFECTORS:
        with contextlib.suppress(ConfigError):  # of a package that cannot be imported
            if EFFECTORS[name] is type(effector):
                return name
    return f"{type(effector).__module__}:{type(effector).__qualname__}"


def _effector_lines(effector: Any) -> str:
    """Table of a further effector as TOML lines; a kind of no package is then allowed in files of this process."""
    settings = dataclasses.asdict(effector)
    kind = effector_kind(effector)
    if kind in EFFECTORS:
        return f"\n[{kind}]\n{_lines(settings)}"
    typed(kind)
    return f"\n[[effector]]\n{_lines({'kind': kind} | settings)}"


def _lines(table: dict[str, Any]) -> str:
    """TOML lines of a table of texts, numbers and lists."""
    return "".join(f"{key} = {Toml.value(value)}\n" for key, value in table.items())


def _build(table: dict[str, Any]) -> Spacecraft:
    # Tables with the name of a kind of effector.
    """The spacecraft of a table whose keys are known; every value is read by its own reader."""
    kinds = [kind for kind in EFFECTORS if kind in table]
    _check_keys(table, _REQUIRED, {*_OPTIONAL, *EFFECTORS}, "the file", "")
    lengths = (3,) if table["dimension"] == 3 else (2, 3)
    named = tuple(_effector(table[kind], kind, kind, lengths) for kind in kinds)
    readers: dict[str, Callable[[Any, str], Any]] = {
        "name": _text,
        "dimension": lambda value, _: value,
        "mass": _number,
        "inertia": _inertia,
        "thruster": partial(_thrusters, lengths=lengths),
        "centre_of_mass": partial(_vector, lengths=lengths),
        "radius": _number,
        "actuators": _actuators,
        "propellant": partial(_propellant, lengths=lengths),
        "wheel": _wheels,
        "effector": partial(_further, lengths=lengths),
        "thrust_sharing": _text,
        "shape": _text,
    }
    values = {key: read(table[key], key) for key, read in readers.items() if key in table}
    return Spacecraft(
        thrusters=values.pop("thruster", ()),
        wheels=values.pop("wheel", ()),
        further_effectors=(*named, *values.pop("effector", ())),
        **values,
    )


def _thrusters(tables: Any, key: str, lengths: tuple[int, ...]) -> tuple[Thruster, ...]:
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError(f"{key} must be [[thruster]] tables, got {brief(tables)}.")
    return tuple(_thruster(table, index, lengths) for index, table in enumerate(tables))


def _thruster(table: dict[str, Any], index: int, lengths: tuple[int, ...]) -> Thruster:
    """Thruster of the table with this number; a direction gets unit length, vectors have one of ``lengths``."""
    where = f"thruster {index}"
    _check_keys(table, ("direction", "force", "position"), ("supply",), where, f"{where}: ")
    direction = _unit(table["direction"], f"{where} direction", lengths)
    return Thruster(
        _vector(table["position"], f"{where} position", lengths),
        direction,
        _number(table["force"], f"{where} force"),
        table.get("supply", 0),
    )


def _unit(value: Any, key: str, lengths: tuple[int, ...]) -> tuple[float, float, float]:
    """Unit vector along a direction of any length."""
    direction = _vector(value, key, lengths)
    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0):
        raise ConfigError(f"{key} must be finite and not zero, got {brief(direction)}.")
    if abs(length - 1.0) < 1e-15:  # the rounding of a unit vector that was written
        length = 1.0
    return (direction[0] / length, direction[1] / length, direction[2] / length)


def _wheels(tables: Any, key: str) -> tuple[Wheel, ...]:
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError(f"{key} must be [[wheel]] tables, got {brief(tables)}.")
    return tuple(_wheel(table, index) for index, table in enumerate(tables))


def _wheel(table: dict[str, Any], index: int) -> Wheel:
    where = f"wheel {index}"
    names = ("axis", "max_torque", "max_momentum", "inertia")
    _check_keys(table, names, (), where, f"{where}: ")
    numbers = (_number(table[name], f"{where} {name}") for name in names[1:])
    return Wheel(_unit(table["axis"], f"{where} axis", (3,)), *numbers)


def _effector(table: Any, key: str, kind: str, lengths: tuple[int, ...]) -> Any:
    """Further effector of a kind from its settings.

    A vector of two numbers, where the craft has such (`lengths`), is one of three whose last is zero; a setting
    "direction" may have any length.
    """
    if not isinstance(table, dict):
        raise ConfigError(f"{key} must be a table, got {brief(table)}.")
    made = EFFECTORS[kind]
    vectors = {
        field.name: table[field.name]
        for field in dataclasses.fields(made)
        if field.name in table and str(field.type) == "tuple[float, float, float]"
    }
    read = {
        name: list((_unit if name == "direction" else _vector)(value, f"{key} {name}", lengths))
        for name, value in vectors.items()
    }
    return structure(table | read, made, key)


def _further(tables: Any, key: str, lengths: tuple[int, ...]) -> tuple[Any, ...]:
    """Effectors of the tables ``[[effector]]`` in their order, which is that of their commands."""
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigError(f"{key} must be [[effector]] tables, got {brief(tables)}.")
    parts = []
    for index, table in enumerate(tables):
        where = f"effector {index}"
        if "kind" not in table:
            raise ConfigError(f'{where}: the key "kind" is missing.')
        kind = _text(table["kind"], f"{where} kind")
        settings = {name: value for name, value in table.items() if name != "kind"}
        parts.append(_effector(settings, where, kind, lengths))
    return tuple(parts)


def _propellant(table: Any, key: str, lengths: tuple[int, ...]) -> Propellant:
    if not isinstance(table, dict):
        raise ConfigError(f"{key} must be a table, got {brief(table)}.")
    _check_keys(table, ("mass", "specific_impulse"), ("position", "radius"), key, f"{key}: ")
    values: dict[str, Any] = {
        name: _vector(value, f"{key} {name}", lengths)
        if name == "position"
        else _number(value, f"{key} {name}")
        for name, value in table.items()
    }
    return Propellant(**values)


def _actuators(table: Any, key: str) -> Actuators:
    """The kind of valves of a file with its numbers, by `KINDS`; unknown kinds and keys are refused."""
    if not isinstance(table, dict) or "kind" not in table:
        raise ConfigError(f'{key} must be a table with the key "kind", got {brief(table)}.')
    kind = KINDS.get(_text(table["kind"], "kind"))
    if kind is None:
        raise ConfigError(
            f"actuators have the kind {brief(table['kind'])}; known are {', '.join(KINDS)}."
        )
    settings = dataclasses.fields(kind)
    where = f"actuators of the kind {brief(table['kind'])}"
    further = [key for key in table if key != "kind"]
    if kind is OnOff and further:
        raise ConfigError(f"unknown key {brief(further[0])} in {where}: {WHOLE_PERIODS}.")
    needed = [field.name for field in settings if field.default is dataclasses.MISSING]
    _check_keys(table, needed, ["kind", *(field.name for field in settings)], where, f"{where}: ")
    return kind(**{key: value for key, value in table.items() if key != "kind"})


def _check_keys(
    table: dict[str, Any],
    needed: Collection[str],
    optional: Collection[str],
    where: str,
    prefix: str,
) -> None:
    """Reject unknown keys with the nearest allowed one, and tables without the required ones (`ConfigError`)."""
    allowed = sorted({*needed, *optional})
    for key in table:
        if key not in allowed:
            raise ConfigError(
                f"unknown key {brief(key)} in {where}{meant(key, allowed)}; known are {', '.join(allowed)}."
            )
    for key in needed:
        if key not in table:
            raise ConfigError(f"{prefix}the key {brief(key)} is missing.")


def _text(value: Any, key: str) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f"{key} must be a non-empty text, got {brief(value)}.")
    return value


def _number(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{key} must be a number, got {brief(value)}.")
    try:
        return float(value)
    except OverflowError as error:
        raise ConfigError(f"{key} is too large for a 64-bit float, got {brief(value)}.") from error


def _vector(value: Any, key: str, lengths: tuple[int, ...]) -> tuple[float, float, float]:
    """Vector of three numbers; if two are allowed, the third is zero."""
    if not isinstance(value, list) or len(value) not in lengths:
        count = " or ".join(map(str, lengths))
        raise ConfigError(f"{key} must be a list of {count} numbers, got {brief(value)}.")
    x, y, *z = (_number(each, key) for each in value)
    return (x, y, z[0] if z else 0.0)


def _inertia(value: Any, key: str) -> tuple[tuple[float, float, float], ...]:
    """Inertia tensor from three rows, or from one number for three equal principal moments."""
    if not isinstance(value, list):
        moment = _number(value, key)
        return ((moment, 0.0, 0.0), (0.0, moment, 0.0), (0.0, 0.0, moment))
    if len(value) != 3 or not all(isinstance(row, list) and len(row) == 3 for row in value):
        raise ConfigError(f"{key} must be one number or three rows of three, got {brief(value)}.")
    return tuple(_vector(row, key, (3,)) for row in value)
