"""Spacecraft from TOML files: strict, so that a misspelt key never passes for a default."""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from rans.errors import ConfigError
from rans.files import first_line
from rans.model.actuators import KINDS, Actuators
from rans.model.spacecraft import Spacecraft, Thruster
from rans.registry import Registry

_KEYS = {f.name for f in dataclasses.fields(Spacecraft)} - {"thrusters"} | {"thruster"}
_REQUIRED = ("name", "dimension", "mass", "inertia", "thruster")
_THRUSTER_KEYS = {"position", "direction", "force"}


class Described(NamedTuple):
    """A spacecraft and the TOML text that it was made from."""

    text: str
    craft: Spacecraft


def _described(found: Any) -> Described:
    """A TOML text, a `Spacecraft` or a function that makes one, in one form."""
    if not isinstance(found, str):
        try:
            found = found() if callable(found) else found
        except Exception as error:  # somebody else's code raises anything
            raise ConfigError(f"{type(error).__name__}: {first_line(error)}.") from error
        if not isinstance(found, Spacecraft):
            raise ConfigError("it must be a rans.Spacecraft, a function that makes one, or a TOML file of "
                              f"the package, got {type(found).__name__}.")
        found = to_toml(found)
    return Described(found, _build(_read_toml(found)))


SPACECRAFT = Registry("spacecraft", "rans.spacecraft", {
    name: f"rans:data/spacecraft/{name}.toml" for name in sorted(
        file.name.removesuffix(".toml") for file in (resources.files("rans") / "data/spacecraft").iterdir())
}, _described, ", or a file whose name ends in .toml")
"""Every spacecraft that has a name."""


def spacecraft_names() -> list[str]:
    """Names of the spacecraft that come with the package, and of those that others installed."""
    return SPACECRAFT.names()


def load_spacecraft(name_or_file: str | Path) -> Spacecraft:
    """The spacecraft of this name, or of this TOML file.

    Args:
        name_or_file: one of `spacecraft_names`, MODULE:NAME, or a path that ends in ``.toml``.

    Raises:
        ConfigError: no such name or file, or it does not describe a spacecraft.
    """
    given = str(name_or_file)
    return parse_spacecraft(_file_text(given), given) if given.endswith(".toml") else SPACECRAFT[given].craft


def spacecraft_text(name_or_file: str | Path) -> str:
    """The TOML text behind `load_spacecraft`.

    Raises:
        ConfigError: there is no such name, or no such readable file.
    """
    given = str(name_or_file)
    return _file_text(given) if given.endswith(".toml") else SPACECRAFT[given].text


def _file_text(given: str) -> str:
    try:
        return Path(given).read_text("utf-8")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ConfigError(f"cannot read the spacecraft file {given!r}: {error}.") from error


def parse_spacecraft(text: str, source: str) -> Spacecraft:
    """The spacecraft that a TOML text describes.

    Args:
        text: the file's content; its keys are the fields of `Spacecraft`, with one ``[[thruster]]``
            table per thruster, and ``[actuators]`` with their ``kind`` and its settings. Planar spacecraft
            may give positions and directions as two numbers and the inertia as one.
        source: what to call the text in messages.

    Raises:
        ConfigError: names the source, the key, the value and the bound.
    """
    try:
        return _build(_read_toml(text))
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error


def to_toml(craft: Spacecraft) -> str:
    """The TOML text that `parse_spacecraft` reads this spacecraft from, up to rounding of directions."""
    table: dict[str, Any] = dataclasses.asdict(craft)
    actuators = {"kind": craft.actuators.kind} | table.pop("actuators")
    thrusters = "".join(f"\n[[thruster]]\n{_lines(table)}" for table in table.pop("thrusters"))
    return f"{_lines(table)}\n[actuators]\n{_lines(actuators)}{thrusters}"


def _lines(table: dict[str, Any]) -> str:
    """Texts, numbers and lists of them are written in TOML as they are in JSON."""
    return "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in table.items())


def _read_toml(text: str) -> dict[str, Any]:
    try:
        table = tomllib.loads(text)
        repr(table)  # fails on an integer with too many digits to print: refuse it here
        return table
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"this is not valid TOML: {error}.") from error


