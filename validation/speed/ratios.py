"""What says more than a figure alone: it as a share of the machine's bound."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from validation.speed.measurement import Measurement


@dataclass(frozen=True)
class Ratio:
    """Two figures of one machine, divided: medians of their repeats."""

    name: str
    value: float
    note: str = ""
    """What was divided."""


def bounds(measured: Sequence[Measurement]) -> Iterator[Ratio]:
    """Every figure that has a bound, as a share of it."""
    for m in measured:
        if m.value is not None and m.bound is not None:
            yield Ratio(
                f"{m.name}: share of {m.bound_name}",
                m.value / m.bound,
                f"{m.value:,.4g} of {m.bound:,.4g} {m.unit}",
            )
