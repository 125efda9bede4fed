"""Valves that answer late and gradually: the thrust of a control period as straight pieces.

A command is felt ``latency`` after it was given; then the thrust goes steadily from what the last command
gave to what this one gives, up within ``rise``, down within ``fall``. Wrenches are sums over nozzles, so
whole wrenches are ramped, not nozzles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rans.model.fields import Field, at_least, map_leaves, where


@dataclass(frozen=True)
class Lag:
    """How late and how gradually valves answer, s."""

    latency: Field
    rise: Field | None
    """None: at once."""
    fall: Field | None
    """None: as the rise."""


class Piece(NamedTuple):
    """A part of a control period in which the wrench is a straight line over time."""

    duration: Field
    """s."""
    first: Any
    """`Wrench` at its beginning."""
    last: Any
    """At its end; None: as at its beginning."""


class Jump(NamedTuple):
    """A change of the wrench that was told at a time."""

    time: Field
    """s from the start of the control period."""
    up: Any
    """`Wrench` of what opens."""
    down: Any
    """Of what shuts; None: it is in ``up`` too."""


def pieces(before: Any, jumps: Sequence[Jump], lag: Lag, period: float) -> Iterator[Piece]:
    """The wrench in one control period.

    Args:
        before: the wrench of the oldest command that is still felt.
        jumps: what every later one changed.
        lag: of all valves.
        period: s.
    """
    ramps = [] if lag.rise is None else [lag.rise] if lag.fall is None else [lag.rise, lag.fall]
    edges = [jump.time + lag.latency + ramp for jump in jumps for ramp in (0.0, *ramps)]
    edges = ascending([_within(edge, period) for edge in edges])
    for begin, end in zip([0.0, *edges], [*edges, period], strict=True):
        if isinstance(end, float) and isinstance(begin, float) and begin == end:
            continue
        if not ramps:
            yield Piece(end - begin, _at(0.5 * (begin + end), before, jumps, lag), None)
            continue
        # A straight line through two points inside, where nothing jumps.
        a, b = (_at(begin + share * (end - begin), before, jumps, lag) for share in (0.25, 0.75))
        yield Piece(end - begin, map_leaves(lambda x, y: 1.5 * x - 0.5 * y, a, b),
                    map_leaves(lambda x, y: 1.5 * y - 0.5 * x, a, b))


def _at(time: Field, before: Any, jumps: Sequence[Jump], lag: Lag) -> Any:
    """The wrench at a time."""
    for jump in jumps:
        gone = time - jump.time - lag.latency
        up, down = _share(gone, lag.rise), _share(gone, lag.rise if lag.fall is None else lag.fall)
        before = map_leaves(lambda x, y, share=up: x + y * share, before, jump.up)
        if jump.down is not None:
            before = map_leaves(lambda x, y, share=down: x + y * share, before, jump.down)
    return before


def _share(gone: Field, ramp: Field | None) -> Field:
    """How much of a change is felt, so long after valves began to move (s)."""
    if ramp is None:
        return where(gone > 0.0, gone * 0.0 + 1.0, gone * 0.0)
    share = gone / at_least(ramp, 1e-30)  # at once, where a ramp takes no time
    return at_least(1.0 - at_least(1.0 - share, 0.0), 0.0)


def _within(time: Field, period: float) -> Field:
    return period - at_least(period - at_least(time, 0.0), 0.0)


def ascending(values: Sequence[Field]) -> list[Field]:
    """Fields of the same numbers, the smallest first (a bubble sort, which never branches)."""
    result = list(values)
    for last in range(len(result) - 1, 0, -1):
        for k in range(last):
            a, b = result[k], result[k + 1]
            result[k], result[k + 1] = where(a < b, a, b), where(a < b, b, a)
    return result
