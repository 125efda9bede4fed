"""Conditions by name, and from TOML files: strict, so that a misspelt key never passes for a default."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rans.display import default
from rans.errors import ConfigError, brief, named
from rans.files import distinct, read_text
from rans.randomization.conditions import Conditions
from rans.registry import Registry, resolve
from rans.structure import LARGEST_TOML, merged, read_toml, structure


class Described(NamedTuple):
    """Conditions and the TOML text that they were made from."""

    text: str
    conditions: Conditions


def _described(found: Any) -> Described:
    """A TOML text or `Conditions`."""
    if isinstance(found, str):
        table = _inherited(read_toml(found))
        return Described(found, structure(table, Conditions, "conditions"))
    if not isinstance(found, Conditions):
        raise ConfigError(
            "they must be rans.Conditions or a TOML file of the package, got "
            f"{type(found).__name__}."
        )
    return Described(conditions_text(found), found)


def _inherited(table: dict[str, Any]) -> dict[str, Any]:
    """The table of conditions over that of its ``base``, by the name of conditions of the package."""
    others = table.get("others")
    if isinstance(others, list):
        others = [_inherited(one) if isinstance(one, dict) else one for one in others]
        table = table | {"others": others}
    base = table.pop("base", None)
    if base is None:
        return table
    if not isinstance(base, str) or base not in CONDITIONS.built_in:
        known = ", ".join(CONDITIONS.built_in)
        raise ConfigError(
            f"base must be the name of conditions that come with RANS, one of {known}, got "
            f"{brief(base)}."
        )
    return merged(_inherited(read_toml(resolve(CONDITIONS.built_in[base]))), table)


CONDITIONS = Registry(
    "set of conditions",
    "rans.conditions",
    {
        name: f"rans:data/conditions/{name}.toml"
        for name in (
            "perfect",
            "lab",
            "lab-dropouts",
            "roboran",
            "orbit",
            "real",
            "real-space",
            "astrobee",
            "harsh",
            "faults",
            "train-robust",
            "train-robust-pose-2d",
            "train-robust-pose-3d",
            "train-faults-2d",
            "train-faults-3d",
        )
    },
    _described,
    ", or a file whose name ends in .toml",
)
"""All conditions that have a name."""


def conditions_names() -> list[str]:
    """Names of the conditions that come with the package, and of those that others installed.

    >>> "lab" in rans.conditions_names()
    True
    """
    return list(CONDITIONS)


def load_conditions(name_or_file: str | Path | Conditions) -> Conditions:
    """The conditions of this name, MODULE:NAME, or of a path that ends in ``.toml``.

    >>> rans.load_conditions("lab").body.mass
    (0.75, 1.25)

    Given as such they are themselves.

    Keys of the file are those of `Conditions`: tables ``[body]``, ``[thrusters]``, ``[faults]``,
    ``[disturbances]``, ``[sensors]`` and ``[sensors.position]`` ... with numbers or [least, largest]. A key
    ``base`` names conditions that come with RANS, whose values hold where the file has none of its own.

    Raises:
        ConfigError: no such name or file, or it does not describe conditions.
    """
    if isinstance(name_or_file, Conditions):
        return name_or_file
    given = named("conditions", name_or_file, Conditions)
    if not given.endswith(".toml"):
        return CONDITIONS[given].conditions
    text = read_text(Path(given), LARGEST_TOML)
    try:
        return _described(text).conditions
    except ConfigError as error:
        raise ConfigError(f"{given}: {error}") from error


def conditions_label(name_or_file: str, conditions: Conditions) -> str:
    """What names of files tell conditions by: their name, or their own file's with a digest of them."""
    if name_or_file.endswith(".toml"):
        return distinct(Path(name_or_file).stem, conditions_text(conditions))
    return distinct(name_or_file)


def conditions_text(conditions: Conditions) -> str:
    """TOML text of which `load_conditions` makes the same conditions: what is not the default."""
    lines = "".join(f"{key} = {_inline(value)}\n" for key, value in _changed(conditions).items())
    return lines or "# Everything as designed and told.\n"


def _changed(given: Any) -> dict[str, Any]:
    """Fields that differ from their defaults; of a dataclass inside, those that differ in it."""
    values = {
        one.name: getattr(given, one.name)
        for one in fields(given)
        if getattr(given, one.name) != default(one)
    }
    return {key: _changed(x) if is_dataclass(x) else x for key, x in values.items()}


def _inline(value: Any) -> str:
    """A value in one line of TOML, whose basic strings escape as JSON's do."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_inline(x)}' for key, x in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    if isinstance(value, Conditions):
        return _inline(_changed(value))
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value)) if isinstance(value, float) else repr(value)
