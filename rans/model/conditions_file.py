"""Conditions by name, and from TOML files: strict, so that a misspelt key never passes for a default."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rans.errors import ConfigError
from rans.model.conditions import Conditions
from rans.registry import Registry
from rans.structure import read_toml, structure


def _checked(found: Any) -> Conditions:
    """A TOML text or `Conditions`."""
    if isinstance(found, str):
        return structure(read_toml(found), Conditions, "conditions")
    if not isinstance(found, Conditions):
        raise ConfigError("they must be rans.Conditions or a TOML file of the package, got "
                          f"{type(found).__name__}.")
    return found


CONDITIONS = Registry("conditions", "rans.conditions", {
    name: f"rans:data/conditions/{name}.toml" for name in ("perfect", "lab", "roboran", "orbit", "harsh")
}, _checked, ", or a file whose name ends in .toml")
"""All conditions that have a name."""


def load_conditions(name_or_file: str | Path) -> Conditions:
    """The conditions of this name, MODULE:NAME, or of a path that ends in ``.toml``.

    Keys of the file are those of `Conditions`: tables ``[body]``, ``[thrusters]``, ``[faults]``,
    ``[disturbances]``, ``[sensors]`` and ``[sensors.position]`` ... with numbers or [least, largest].

    Raises:
        ConfigError: no such name or file, or it does not describe conditions.
    """
    given = str(name_or_file)
    if not given.endswith(".toml"):
        return CONDITIONS[given]
    try:
        return _checked(Path(given).read_text("utf-8"))
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ConfigError(f"cannot read the conditions {given!r}: {error}.") from error
    except ConfigError as error:
        raise ConfigError(f"{given}: {error}") from error
