"""Does a controller do the same in Drake as in the fast engine? Both from the same starts, side by side."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.table import Table

from rans.evaluation.measure.metrics import DISPLAY, final_errors, settling_times, solved
from rans.evaluation.measure.summary import RESAMPLES
from rans.flight import Flight

MEDIAN_BOUNDS = {"position": 1e-3, "attitude": math.radians(0.1), "velocity": 1e-3,
                 "spin": math.radians(0.1)}
"""Largest difference of median final errors that counts as the same: 1 mm, 0.1 degree, 1 mm/s,
0.1 degree/s; a fiftieth of what tasks tolerate."""

_NORMAL_95 = 1.959964
"""97.5 % quantile of the standard normal distribution."""


@dataclass(frozen=True)
class Pair:
    """One quantity of the same episodes in both engines, with 95 % intervals."""

    name: str
    meaning: str
    unit: str
    fast: float
    fast_interval: tuple[float, float]
    drake: float
    drake_interval: tuple[float, float]
    difference: float
    """Drake less fast."""
    bound: tuple[float, float] | None
    """Where the difference must lie; None where nothing is asked."""

    @property
    def passed(self) -> bool | None:
        """Whether the engines agree; None where nothing is asked."""
        return None if self.bound is None else self.bound[0] <= self.difference <= self.bound[1]


@dataclass(frozen=True)
class EngineComparison:
    """A controller in both engines."""

    title: str
    pairs: tuple[Pair, ...]
    same_commands: float
    """Share of control periods in which both engines' controllers opened the same thrusters."""
    seed: int
    """Of the bootstrap."""

    @property
    def passed(self) -> bool:
        """Whether the engines agree in everything that is asked."""
        return all(pair.passed is not False for pair in self.pairs)

    def to_json(self) -> dict[str, Any]:
        """Plain values for a JSON file."""
        pairs = [{key: _jsonable(value) for key, value in asdict(pair).items()} | {"passed": pair.passed}
                 for pair in self.pairs]
        return {"title": self.title, "passed": self.passed, "same_commands": self.same_commands,
                "bootstrap": {"resamples": RESAMPLES, "seed": self.seed}, "pairs": pairs}

    def table(self) -> Table:
        """For the terminal."""
        table = Table(title=self.title, title_justify="left",
                      caption=f"In {self.same_commands:.2%} of all control periods both opened the same "
                              "thrusters.", caption_justify="left")
        for column in ("quantity", "fast (95 %)", "Drake (95 %)", "gap", "allowed", "verdict"):
            table.add_column(column, no_wrap=column == "quantity")
        for pair in self.pairs:
            table.add_row(*_texts(pair))
        return table


def compare_engines(fast: Flight, drake: Flight, seed: int = 0) -> EngineComparison:
    """Compare flights of the same controller from the same starts.

    The solved share must lie within the fast engine's 95 % interval, the medians within
    `MEDIAN_BOUNDS`.

    Args:
        fast: N episodes, moved by the shared equations.
        drake: the same episodes, moved by Drake.
        seed: of the bootstrap's generator.
    """
    episodes = fast.commands.shape[1]
    picks = np.random.default_rng(seed).integers(0, episodes, (RESAMPLES, episodes))
    pairs = [_shares("solved", "within all tolerances at every step of the last fifth",
                     solved(fast), solved(drake))]
    for name, error in final_errors(fast).items():
        factor, unit = DISPLAY[name]
        bound = factor * MEDIAN_BOUNDS[name]
        pairs.append(_medians(f"{name} error", "median of the mean over the last fifth", unit,
                              factor * error, factor * final_errors(drake)[name], picks, bound))
    pairs.append(_medians("settling time", "median time to enter and stay", "s", settling_times(fast),
                          settling_times(drake), picks, None))
    same = (fast.commands == drake.commands).all(axis=2).mean()
    title = (f"{fast.controller}: the same {episodes} episodes of "
             f"{fast.times[-1]:g} s with {fast.craft.name} in both engines")
    return EngineComparison(title, tuple(pairs), float(same), seed)


def wilson(share: float, count: int) -> tuple[float, float]:
    """95 % score interval of a proportion; it has a width even at 0 and 1 (Wilson, JASA 22, 1927).

    Args:
        share: of successes, 0 to 1.
        count: of trials.
    """
    z2 = _NORMAL_95**2
    centre = share + z2 / (2 * count)
    half = _NORMAL_95 * math.sqrt(share * (1 - share) / count + z2 / (4 * count**2))
    return max(0.0, (centre - half) / (1 + z2 / count)), min(1.0, (centre + half) / (1 + z2 / count))


def _shares(name: str, meaning: str, fast: np.ndarray, drake: np.ndarray) -> Pair:
    (ours, low, high), (theirs, *interval) = (
        (100.0 * x for x in (share, *wilson(share, len(fast))))
        for share in (float(fast.mean()), float(drake.mean())))
    return Pair(name, meaning, "%", ours, (low, high), theirs, (interval[0], interval[1]), theirs - ours,
                (min(0.0, low - ours), max(0.0, high - ours)))


def _medians(name: str, meaning: str, unit: str, fast: np.ndarray, drake: np.ndarray,
             picks: np.ndarray, bound: float | None) -> Pair:
    ours, theirs = float(np.median(fast)), float(np.median(drake))
    difference = 0.0 if ours == theirs else theirs - ours  # also where both are infinite
    return Pair(name, meaning, unit, ours, _bootstrap(fast, picks, np.median), theirs,
                _bootstrap(drake, picks, np.median), difference,
                None if bound is None else (-bound, bound))


def _bootstrap(values: np.ndarray, picks: np.ndarray, centre: Callable[..., Any]) -> tuple[float, float]:
    # "inverted_cdf" takes an order statistic: interpolating between two infinities gives NaN.
    low, high = np.quantile(centre(values[picks], axis=1), (0.025, 0.975), method="inverted_cdf")
    return float(low), float(high)


def _jsonable(value: Any) -> Any:
    """JSON has no infinities: they become the texts that ``float`` reads back."""
    if isinstance(value, tuple):
        return [_jsonable(x) for x in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _texts(pair: Pair) -> tuple[str, ...]:
    def measured(value: float, interval: tuple[float, float]) -> str:
        return f"{value:.3g} ({interval[0]:.3g}, {interval[1]:.3g})"

    allowed = "" if pair.bound is None else f"{pair.bound[0]:+.2g}, {pair.bound[1]:+.2g}"
    verdict = {None: "", True: "[green]pass[/]", False: "[bold red]FAIL[/]"}[pair.passed]
    return (f"{pair.name}, {pair.unit}", measured(pair.fast, pair.fast_interval),
            measured(pair.drake, pair.drake_interval), f"{pair.difference:+.1e}", allowed, verdict)
