"""Delayed valves and failing thrusters: the thrust of a control period as pieces that are linear in time.

A command takes effect ``latency`` after it was given. The thrust then changes linearly from that of the last
command to that of the new one within ``rise``. Wrenches are sums over nozzles, so whole wrenches are ramped
instead of nozzles.

A thruster may fail at any instant of a period. At that instant its force jumps from that of a healthy thruster
to that of a failed one.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from rans.model.body import Body
from rans.model.dynamics import Piece, Wrench, between, thrust, wrench_of
from rans.model.fields import Field, ascending, at_least, fraction_of, map_leaves, where
from rans.model.spacecraft import Spacecraft


@dataclass(frozen=True)
class Lag:
    """Latency and ramp time of all valves, s."""

    latency: Field
    rise: Field | None
    """Rise and fall time; None: the thrust changes at once."""
    latest: float = math.inf
    """Upper bound on the latency, s."""
    slowest: float = math.inf
    """Upper bound on the ramp time, s."""


class Jump(NamedTuple):
    """A change of the commanded wrench."""

    time: Field
    """Time of the command from the start of the control period, s."""
    change: Wrench


def pieces(
    craft: Spacecraft, body: Body, commands: Sequence[Sequence[Field]], lag: Lag, period: float
) -> Iterator[Piece]:
    """Pieces of a control period in which delayed valves follow the commands.

    Args:
        craft: spacecraft.
        body: mass properties and thruster health.
        commands: command of this period, and earlier ones that still affect the thrust, the newest first.
        lag: delay of all valves.
        period: control period, s.
    """
    # Changes of the commanded wrench. A single one that is completed in the period has a closed form.
    before, jumps = _commanded(craft, body, commands, period)
    if len(jumps) == 1 and lag.latest + lag.slowest <= period + 1e-9:
        yield from _once(before, jumps[0], lag, period)
        return
    # The thrust is linear between the instants at which a change begins to take effect, or has taken effect.
    ramps = [] if lag.rise is None else [lag.rise]
    edges = [jump.time + lag.latency + ramp for jump in jumps for ramp in (0.0, *ramps)]
    # Times before or after the period stand at its ends.
    edges = ascending([period - at_least(period - at_least(edge, 0.0), 0.0) for edge in edges])
    for begin, end in zip([0.0, *edges], [*edges, period], strict=True):
        if isinstance(end, float) and isinstance(begin, float) and begin == end:
            continue
        if not ramps:
            yield end - begin, _at(0.5 * (begin + end), before, jumps, lag), None, period
            continue
        # A straight line through two points inside, where nothing jumps.
        a, b = (
            _at(begin + fraction * (end - begin), before, jumps, lag) for fraction in (0.25, 0.75)
        )
        first, last = (
            map_leaves(lambda x, y: 1.5 * x - 0.5 * y, *ends) for ends in ((a, b), (b, a))
        )
        yield end - begin, first, last, period


def failing(sound: Iterable[Piece], failed: Iterable[Piece], instant: Field) -> Iterator[Piece]:
    """Pieces of a control period in which thrusters fail: healthy ones first, then failed ones.

    Both sequences belong to the same commands and end at the same times. The instant divides one piece, so
    there is one piece more. Each result is a healthy piece if that begins before the instant, and otherwise the
    preceding failed piece.

    Args:
        sound: pieces with the healthy thrusters.
        failed: pieces with the failed thrusters.
        instant: time of the fault from the start of the period, s; it may lie before the period (all thrusters
            have failed) or after it (all are healthy).
    """
    begin: Field = 0.0
    rest: Piece | None = None
    for healthy, broken in zip(sound, failed, strict=True):
        duration = healthy[0]
        gone = _completed_part(instant - begin, duration)
        until = _until(healthy, gone)
        yield until if rest is None else _either(instant >= begin, until, rest)
        rest = _from(broken, gone)
        begin = begin + duration
    if rest is not None:
        yield rest


def _until(piece: Piece, fraction: Field) -> Piece:
    """The first share of a piece."""
    duration, first, last, longest = piece
    if last is not None:
        last = between(first, last, fraction)
    return duration * fraction, first, last, longest


def _from(piece: Piece, fraction: Field) -> Piece:
    """Remainder of a piece after its first share."""
    duration, first, last, longest = piece
    if last is not None:
        first = between(first, last, fraction)
    return duration * (1.0 - fraction), first, last, longest


def _either(condition: Field, first: Piece, second: Piece) -> Piece:
    """The first piece where the condition is true, else the second, field by field.

    Compiled steps rely on it that a piece without an end stays without one if both are so: its wrench is constant.
    """

    def choose(a: Field, b: Field) -> Field:
        return where(condition, a, b)

    duration, begin, end, longest = first
    duration_2, begin_2, end_2, longest_2 = second
    # Without an end a piece is constant.
    last = None
    if end is not None or end_2 is not None:
        last = map_leaves(choose, end or begin, end_2 or begin_2)
    return (
        choose(duration, duration_2),
        map_leaves(choose, begin, begin_2),
        last,
        max(longest, longest_2),
    )


def _once(before: Wrench, jump: Jump, lag: Lag, period: float) -> Iterator[Piece]:
    """Pieces of a period whose own command is the only change and is completed within the period."""
    after = map_leaves(operator.add, before, jump.change)
    # The latency, then a ramp, and the rest of the period.
    if lag.latest > 0.0:
        yield lag.latency, before, None, lag.latest
    gone = lag.latency
    if lag.rise is not None:
        yield lag.rise, before, after, lag.slowest
        gone = gone + lag.rise
    yield period - gone, after, None, period


def _commanded(
    craft: Spacecraft, body: Body, commands: Sequence[Sequence[Field]], period: float
) -> tuple[Wrench, list[Jump]]:
    """Wrench at the start of the oldest command, and every later change; times are from this period's start, s."""
    when = []
    thrusts = []
    # Every thrust that was commanded, from the oldest on; a pulse is two changes.
    for age, command in reversed(list(enumerate(commands))):
        time: Field = -age * period
        for fraction, part in craft.actuators.pulses(command[craft.thruster_commands]):
            when.append(time)
            thrusts.append(thrust(craft, part, body))
            time = time + fraction * period
    jumps = []
    for time, (old, new) in zip(when[1:], pairwise(thrusts), strict=True):
        change = [b - a for a, b in zip(old, new, strict=True)]
        jumps.append(Jump(time, wrench_of(craft, change, body)))
    return wrench_of(craft, thrusts[0], body), jumps


def _at(time: Field, before: Wrench, jumps: Sequence[Jump], lag: Lag) -> Wrench:
    """Wrench at a time from the start of the period (s)."""
    for jump in jumps:
        part = _completed_part(time - jump.time - lag.latency, lag.rise)
        before = map_leaves(lambda x, y, part=part: x + y * part, before, jump.change)
    return before


def _completed_part(gone: Field, ramp: Field | None) -> Field:
    """Share of a change that has taken effect at a time after valves began to move (s)."""
    if ramp is None:
        return where(gone > 0.0, gone * 0.0 + 1.0, gone * 0.0)
    return fraction_of(gone, ramp)  # at once, where a ramp takes no time
