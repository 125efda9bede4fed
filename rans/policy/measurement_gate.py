"""Readings that sensors missed or got wildly wrong: what was to be expected stands in their place.

A sensor that misses a control period repeats its last reading, and noise never repeats a number: columns
that are exactly as before are moved on as the spacecraft is expected to move. So is the last plausible
reading where a new one is further off than thrusters could bring a spacecraft.

Perfect sensors repeat what does not change. So the screen finds out whether readings change while nothing is
commanded; where they do not, it contradicts a repeated reading only for a moment after a command.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from rans.model.fields import Field, at_least, where
from rans.policy.frame_rotation import tilt_between
from rans.policy.kalman_filter import Filter
from rans.tasks.observation_terms import (
    AngularVelocity,
    Columns,
    Layout,
    ObservationTerm,
    RelativeRotation,
)

PATIENCE = 5.0
"""Control periods after a command in which a repeated reading of a perfect sensor may be a missed one."""
_IDLE = 1.5
"""Control periods without a command, a half beyond the last of those in which late valves may still act."""
_EVIDENCE = 2.0
"""Repeated readings, while nothing is commanded, that show sensors to be perfect."""


class Memory(NamedTuple):
    """What a screen remembers from one control period to the next."""

    last: Columns
    """The reading as it came."""
    expected: Columns
    """The next one."""
    gates: Columns
    """Error up to which each block's next reading is believed, in units of the screen's gate."""
    idle: Field
    """Control periods since a thruster was commanded, at most `PATIENCE`."""
    noisy: Field
    """Evidence that sensors are noisy, 0 to `_EVIDENCE`; 0: they are taken for perfect."""

    @classmethod
    def of(cls, layout: Layout, numbers: Columns) -> Memory:
        """The memory in a row of numbers; zeros at an episode's start."""
        sizes = layout.width, layout.width, len(layout.blocks)
        *columns, rest = (numbers[a:b] for a, b in pairwise((*accumulate(sizes, initial=0), None)))
        return cls(*columns, *rest)

    @staticmethod
    def width(layout: Layout) -> int:
        """How many numbers that are."""
        return 2 * layout.width + len(layout.blocks) + 2

    def after(
        self, read: Columns, screened: Screened, expected: Columns, command: Columns
    ) -> list[Field]:
        """The numbers to remember once a reading was screened and answered with a command."""
        total = sum(command[1:], start=command[0])
        idle = -at_least(-(self.idle + 1.0), -PATIENCE)
        idle = where(total > 0.0, total * 0.0, idle)
        return [*read, *expected, *screened.gates, idle, screened.noisy]


class Screened(NamedTuple):
    """What a screen makes of a reading."""

    columns: list[Field]
    """The reading, where it is missing or wild what was expected."""
    gates: list[Field]
    """See `Memory`."""
    noisy: Field
    """See `Memory`."""


def screened(
    layout: Layout, read: Columns, memory: Memory, one: Filter, gate: float, first: Field
) -> Screened:
    """The columns of a reading as they count.

    The gate opens twice as wide for every reading in a row that it kept out, so that one which stays far off
    is believed in the end.

    Args:
        layout: of the columns, that of the body.
        read: a reading as it came.
        memory: of a period ago.
        one: the filter whose knowledge of the spacecraft is used.
        gate: error up to which readings are believed, in units of the velocity that all thrusters which
            push along one axis give in a period; of poses the same number, in m and rad.
        first: whether this is an episode's first reading, which is all there is.
    """
    push, twist = (_authority(gains) for gains in (one.push, one.twist))
    zero = memory.noisy * 0.0
    full = zero + 1.0
    noisy = where(first, zero, _evidence(layout, read, memory))

    # Perfect sensors: a repeated reading is a true one long after the last command, or if the pose says so.
    perfect = where(noisy > 0.0, zero, full)
    is_true = perfect * where(memory.idle > PATIENCE - 0.5, full, zero)
    spin_is_true = perfect * _turned_as_read(layout, read, memory, one.period)

    columns: list[Field] = []
    gates: list[Field] = []
    blocks = zip(
        layout.split(read),
        layout.split(memory.last),
        layout.split(memory.expected),
        one.share,
        memory.gates,
        strict=True,
    )
    for (block, now), (_, before), (_, then), share, gate_before in blocks:
        if issubclass(block.kind, RelativeRotation):
            error = tilt_between(now, then)
            scale = twist
        elif any(share):
            error = [a - b for a, b in zip(now, then, strict=True)]
            scale = twist if share[2] else push
        else:  # no motion changes it
            columns += now
            gates.append(gate_before)
            continue
        new = _changed(now, before) + is_true
        if issubclass(block.kind, AngularVelocity):
            new = new + spin_is_true
        wild = _squared(error) * (1.0 / (gate * scale) ** 2) > gate_before * gate_before
        counts = where(first, full, where(wild, zero, new))
        columns += [where(counts > 0.0, a, b) for a, b in zip(now, then, strict=True)]
        gates.append(where(first, full, where(wild, gate_before + gate_before, full)))
    return Screened(columns, gates, noisy)


def _evidence(layout: Layout, read: Columns, memory: Memory) -> Field:
    """How much speaks for noisy sensors: all, when angular velocity changes while nothing is commanded.

    Each time that it does not change then takes one away. An episode begins with none.
    """
    now, before = (_columns_of(AngularVelocity, layout, x) for x in (read, memory.last))
    fewer = at_least(memory.noisy - 1.0, 0.0)
    result = fewer + _changed(now, before) * (_EVIDENCE - fewer)
    return where(memory.idle > _IDLE, result, memory.noisy)


def _turned_as_read(layout: Layout, read: Columns, memory: Memory, period: float) -> Field:
    """1 where a new attitude fits the angular velocity that was read better than the one expected, else 0."""
    spin, spin_expected = (_columns_of(AngularVelocity, layout, x) for x in (read, memory.expected))
    now, before, then = (
        _columns_of(RelativeRotation, layout, x) for x in (read, memory.last, memory.expected)
    )
    if not now:
        return memory.noisy * 0.0
    off = tilt_between(now, then)
    # Thrust that did not come would have turned the craft by half its angular velocity times the period.
    off_as_read = [
        tilt + 0.5 * period * (b - a) for tilt, a, b in zip(off, spin, spin_expected, strict=True)
    ]
    fits = _squared(off) > _squared(off_as_read)
    return where(fits, _changed(now, before), memory.noisy * 0.0)


def _columns_of(kind: type[ObservationTerm], layout: Layout, columns: Columns) -> Columns:
    """The columns of the first block of this kind; none where there is no such block."""
    return next((mine for block, mine in layout.split(columns) if issubclass(block.kind, kind)), ())


def _squared(x: Columns) -> Field:
    return sum((a * a for a in x[1:]), start=x[0] * x[0])


def _changed(now: Columns, before: Columns) -> Field:
    """0 where all columns are exactly as before, elsewhere 1."""
    same: Field = 1.0
    for a, b in zip(now, before, strict=True):
        same = same * where(a == b, a * 0.0 + 1.0, a * 0.0)
    return 1.0 - same


def _authority(gains: Sequence[Sequence[float]]) -> float:
    """What all thrusters that push one way along an axis give together, along the axis with the most."""
    table = np.array(gains)
    most = np.maximum(table.clip(min=0.0).sum(axis=0), -table.clip(max=0.0).sum(axis=0)).max()
    return float(most) or 1.0
