"""A start and a goal of one's own, as KEY=VALUE or a TOML file, in place of a scenario's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rans.errors import ConfigError, meant
from rans.files import read_text
from rans.model.dynamics import State
from rans.model.fields import leaves, unflatten
from rans.structure import LARGEST_TOML, read_toml

NAMES = {
    6: ["p.x", "p.y", "heading", "v.x", "v.y", "w"],
    13: ["p.x", "p.y", "p.z", "q.w", "q.x", "q.y", "q.z", "v.x", "v.y", "v.z", "w.x", "w.y", "w.z"],
}
"""Names of a state's values, by how many it has: position and velocity in W (m, m/s), heading (rad) or the
unit quaternion R_WB, angular velocity (rad/s, in space on B)."""


def endpoint(words: Sequence[str], like: State) -> State:
    """The state that a user names; what is not named is zero, the attitude none.

    Args:
        words: texts such as "p.x=3" and "heading=1.57", or one TOML file with these keys (``[p]`` with ``x = 3``
            is "p.x=3").
        like: a state of floats; its notes and stores stay.

    Raises:
        ConfigError: a file cannot be read, there is no such key, or a value is no finite number.
    """
    motion = replace(like, notes=None, stores=())
    names = NAMES[len(leaves(motion))]
    values = dict.fromkeys(names, 0.0)
    pairs = _pairs(words)
    if "q.w" in values and not any(key.startswith("q.") for key, _ in pairs):
        values["q.w"] = 1.0
    for key, text in pairs:
        if key not in values:
            raise ConfigError(
                f"a state has no {key!r}{meant(key, names)}; its values are {', '.join(names)}."
            )
        try:
            values[key] = math.nan if isinstance(text, bool) else float(text)
        except (TypeError, ValueError):
            values[key] = math.nan
        if not math.isfinite(values[key]):
            raise ConfigError(f"{key} must be a finite number, got {text!r}.")
    result = unflatten(motion, list(values.values()))
    if "q.w" in values and not math.isclose(sum(x * x for x in leaves(result.attitude)), 1.0):
        size = math.sqrt(sum(x * x for x in leaves(result.attitude)))
        if size == 0.0:
            raise ConfigError("the quaternion q.w, q.x, q.y, q.z must not be zero.")
        attitude = unflatten(result.attitude, [x / size for x in leaves(result.attitude)])
        result = replace(result, attitude=attitude)
    return replace(result, notes=like.notes, stores=like.stores)


def _pairs(words: Sequence[str]) -> list[tuple[str, Any]]:
    """Keys and values of words such as "p.x=3", or of a TOML file."""
    if len(words) == 1 and "=" not in words[0]:
        try:
            table = read_toml(read_text(Path(words[0]), LARGEST_TOML))
        except ConfigError as error:
            raise ConfigError(
                "a state is KEY=VALUE ..., such as p.x=3 p.y=1 heading=0.7 (m, rad), or a TOML file with these "
                f"keys: {error}"
            ) from error
        return [
            (f"{key}.{inner}" if inner else key, number)
            for key, value in table.items()
            for inner, number in (value.items() if isinstance(value, dict) else [("", value)])
        ]
    pairs = []
    for text in words:
        key, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"a state is KEY=VALUE ..., such as p.x=3, got {text!r}.")
        if key in dict(pairs):
            raise ConfigError(f"a state has each value once, but {key} is given twice.")
        pairs.append((key, value))
    return pairs