def _build(table: dict[str, Any]) -> Spacecraft:
    _check_keys(table, _KEYS, "the file")
    for key in _REQUIRED:
        if key not in table:
            raise ConfigError(f"the key {key!r} is missing.")
    thrusters = table["thruster"]
    if not isinstance(thrusters, list) or not all(isinstance(t, dict) for t in thrusters):
        raise ConfigError(f"thruster must be [[thruster]] tables, got {thrusters!r}.")
    lengths = (3,) if table["dimension"] == 3 else (2, 3)
    values: dict[str, Any] = {
        "name": _text(table, "name"),
        "dimension": table["dimension"],
        "mass": _number(table["mass"], "mass"),
        "inertia": _inertia(table["inertia"]),
        "thrusters": tuple(_thruster(t, i, lengths) for i, t in enumerate(thrusters)),
    }
    if "centre_of_mass" in table:
        values["centre_of_mass"] = _vector(table["centre_of_mass"], "centre_of_mass", lengths)
    if "radius" in table:
        values["radius"] = _number(table["radius"], "radius")
    if "actuators" in table:
        values["actuators"] = _actuators(table["actuators"])
    for key in ("thrust_sharing", "shape"):
        if key in table:
            values[key] = _text(table, key)
    return Spacecraft(**values)


def _thruster(table: dict[str, Any], index: int, lengths: tuple[int, ...]) -> Thruster:
    _check_keys(table, _THRUSTER_KEYS, f"thruster {index}")
    for key in sorted(_THRUSTER_KEYS):
        if key not in table:
            raise ConfigError(f"thruster {index}: the key {key!r} is missing.")
    direction = _vector(table["direction"], f"thruster {index} direction", lengths)
    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0):
        raise ConfigError(f"thruster {index} direction must be finite and not zero, got {direction}.")
    return Thruster(
        position=_vector(table["position"], f"thruster {index} position", lengths),
        direction=(direction[0] / length, direction[1] / length, direction[2] / length),
        force=_number(table["force"], f"thruster {index} force"),
    )


def _actuators(table: Any) -> Actuators:
    if not isinstance(table, dict) or "kind" not in table:
        raise ConfigError(f'actuators must be a table with the key "kind", got {table!r}.')
    kind = KINDS.get(_text(table, "kind"))
    if kind is None:
        raise ConfigError(f"actuators have the kind {table['kind']!r}; known are {', '.join(KINDS)}.")
    settings: dict[str, Any] = {f.name: f for f in dataclasses.fields(kind)}
    _check_keys(table, {"kind", *settings}, f"actuators of the kind {table['kind']!r}")
    for key, field in settings.items():
        if key not in table and field.default is dataclasses.MISSING:
            raise ConfigError(f"actuators of the kind {table['kind']!r}: the key {key!r} is missing.")
    return kind(**{key: table[key] for key in settings if key in table})


def _check_keys(table: dict[str, Any], known: set[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise ConfigError(f"unknown key {key!r} in {where}; known are {', '.join(sorted(known))}.")


def _text(table: dict[str, Any], key: str) -> str:
    value = table[key]
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f"{key} must be a non-empty text, got {value!r}.")
    return value


def _number(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{key} must be a number, got {value!r}.")
    try:
        return float(value)
    except OverflowError as error:
        raise ConfigError(f"{key} is too large for a 64-bit float, got {value}.") from error


def _vector(value: Any, key: str, lengths: tuple[int, ...]) -> tuple[float, float, float]:
    """Three numbers; where two are allowed, the third is zero."""
    if not isinstance(value, list) or len(value) not in lengths:
        count = " or ".join(map(str, lengths))
        raise ConfigError(f"{key} must be a list of {count} numbers, got {value!r}.")
    numbers = [_number(x, key) for x in value]
    return (numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0)


def _inertia(value: Any) -> tuple[tuple[float, float, float], ...]:
    """A full tensor, or one number for a body whose three principal moments are equal."""
    if not isinstance(value, list):
        moment = _number(value, "inertia")
        return ((moment, 0.0, 0.0), (0.0, moment, 0.0), (0.0, 0.0, moment))
    if len(value) != 3 or not all(isinstance(row, list) and len(row) == 3 for row in value):
        raise ConfigError(f"inertia must be one number or three rows of three, got {value!r}.")
    return tuple(_vector(row, "inertia", (3,)) for row in value)
