"""What a verdict is about, in words and units: conditions, requirement, length and starts of flights.

Pages that somebody signs state it by its content: a name such as "lab", or of a file, says nothing to a reader who
does not have it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np

from rans import Conditions
from rans.base.display import meanings
from rans.extend import (
    QUANTITIES,
    Scenario,
    Setup,
    Task,
    counted,
    is_constrained,
    last_fifth,
    leaves,
)
from rans.show.tables.listing import conditions_listing


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
        *(("a flight also fails", text) for text in _fails(setup)),
        ("length of a flight", length),
        ("starts", f"{starts(setup.task, begun)} (of {count})"),
        *([("safety filter", type(setup.guard).__name__)] if setup.guard else []),
        *(("conditions", row) for row in conditions_texts(setup.conditions or Conditions())),
    ]


def requirement(setup: Setup) -> str:
    """What a flight must do to count as solved, in words and units: `rans.episode.verdict` in a sentence."""
    task = setup.task
    bounds = ", ".join(
        f"{name} within {_number(QUANTITIES[name].display[0] * bound)} {QUANTITIES[name].display[1]}"
        for name, bound in task.tolerances().items()
    )
    kind = type(task)
    if task.can_be_won:
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
        unit = QUANTITIES[name].unit
        factor = 1.0
        if unit.startswith("rad"):
            unit = "deg" + unit[3:]
            factor = math.degrees(1.0)
        ranges.append(f"{name} error {_span(factor * np.asarray(error, dtype=float))} {unit}")
    speed = _size(begun.start.v)
    spin = _size(begun.start.w)
    ranges += [f"speed {_span(speed)} m/s", f"spin {_span(np.degrees(spin))} deg/s"]
    return ", ".join(ranges)


def conditions_texts(conditions: Conditions) -> Iterator[str]:
    """Every setting of conditions that is not nominal, by its name in a file, in SI units.

    Of a mixture there is a text for each part.
    """
    parts = (conditions, *conditions.others)
    total = sum(part.weight for part in parts)
    for part in parts:
        alone = replace(part, weight=Conditions().weight, others=())
        texts = [f"{name} {value}" for name, value, *_ in conditions_listing(alone).rows]
        if alone.or_none is None:
            texts = ["nominal conditions"]
        if conditions.others:
            share = _number(100.0 * part.weight / total)
            texts = [f"in {share} % of the flights: {'; '.join(texts)}"]
        yield from texts


def _fails(setup: Setup) -> Iterator[str]:
    """Bounds beyond which the task declares a flight failed, by its settings."""
    task = setup.task
    texts = meanings(type(task))
    elsewhere = " in space " if setup.craft.dimension == 2 else " in the plane "
    for setting in fields(task):  # type: ignore[arg-type]
        text = texts.get(setting.name, "")
        if setting.name.startswith("fail_") and text and elsewhere not in text:
            what = re.split(r"[.;] | \(|\.$", text)[0]
            yield f"{what[:1].lower()}{what[1:]}: {_number(getattr(task, setting.name))}"


def _size(vector: Any) -> np.ndarray:
    """Lengths of vectors, or sizes of numbers."""
    columns = [np.asarray(x, dtype=float) for x in leaves(vector)]
    return np.sqrt(sum(column**2 for column in columns))


def _span(values: np.ndarray) -> str:
    # Three digits, and rounding errors of states at rest are no motion.
    low, high = (f"{round(float(x), 6) + 0.0:.3g}" for x in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def _number(value: float) -> str:
    return f"{value:.4g}"
