"""Conditions by name, and from TOML files, read strictly: an unknown key is an error."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rans.base.display import default
from rans.base.errors import ConfigError, brief, text_of_name
from rans.base.files import distinct, read_text
from rans.base.languages import Toml
from rans.base.registry import Registry, resolve
from rans.base.structure import LARGEST_TOML, merged, read_toml, refuse_other_file, structure
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.randomization.plausible import warn_of_implausible


class DescribedConditions(NamedTuple):
    """Conditions and their TOML text."""

    text: str
    conditions: Conditions


def _described(entry: Any) -> DescribedConditions:
    """Conditions with their text, from a TOML text or from `Conditions`."""
    if isinstance(entry, str):
        table = read_toml(entry)
        refuse_other_file(table, "conditions")
        table = _inherited(table)
        return DescribedConditions(entry, structure(table, Conditions, "conditions"))
    if not isinstance(entry, Conditions):
        raise ConfigError(
            "conditions must be rans.Conditions or a TOML file of the package, got "
            f"{type(entry).__name__}."
        )
    return DescribedConditions(conditions_text(entry), entry)


def _inherited(table: dict[str, Any]) -> dict[str, Any]:
    """Table of conditions, merged over that of its ``base`` (the name of conditions of RANS).

    It takes ``base`` out of the table that it is given.
    """
    others = table.get("others")
    if isinstance(others, list):
        others = [
            _inherited(component) if isinstance(component, dict) else component
            for component in others
        ]
        table = table | {"others": others}
    base = table.pop("base", None)
    if base is None:
        return table
    if not isinstance(base, str) or base not in CONDITIONS.built_in:
        built_in_names = ", ".join(CONDITIONS.built_in)
        raise ConfigError(
            f"base must be the name of conditions that come with RANS, one of {built_in_names}, got "
            f"{brief(base)}."
        )
    return merged(_inherited(read_toml(resolve(CONDITIONS.built_in[base], base))), table)


CONDITIONS = Registry(
    "set of conditions",
    "rans.conditions",
    {
        name: "rans.data.conditions"
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
            "raft",
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
"""Conditions by name."""


def load_conditions(
    name_or_file: str | Path | Conditions, craft: Spacecraft | None = None
) -> Conditions:
    """Load conditions by name (`CONDITIONS`), as MODULE:NAME, or from a path that ends in ``.toml``.

    >>> rans.load_conditions("lab").body.mass
    (0.75, 1.25)

    `Conditions` are returned as is.

    Keys of the file are those of `Conditions`: tables ``[body]``, ``[thrusters]``, ``[faults]``,
    ``[disturbances]``, ``[sensors]`` and ``[sensors.position]`` etc. with numbers or
    [least, largest]. The key ``base`` names conditions of RANS, whose values apply where the file has none.

    Args:
        name_or_file: see above.
        craft: spacecraft that is flown under them: values that are hardly meant for it, such as milliseconds in
            place of seconds, are warned of. `Conditions` are not doubted.

    Raises:
        ConfigError: the name or file does not exist, or does not describe conditions.
    """
    if isinstance(name_or_file, Conditions):
        return name_or_file
    source = text_of_name("conditions", name_or_file, Conditions)
    if not source.endswith(".toml"):
        conditions = CONDITIONS[source].conditions
    else:
        text = read_text(Path(source), LARGEST_TOML)
        try:
            conditions = _described(text).conditions
        except ConfigError as error:
            raise ConfigError(f"{source}: {error}") from error
    if craft is not None:
        warn_of_implausible(conditions, craft)
    return conditions


def conditions_label(name_or_file: str, conditions: Conditions) -> str:
    """Label of conditions in file names: their name, or that of their own file with a digest."""
    if name_or_file.endswith(".toml"):
        return distinct(Path(name_or_file).stem, conditions_text(conditions))
    return distinct(name_or_file)


def conditions_text(conditions: Conditions) -> str:
    """TOML text from which `load_conditions` reads the same conditions: the values that are not defaults."""
    lines = "".join(f"{key} = {_inline(value)}\n" for key, value in _changed(conditions).items())
    return lines or "# Everything as designed and told.\n"


def _changed(settings: Any) -> dict[str, Any]:
    """Fields that differ from their defaults, with nested dataclasses as nested tables."""
    values = {
        setting_field.name: getattr(settings, setting_field.name)
        for setting_field in fields(settings)
        if getattr(settings, setting_field.name) != default(setting_field)
    }
    return {key: _changed(x) if is_dataclass(x) else x for key, x in values.items()}


def _inline(value: Any) -> str:
    """Value in one line of TOML, whose basic strings have the escapes of JSON."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_inline(x)}' for key, x in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    if is_dataclass(value):
        return _inline(_changed(value))
    if isinstance(value, str):
        return Toml.value(value)
    return repr(float(value)) if isinstance(value, float) else repr(value)
