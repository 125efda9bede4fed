"""Lower bounds of what missions spend, beside flights: impulse in orbits, propellant of landings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rans.evaluation.compare.contest import Entry
from rans.evaluation.measure.metrics import propellant_used
from rans.extend import counted, impulses

_ROUNDING = 1e-6
"""Relative error of what is spent and of a bound by rounding."""


@dataclass(frozen=True)
class MissionBounds:
    """Lower bounds for the first starts of a comparison.

    On an orbit they are of the impulse, without limits such as cones and keep-out balls, and of inspections too. Of
    landings they are of the propellant, within the limits of the task, for a craft that has to turn and whose
    engines may be throttled one by one.
    """

    lower: np.ndarray
    """(n,) of success from each of the first n starts, on an orbit by its deadline; infinite: there is none."""
    spending: Literal["impulse", "propellant"] = "impulse"
    """What is bounded: impulse, N s, or propellant, kg."""
    deadlines: Sequence[float] | None = None
    """(n,) s: deadline of each of these starts; None: the end of the episode."""

    @property
    def unit(self) -> str:
        """Unit of the bounds: N s for impulse, kg for propellant."""
        return "N s" if self.spending == "impulse" else "kg"

    def spent(self, entry: Entry) -> np.ndarray:
        """Impulse, N s, or propellant, kg, of the first n flights (n,)."""
        amounts = impulses if self.spending == "impulse" else propellant_used
        return amounts(entry.flight)[: len(self.lower)]

    def over(self, entry: Entry) -> np.ndarray:
        """Ratio of cost to the lower bound of the same start, (n,); NaN without a success, or for a bound of 0."""
        lower = np.where(self.lower > 0.0, self.lower, np.nan)
        return np.where(entry.won[: len(self.lower)], self.spent(entry) / lower, np.nan)

    def ratios(self, entry: Entry) -> np.ndarray:
        """Ratio of cost to the bound (> 0) of the same start, for those of the first n flights that succeeded."""
        over = self.over(entry)
        return over[~np.isnan(over)]

    def table(self, entries: Sequence[Entry]) -> tuple[tuple[str, ...], list[list[str]]]:
        """Headings, and a row for each start: deadline, bound, and what each contestant spent, with the ratio."""
        rows = []
        over = [self.over(entry) for entry in entries]
        for k, lower in enumerate(self.lower):
            cells = [
                self._cell(entry, k, float(ratio[k]))
                for entry, ratio in zip(entries, over, strict=True)
            ]
            deadline = [] if self.deadlines is None else [f"{self.deadlines[k]:,.0f}"]
            least = f"{lower:.3g}" if math.isfinite(lower) else "impossible"
            rows.append([str(k), *deadline, least, *cells])
        headings = ["start"] if self.deadlines is None else ["start", "deadline, s"]
        return (*headings, f"least {self.spending}, {self.unit}", *(e.name for e in entries)), rows

    def _cell(self, entry: Entry, k: int, ratio: float) -> str:
        """Text of the cost of a contestant from a start, and its ratio to the bound, if there is one."""
        if not entry.won[k]:
            return "did not succeed"
        spent = f"{self.spent(entry)[k]:.3g}"
        return spent if math.isnan(ratio) else f"{spent} ({ratio:.3f})"

    def sentence(self, entries: Sequence[Entry]) -> str:
        """Mean ratio of every contestant's spending to the bound, and of how many starts, in a sentence."""
        parts = []
        for entry in entries:
            ratios = self.ratios(entry)
            mean = f"{ratios.mean():.4g}" if len(ratios) else "none succeeded"
            some = f" ({len(ratios)})" if 0 < len(ratios) < len(self.lower) else ""
            parts.append(f"{entry.name} {mean}{some}")
        return (
            f"{self.spending.capitalize()} over the certified least, mean of successes from the first "
            f"{counted(len(self.lower), 'start')}: {', '.join(parts)}."
        )

    def impossible(self, entries: Sequence[Entry]) -> list[str]:
        """Sentences about flights below their bound, each of which would prove an error in the package."""
        return [
            f"{entry.name} beats the certified least {self.spending}: the bound or the flight is wrong."
            for entry in entries
            if np.any(self.ratios(entry) < 1.0 - _ROUNDING)
        ]

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.base.files.write_json`; what is impossible is None.

        Keys are an interface of files of comparisons.
        """
        return {
            "spending": self.spending,
            "deadlines": self.deadlines,
            "lower": [x if np.isfinite(x) else None for x in self.lower.tolist()],
        }
