"""Draws of thruster faults of an episode, written over fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rans.model.body import Body
from rans.model.fields import Field, ascending, floor, where
from rans.model.random import Random
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import FaultConditions, FaultKind, bounds, largest, piecewise
from rans.randomization.faults import failed, sets_among


@dataclass(frozen=True)
class Fault:
    """Health of the thrusters after a fault, and the instant of the fault."""

    begins: Field
    """Time of the fault from the start of the episode, s."""
    gain: tuple[Field, ...]
    leak: tuple[Field, ...]
    latest: float = math.inf
    """Upper bound on the time of the fault, s; 0: every fault exists from the start."""


def draw_fault(
    faults: FaultConditions,
    craft: Spacecraft,
    body: Body,
    random: Random,
) -> Fault | None:
    """Draw the fault of an episode; None if the conditions have no faults.

    Args:
        faults: conditions of faults.
        craft: spacecraft.
        body: body before the fault; thrusters that do not fail keep its gain and leak.
        random: random numbers.
    """
    thrusters = len(body.gain)
    if faults.thrusters:
        return _named(faults, body, random)
    if largest(faults.count) < 1:
        return None
    count = random.whole(faults.count)
    begins = random.within(faults.time)
    lost = (
        _scattered(faults, float(thrusters), random)
        if faults.among == "any"
        else _alike(faults, craft, count, random)
    )
    gain = list(body.gain)
    leak = list(body.leak)
    for slot, (thruster, (fault_gain, fault_leak)) in enumerate(lost):
        for i in range(thrusters):
            hit = (thruster == float(i)) & (count > float(slot))
            gain[i] = where(hit, fault_gain * body.gain[i], gain[i])
            leak[i] = where(hit, fault_leak * body.gain[i], leak[i])
    return Fault(begins, tuple(gain), tuple(leak), largest(faults.time))


def _named(faults: FaultConditions, body: Body, random: Random) -> Fault:
    """The fault of thrusters that are named, each with its own fault kind.

    A draw for each thruster, in the order in which they are named: recorded flights rely on it.
    """
    begins = random.within(faults.time)
    gain = list(body.gain)
    leak = list(body.leak)
    for k in faults.thrusters:
        failure = _failure(faults.kinds, random.unit(), random.within(faults.share))
        gain[k], leak[k] = (part * body.gain[k] for part in failure)
    return Fault(begins, tuple(gain), tuple(leak), largest(faults.time))


Lost = list[tuple[Field, tuple[Field, Field]]]
"""Indices of the thrusters that fail, with their gain and leak after the fault."""


def _scattered(faults: FaultConditions, thrusters: Field, random: Random) -> Lost:
    """Any thrusters, each with its own fault kind; every further one is drawn among the others.

    Where more fail than there are, the number of a further one is negative: it is none.
    """
    thrusters_drawn: list[Field] = []
    for k in range(int(largest(faults.count))):
        # A place among those that are left, counted past the ones that are taken, in order.
        thruster = floor(random.unit() * (thrusters - float(k)))
        for taken in ascending(thrusters_drawn):
            thruster = thruster + where(thruster >= taken, thruster * 0.0 + 1.0, thruster * 0.0)
        thrusters_drawn.append(thruster)
    return [
        (thruster, _failure(faults.kinds, random.unit(), random.within(faults.share)))
        for thruster in thrusters_drawn
    ]


def _alike(faults: FaultConditions, craft: Spacecraft, count: Field, random: Random) -> Lost:
    """A (un)recoverable set of thrusters with one fault kind; three draws, whose order recorded flights rely on."""
    chance = random.unit()
    severity = random.within(faults.share)
    which = random.unit()
    failure = _failure(faults.kinds, chance, severity)
    (least, greatest) = bounds(faults.count)
    candidates = _places(faults, craft, int(greatest), chance, which)
    if least < 2 <= greatest:
        (alone,) = _places(faults, craft, 1, chance, which)
        candidates = where(count > 1.0, candidates[0], alone), candidates[1]
    return [(thruster, failure) for thruster in candidates]


def _places(
    faults: FaultConditions, craft: Spacecraft, count: int, chance: Field, which: Field
) -> tuple[Field, ...]:
    """Indices (fields) of the thrusters of a set of ``count``, for the fault kind that ``chance`` selects.

    Recorded flights rely on the order of kinds, and of the sets of `sets_among`.
    """
    by_count: dict[tuple[tuple[int, ...], ...], tuple[Field, ...]] = {}
    result: tuple[Field, ...] = ()
    for k, kind in enumerate(faults.kinds):
        sets = sets_among(craft, count, kind, bounds(faults.share), faults.among == "recoverable")
        new = by_count.setdefault(sets, _member(sets, which))
        result = (
            new
            if k == 0 or new is result
            else tuple(
                where(chance >= k / len(faults.kinds), a, b)
                for a, b in zip(new, result, strict=True)
            )
        )
    return result


def _member(sets: Sequence[tuple[int, ...]], which: Field) -> tuple[Field, ...]:
    """One of these sets, drawn uniformly.

    The last thruster mostly increases by one from set to set; only its exceptions are tabulated.
    """
    k = floor(which * float(len(sets)))
    ends = range(1, len(sets))
    *first, last = ([float(x) for x in column] for column in zip(*sets, strict=True))
    rise = [x - at for at, x in enumerate(last)]
    return *(piecewise(column, ends, k) for column in first), piecewise(rise, ends, k) + k


def _failure(kinds: Sequence[FaultKind], chance: Field, severity: Field) -> tuple[Field, Field]:
    """Gain and leak (fields) of the fault kind that a number in [0, 1) selects, all kinds alike.

    Sets of `_places` are chosen by the same ``chance``, so that kind and set belong together.
    """
    none = chance * 0.0
    full = chance * 0.0 + 1.0
    gain, leak = failed(kinds[0], severity, none, full)
    for k, kind in enumerate(kinds[1:], 1):
        later = chance >= k / len(kinds)
        (other_gain, other_leak) = failed(kind, severity, none, full)
        gain = where(later, other_gain, gain)
        leak = where(later, other_leak, leak)
    return gain, leak
