"""What a verdict is about, in words and units: conditions, requirement, length and starts of flights.

Pages that somebody signs state it by its content: a name such as "lab", or of a file, says nothing to a reader who
does not have it.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from rans.display import default, meanings
from rans.extend import (
    QUANTITIES,
    Conditions,
    Scenario,
    Setup,
    Task,
    counted,
    is_constrained,
    last_fifth,
    leaves,
)

_NOMINAL = "nominal conditions"
_TOGETHER = {
    "faults.count": ("faults.kinds", "faults.time", "faults.among", "faults.share"),
    "faults.thrusters": ("faults.kinds", "faults.time", "faults.share"),
}
"""Settings that mean something with others, so that they are stated with these, though they are the defaults."""
_UNIT = re.compile(r", (N m s|N m|N s|rad/s|m/s|rad|N|m|s)(?=[;,.]| \(|$)")
"""A unit behind the first statement of a setting's docstring."""
_PARENTHESIS = re.compile(r" \([^()]*\)")


def scope(setup: Setup, begun: Scenario) -> list[tuple[str, str]]:
    """What flights of a setup are asked and under what, for people who were not there: what, and its content.

    Starts and goals have fields (N,).
    """
    timing = setup.timing
    length = (
        f"{_number(timing.episode_steps * timing.control_period)} s: {timing.episode_steps:,} control "
        f"periods of {_number(timing.control_period)} s"
    )
    count = counted(len(_size(begun.start.v)), "start")
    return [
        ("requirement", requirement(setup)),
        *(("a flight also fails", text) for text in _fails(setup.task)),
        ("length of a flight", length),
        ("starts", f"{starts(setup.task, begun)} (of {count})"),
        *([("safety filter", type(setup.guard).__name__)] if setup.guard else []),
        *(("conditions", row) for row in conditions_texts(setup.conditions or Conditions())),
    ]


def requirement(setup: Setup) -> str:
    """What a flight must do to count as solved, in words and units: `rans.verdict` in a sentence."""
    task = setup.task
    bounds = ", ".join(
        f"{name} within {_number(QUANTITIES[name].display[0] * bound)} {QUANTITIES[name].display[1]}"
        for name, bound in task.tolerances().items()
    )
    kind = type(task)
    if kind.done is not Task.done:
        won = (kind.done.__doc__ or "").strip().partition("\n")[0].rstrip(".")
        won = won.removeprefix("Whether ")
        text = f"the mission is won in time: {won[:1].lower()}{won[1:]}"
        if is_constrained(task):
            text += ", without a violated constraint"
        return text + (f" ({bounds})" if bounds else "")
    steps = setup.timing.episode_steps
    since = (steps - last_fifth(steps) + 1) * setup.timing.control_period
    return f"{bounds} of the goal at every step of the last fifth, from {_number(since)} s on"


def starts(task: Task, begun: Scenario) -> str:
    """Ranges of the errors, the speed and the spin of starts with fields (N,)."""
    ranges = []
    for name, error in task.errors(begun.start, begun.goal).items():
        # Distances and speeds of starts are too large for the centimetres of tolerances.
        unit, factor = _displayed(QUANTITIES[name].unit)
        ranges.append(f"{name} error {_span(factor * np.asarray(error, dtype=float))} {unit}")
    speed = _size(begun.start.v)
    spin = _size(begun.start.w)
    ranges += [f"speed {_span(speed)} m/s", f"spin {_span(np.degrees(spin))} deg/s"]
    return ", ".join(ranges)


def conditions_texts(conditions: Conditions) -> Iterator[str]:
    """Every range of conditions that differs from nominal, in words with its unit.

    Of a mixture what all of its parts have in common comes first, and then a text for each part.
    """
    parts = (conditions, *conditions.others)
    texts = [[*_ranges(dataclasses.replace(part, others=()))] for part in parts]
    common = [text for text in texts[0] if all(text in others for others in texts)]
    yield from common
    if len(parts) == 1:
        if not common:
            yield _NOMINAL
        return
    total = sum(part.weight for part in parts)
    for part, ranges in zip(parts, texts, strict=True):
        own = "; ".join(text for text in ranges if text not in common)
        yield f"in {_number(100.0 * part.weight / total)} % of the flights: {own or 'no more'}"


