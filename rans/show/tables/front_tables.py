"""A front in numbers and words, for the page, the terminal and the JSON file of a comparison."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from rans.errors import counted
from rans.evaluation.compare.contest import Entry
from rans.evaluation.compare.front import Front, Point, Verdict, point
from rans.evaluation.measure.statistics import figure
from rans.tasks.quantities import QUANTITIES

_MULTIPLES = (
    "behind its nearest point",
    "until there over its bound",
    "impulse over its bound",
)
"""Columns of multiples of bounds."""


def front_table(front: Front) -> tuple[list[str], list[list[str]]]:
    """Columns, and a row for every contestant and position; multiples of bounds only if there are bounds."""
    has_bounds = bool(front.starts())
    quantity, factor, unit = _error(front)
    rows = []
    for entry in _ordered(front):
        coordinates = point(entry)
        multiple = front.multiple(entry)
        over = (
            (multiple.behind, multiple.until, multiple.episode)
            if multiple
            else (math.nan, math.nan, math.nan)
        )
        numbers = (
            100.0 * coordinates.there,
            coordinates.time,
            coordinates.impulse,
            factor * coordinates.error,
            *(over if has_bounds else ()),
        )
        rows.append([entry.name, *map(figure, numbers)])
    return [
        "contestant",
        "get there, %",
        "time, s",
        "impulse, N s",
        f"{quantity} error, {unit}",
        *(_MULTIPLES if has_bounds else ()),
    ], rows


def sentences(front: Front) -> Iterator[str]:
    """Sentences about dominance, and about the ratio of each line to the bounds."""
    for agent, line in front.lines().items():
        # Each rival outside of the line.
        for rival in front.others():
            verdict = front.verdict(line, rival)
            does = "dominates" if verdict.dominates else "does not dominate"
            sure = ""
            if verdict.dominates:
                sure = f" (in {100.0 * front.chance(line, rival):.3g} % of resamplings)"
            reason = _reason(verdict, point(rival), *_error(front))
            yield f"{agent} {does} {rival.name}{sure}: {reason}."
        # The certified front, where it has bounds for positions of the line.
        over = {entry.contestant.trade_off: own for entry in line if (own := front.multiple(entry))}
        if over:
            behind = _factors({position: own.behind for position, own in over.items()})
            yield (
                f"{agent} is behind the nearest point of the certified front, in time and impulse at once, by "
                f"factors of {behind}."
            )
            episode = _factors({position: own.episode for position, own in over.items()})
            yield (
                f"{agent} spends, in multiples of the certified least impulse for its own times, {episode}."
            )
    # The front as a whole.
    sets = {**front.lines(), "Everybody together": front.entries}
    for name, entries in sets.items():
        if result := front.indicators(entries):
            yield (
                f"{name} against the whole certified front from {result.first:.3g} to {result.last:.3g} s: "
                f"epsilon indicator {result.epsilon:.3g} (median), {100.0 * result.hypervolume:.3g} % of its "
                f"hypervolume (mean), {counted(result.starts, 'start')}."
            )


def _factors(by_position: Mapping[Any, float]) -> str:
    """Factors at the positions of a trade-off."""
    return ", ".join(f"{factor:.2f} at {position:g}" for position, factor in by_position.items())


def _reason(verdict: Verdict, rival: Point, quantity: str, factor: float, unit: str) -> str:
    """What an agent reaches in the time of a rival, and with its impulse: the reason of a verdict."""
    thrifty, quick, _ = verdict
    if thrifty is None:
        return f"at no position is it there within {rival.time:.4g} s in the mean"
    if thrifty.impulse >= rival.impulse:
        return f"in {rival.time:.4g} s it spends {thrifty.impulse:.4g} N s, not less than {rival.impulse:.4g}"
    text = f"in {rival.time:.4g} s {thrifty.impulse:.4g} N s instead of {rival.impulse:.4g}"
    if quick is None or quick.time >= rival.time:
        return f"{text}, but with {rival.impulse:.4g} N s it is no quicker"
    error = max(thrifty.error, quick.error)
    arrived = min(thrifty.there, quick.there)
    return (
        f"{text}; with {rival.impulse:.4g} N s {quick.time:.4g} s instead of {rival.time:.4g}; "
        f"{quantity} error {factor * error:.3g} {unit} beside {factor * rival.error:.3g}; there from "
        f"{100.0 * arrived:.4g} % of starts beside {100.0 * rival.there:.4g}"
    )


def front_json(front: Front) -> dict[str, Any]:
    """Content of "front" in compare.json, in SI units; what is said is in it word by word."""
    return {
        "horizon": front.contest.duration,
        "starts": front.contest.episodes,
        "points": {
            entry.name: {
                "trade_off": entry.contestant.trade_off,
                **point(entry)._asdict(),
                "over_bound": multiple._asdict() if (multiple := front.multiple(entry)) else None,
            }
            for entry in _ordered(front)
        },
        "lines": {agent: [entry.name for entry in line] for agent, line in front.lines().items()},
        "dominates": {
            agent: {rival.name: front.verdict(line, rival).dominates for rival in front.others()}
            for agent, line in front.lines().items()
        },
        "indicators": {
            name: result._asdict() if (result := front.indicators(entries)) else None
            for name, entries in {**front.lines(), "everybody": front.entries}.items()
        },
        "said": [*sentences(front)],
        "certified": {
            "starts": front.starts(),
            "bounds": [
                {"event": event.text, "horizon": event.horizon, "mean": bound}
                for event, bound in front.front().items()
            ],
        },
    }


def _ordered(front: Front) -> list[Entry]:
    return [*(entry for line in front.lines().values() for entry in line), *front.others()]


def _error(front: Front) -> tuple[str, float, str]:
    """Error that is judged, its display unit and factor."""
    quantity = next(iter(front.entries[0].errors))
    return quantity, *QUANTITIES[quantity].display
