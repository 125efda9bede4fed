"""Agreement of flights in Drake and in the fast engine, from the same starts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rans.evaluation.measure.metrics import final_errors, metric_definitions, settling_times, solved
from rans.evaluation.measure.statistics import RESAMPLES, SEED, Bootstrap, Estimate, share
from rans.flight import Flight
from rans.table import Table
from rans.tasks.quantities import QUANTITIES


@dataclass(frozen=True)
class Pair:
    """One quantity of the same episodes in both engines, with 95 % intervals."""

    name: str
    meaning: str
    unit: str
    fast: Estimate
    drake: Estimate
    bound: tuple[float, float] | None
    """Range in which the difference must lie; None: any."""

    @property
    def difference(self) -> float:
        """Value of Drake minus that of the fast engine; 0 if both are infinite."""
        fast = self.fast.value
        drake = self.drake.value
        return 0.0 if fast == drake else drake - fast

    @property
    def passed(self) -> bool | None:
        """Whether the engines agree; None if there is no bound."""
        return None if self.bound is None else self.bound[0] <= self.difference <= self.bound[1]


@dataclass(frozen=True)
class EngineComparison:
    """Comparison of the flights of a controller in both engines."""

    title: str
    pairs: tuple[Pair, ...]
    same_commands: float
    """Share of control periods with the same commands in both engines."""

    @property
    def passed(self) -> bool:
        """Whether the engines agree in every quantity with a bound."""
        return all(pair.passed is not False for pair in self.pairs)

    def to_json(self) -> dict[str, Any]:
        """Content of "both" in evaluation.json: values of both engines with 95 % intervals, and verdicts.

        Readers of evaluation.json rely on the keys.
        """
        pairs = [
            {
                "name": p.name,
                "meaning": p.meaning,
                "unit": p.unit,
                "fast": p.fast.value,
                "fast_interval": (p.fast.low, p.fast.high),
                "drake": p.drake.value,
                "drake_interval": (p.drake.low, p.drake.high),
                "difference": p.difference,
                "bound": p.bound,
                "passed": p.passed,
            }
            for p in self.pairs
        ]
        return {
            "title": self.title,
            "passed": self.passed,
            "same_commands": self.same_commands,
            "bootstrap": {"resamples": RESAMPLES, "seed": SEED},
            "pairs": pairs,
        }

    def table(self) -> Table:
        """Row for each pair of values, with the gap and what is allowed; the reason stands below."""
        columns = ("quantity", "fast (95 %)", "Drake (95 %)", "gap", "allowed", "verdict")
        return Table(
            columns,
            [*map(_texts, self.pairs)],
            self.title,
            f"In {self.same_commands:.2%} of all control periods both opened the same thrusters.",
        )


def compare_engines(fast: Flight, drake: Flight) -> EngineComparison:
    """Compare flights of the same controller from the same starts, in the fast engine and in Drake.

    Drake's solved share must lie within the fast engine's 95 % interval, its medians within
    `engine_difference` (`rans.tasks.quantities.Quantity`) of the fast engine's.
    """
    episodes = fast.commands.shape[1]
    median = Bootstrap(episodes).median
    # Success: the engines agree if the difference is within the interval of the fast engine's own rate.
    fast_share, drake_share = (share(solved(flight)).scaled(100.0) for flight in (fast, drake))
    low = min(0.0, fast_share.low - fast_share.value)
    high = max(0.0, fast_share.high - fast_share.value)
    meaning = metric_definitions(fast.task)[0]
    pairs = [Pair("solved", meaning, "%", fast_share, drake_share, (low, high))]
    # Errors at the end, whose difference may be that of the integrators.
    drake_errors = final_errors(drake)
    for name, error in final_errors(fast).items():
        factor, unit = QUANTITIES[name].display
        bound = factor * QUANTITIES[name].engine_difference
        allowed = None if math.isinf(bound) else (-bound, bound)
        meaning = "median of the mean over the last fifth"
        both = (median(factor * error), median(factor * drake_errors[name]))
        pairs.append(Pair(f"{name} error", meaning, unit, *both, allowed))
    both = (median(settling_times(fast)), median(settling_times(drake)))
    pairs.append(Pair("settling time", "median time to enter and stay", "s", *both, None))
    # Commands differ where a state is on a threshold of the policy.
    same = (fast.commands == drake.commands).all(axis=2).mean()
    title = (
        f"{fast.controller}: medians of the same {episodes} episodes of {fast.times[-1]:g} s with "
        f"{fast.craft.name} in both engines"
    )
    return EngineComparison(title, tuple(pairs), float(same))


def _texts(pair: Pair) -> tuple[str | bool, ...]:
    """Cells of a pair, in the order of `EngineComparison.table`."""
    allowed = "" if pair.bound is None else f"{pair.bound[0]:+.2g}, {pair.bound[1]:+.2g}"
    return (
        f"{pair.name}, {pair.unit}",
        pair.fast.text(),
        pair.drake.text(),
        f"{pair.difference:+.1e}",
        allowed,
        "" if pair.passed is None else pair.passed,
    )