def _ranges(conditions: Conditions) -> Iterator[str]:
    """Settings of conditions that are not nominal, each with its range and unit, in words."""
    values = dict(_settings(conditions))
    changed = [name for name, (value, _, is_default) in values.items() if not is_default]
    named = dict.fromkeys(
        other for name in changed for other in (name, *_TOGETHER.get(name, ())) if other in values
    )
    if not {"stuck", "weak"} & {*conditions.faults.kinds}:
        named.pop("faults.share", None)
    for name in named:
        value, text, _ = values[name]
        what, unit, factor = meaning(name, text)
        yield f"{what}: {_value(value, factor)} {unit}".rstrip()


def _settings(settings: Any, prefix: str = "") -> Iterator[tuple[str, tuple[Any, str, bool]]]:
    """Name of every setting, with its value, its docstring, and whether it is the default."""
    texts = _meanings(type(settings))
    for setting in dataclasses.fields(settings):
        value = getattr(settings, setting.name)
        name = f"{prefix}{setting.name}"
        if dataclasses.is_dataclass(value):
            yield from _settings(value, f"{name}.")
        elif setting.name not in ("description", "weight", "others"):
            yield name, (value, texts.get(setting.name, ""), value == default(setting))


def meaning(name: str, text: str) -> tuple[str, str, float]:
    """What a setting of conditions is in words, the unit that readers know, "" for none, and its factor.

    Args:
        name: of the setting, such as thrusters.latency.
        text: its docstring.
    """
    where, _, last = name.rpartition(".")
    quantity = where.rpartition(".")[2]
    what, unit = _statement(text or name)
    if name == "sensors.delay":
        return what, "control periods", 1.0
    if quantity not in QUANTITIES:
        return what, *_displayed(unit)
    what = f"{quantity} reading: {what}"
    if last == "dropout":
        return what, "", 1.0
    factor, shown = QUANTITIES[quantity].display
    return what, f"{shown} per m" if last.endswith("_per_m") else shown, factor


def _statement(text: str) -> tuple[str, str]:
    """The first statement of a setting's docstring, and its unit, "" for none."""
    statement = re.split(r"[.;:](?: |$)", _PARENTHESIS.sub("", text))[0]
    unit = _UNIT.search(statement)
    said = statement[: unit.start()] if unit else statement.split(", ")[0]
    return said[:1].lower() + said[1:], unit[1] if unit else ""


def _displayed(unit: str) -> tuple[str, float]:
    """Angles in degrees, others as they are: the unit, and its factor."""
    return ("deg" + unit[3:], math.degrees(1.0)) if unit.startswith("rad") else (unit, 1.0)


def _fails(task: Task) -> Iterator[str]:
    """Bounds beyond which the task declares a flight failed, by its settings."""
    texts = _meanings(type(task))
    for setting in dataclasses.fields(task):  # type: ignore[arg-type]
        text = texts.get(setting.name, "")
        if setting.name.startswith("fail_") and text:
            what, unit = _statement(text)
            unit, factor = _displayed(unit)
            yield f"{what}: {_value(getattr(task, setting.name), factor)} {unit}".rstrip()


_meanings = cache(meanings)
"""Docstrings are read from the source, which takes as long as all the rest."""


def _size(vector: Any) -> np.ndarray:
    """Lengths of vectors, or sizes of numbers."""
    columns = [np.asarray(x, dtype=float) for x in leaves(vector)]
    return np.sqrt(sum(column**2 for column in columns))


def _span(values: np.ndarray) -> str:
    # Three digits, and rounding errors of states at rest are no motion.
    low, high = (f"{round(float(x), 6) + 0.0:.3g}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def _value(value: Any, factor: float = 1.0) -> str:
    if isinstance(value, tuple):
        is_range = len(value) == 2 and all(isinstance(x, float) for x in value)
        return (" to " if is_range else ", ").join(_value(x, factor) for x in value)
    if not isinstance(value, float):
        return str(value)
    # Radians in files are rounded, and would be degrees such as 0.5002.
    return _number(value) if factor == 1.0 else f"{factor * value:.3g}"


def _number(value: float) -> str:
    return f"{value:.4g}"
