"""Fronts of three flights, by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rans.evaluation.compare.bounds import Bound
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.front import Front
from tests.support.comparisons import NOBODY, entry

HORIZONS = (2.0, 5.0)


def named(name: str, trade_off: float | None = None, **changes: Any) -> Entry:
    """See `entry`: there after 1 s, 2 s and never; in all 2, 1 and 0 N s, of which 1 and 1 until there."""
    return replace(entry(), contestant=Contestant(name, NOBODY, "", "", trade_off), **changes)


def answers(own: tuple[float, float] = (0.4, 0.6)) -> list[Bound]:
    """Bounds of three starts: 0.5 s of time and 0.2 N s by each horizon; of the first two also by 1 and 2 s."""
    found = [
        Bound(k, horizon, 0.5 if horizon is None else 0.2)
        for k in range(3)
        for horizon in (None, *HORIZONS)
    ]
    return [
        Bound(1, 2.0, own[1]) if (one.start, one.horizon) == (1, 2.0) else one
        for one in (*found, Bound(0, 1.0, own[0]))
    ]


def front(*entries: Entry, **changes: Any) -> Front:
    flight = entries[0].flight
    return Front(
        Contest(flight.craft, flight.task, flight.timing, 1, 3), HORIZONS, [*entries], **changes
    )


def trade_offs() -> Front:
    """A line from 1 N s to a half, and somebody beside it who needs four times that."""
    fast = named("agent#0", 0.0)
    thrifty = named("agent#1", 1.0)
    dear = named("dear")
    thrifty.flight.commands[:] *= 0.5
    dear.flight.commands[:] *= 4.0
    return front(thrifty, dear, fast, named("held#0.5", 0.5), certified=answers())
