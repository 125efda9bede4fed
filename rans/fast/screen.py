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

from rans.fast.filter import Filter
from rans.fast.turning import tilt_between
from rans.model.fields import Field, at_least, where
from rans.tasks.sight import Columns, Layout, Spin, Turn

PATIENCE = 5.0
"""Control periods after a command in which a repeated reading of a perfect sensor may be a missed one."""
_QUIET = 1.5
"""Control periods without a command, a half beyond the last of those that late valves may fill."""
_MOST = 4.0
"""Bound of the evidence that sensors are noisy: how soon the screen changes its mind."""


class Memory(NamedTuple):
    """What a screen remembers from one control period to the next."""

    last: Columns
    """The reading as it came."""
    expected: Columns
    """The next one."""
    gates: Columns
    """Of each block, in units of the screen's: up to which error its next reading is believed."""
    idle: Field
    """Control periods since a thruster was commanded, at most `PATIENCE`."""
    noisy: Field
    """Evidence that sensors are noisy, 0 to `_MOST`; 0: they are perfect."""

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

    def after(self, read: Columns, screened: Screened, expected: Columns,
              command: Columns) -> list[Field]:
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


def screened(layout: Layout, read: Columns, memory: Memory, one: Filter, gate: float,
             first: Field) -> Screened:
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
    noisy = _evidence(layout, read, memory, first)
    full = noisy * 0.0 + 1.0
    # Where sensors are perfect and the last command is long ago, a repeated reading is a true one.
    repeats_truly = where(noisy > 0.0, full * 0.0, where(memory.idle > PATIENCE - 0.5, full, full * 0.0))

    columns: list[Field] = []
    gates: list[Field] = []
    blocks = zip(layout.split(read), layout.split(memory.last), layout.split(memory.expected), one.share,
                 memory.gates, strict=True)
    for (block, now), (_, before), (_, then), share, wider in blocks:
        if issubclass(block.kind, Turn):
            error, scale = tilt_between(now, then), twist
        elif any(share):
            error, scale = [a - b for a, b in zip(now, then, strict=True)], twist if share[2] else push
        else:  # no motion changes it
            columns += now
            gates.append(wider)
            continue
        size = sum((x * x for x in error[1:]), start=error[0] * error[0]) * (1.0 / (gate * scale)**2)
        wild = size > wider * wider
        counts = where(repeats_truly > 0.0, full, _changed(now, before))
        counts = where(first, full, where(wild, full * 0.0, counts))
        columns += [where(counts > 0.0, a, b) for a, b in zip(now, then, strict=True)]
        gates.append(where(first, full, where(wild, wider + wider, full)))
    return Screened(columns, gates, noisy)


def _evidence(layout: Layout, read: Columns, memory: Memory, first: Field) -> Field:
    """How much speaks for noisy sensors: more when angular velocity changes while nothing was commanded.

    They are taken for noisy at first.
    """
    changes = [_changed(now, before) for (block, now), (_, before) in zip(
        layout.split(read), layout.split(memory.last), strict=True) if issubclass(block.kind, Spin)]
    bounded = -at_least(-at_least(memory.noisy + 2.0 * changes[0] - 1.0, 0.0), -_MOST)
    learnt = where(memory.idle > _QUIET, bounded, memory.noisy)
    return where(first, learnt * 0.0 + 0.5 * _MOST, learnt)


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
