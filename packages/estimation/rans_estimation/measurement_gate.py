"""A gate before the filters: readings that are missing or implausible are replaced by their prediction.

A sensor that misses a control period repeats its last reading, and noise never repeats a number: columns that
are exactly as before count as missing. A reading is implausible where its innovation is more than thrusters
could bring about.

Perfect sensors also repeat what does not change. So the gate finds out whether readings change while nothing is
commanded; if not, it takes a repeated reading for missing only for a moment after a command.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from rans.extend import (
    AngularVelocity,
    Columns,
    Field,
    Layout,
    ObservationTerm,
    RelativeRotation,
    at_least,
    where,
)
from rans_estimation.frame_rotation import tilt_between
from rans_estimation.kalman_filter import Filter
from rans_estimation.kinematic_roles import SPIN

PATIENCE = 5.0
"""Control periods after a command in which a repeated reading of a perfect sensor may be a missed one."""
_IDLE = 1.5
"""Control periods without a command, a half beyond the last of those in which late valves may still act."""
_EVIDENCE = 2.0
"""Repeated readings, while nothing is commanded, after which sensors count as perfect."""


class GateMemory(NamedTuple):
    """Memory of the gate from one control period to the next, of N spacecraft."""

    last: Columns
    """The last reading as it came."""
    predicted: Columns
    """Prediction of the next reading."""
    thresholds: Columns
    """Threshold of each block's next innovation, in units of the gate."""
    idle: Field
    """Control periods since a thruster was commanded, at most `PATIENCE`."""
    noise_evidence: Field
    """Evidence that sensors are noisy, 0 to `_EVIDENCE`; at 0 they count as perfect."""

    @classmethod
    def unpacked(cls, layout: Layout, memory: Columns) -> GateMemory:
        """Memory from a row of fields, as `after` lists them; zeros are that of an episode's start."""
        sizes = layout.width, layout.width, len(layout.blocks)
        *columns, scalars = (
            memory[a:b] for a, b in pairwise((*accumulate(sizes, initial=0), None))
        )
        return cls(*columns, *scalars)

    @staticmethod
    def width(layout: Layout) -> int:
        """Fields of the memory."""
        return 2 * layout.width + len(layout.blocks) + 2

    def after(
        self, read: Columns, reading: GatedReading, predicted: Columns, command: Columns
    ) -> list[Field]:
        """Fields of the memory one period later.

        Args:
            read: columns of the reading as it came.
            reading: the same behind the gate.
            predicted: columns of the next reading, by the filter.
            command: (thrusters,), the answer to this reading.
        """
        total = sum(command[1:], start=command[0])
        idle = -at_least(-(self.idle + 1.0), -PATIENCE)
        idle = where(total > 0.0, total * 0.0, idle)
        return [*read, *predicted, *reading.thresholds, idle, reading.noise_evidence]


class GatedReading(NamedTuple):
    """A reading behind the gate, of N spacecraft."""

    columns: list[Field]
    """The reading; where it is missing or implausible, its prediction."""
    thresholds: list[Field]
    """See `GateMemory`."""
    noise_evidence: Field
    """See `GateMemory`."""


def gated_reading(
    layout: Layout,
    read: Columns,
    memory: GateMemory,
    filter_: Filter,
    gate: float,
    is_first: Field,
) -> GatedReading:
    """Replace the missing and implausible blocks of a reading by their prediction.

    The threshold of a block doubles with every consecutive reading that it rejects, so that a reading which
    stays far off is accepted in the end.

    Args:
        layout: of the columns, in the body frame.
        read: columns of the reading as it came.
        memory: of the gate, a period old.
        filter_: the filter whose model of the spacecraft gives each innovation its scale.
        gate: threshold of an innovation, in units of the velocity that all thrusters which push along one axis
            give in a period; of poses the same number, in m and rad.
        is_first: whether this is an episode's first reading, which is accepted as it is, (N,).
    """
    push, twist = (_authority(gains) for gains in (filter_.push, filter_.twist))
    zero = memory.noise_evidence * 0.0
    yes = zero + 1.0
    noise_evidence = where(is_first, zero, _noise_evidence(layout, read, memory))

    # Perfect sensors: a repeated reading is a true one long after the last command, or if the pose agrees.
    is_perfect = where(noise_evidence > 0.0, zero, yes)
    repeat_is_true = is_perfect * where(memory.idle > PATIENCE - 0.5, yes, zero)
    spin_is_true = is_perfect * _rotation_fits_spin(layout, read, memory, filter_.period)

    columns: list[Field] = []
    thresholds: list[Field] = []
    blocks = zip(
        layout.split(read),
        layout.split(memory.last),
        layout.split(memory.predicted),
        filter_.sensitivities,
        memory.thresholds,
        strict=True,
    )
    for (block, now), (_, last), (_, predicted), sensitivity, threshold in blocks:
        # The innovation and its scale.
        if issubclass(block.kind, RelativeRotation):
            innovation = tilt_between(now, predicted)
            scale = twist
        elif any(sensitivity):
            innovation = [a - b for a, b in zip(now, predicted, strict=True)]
            scale = twist if sensitivity[SPIN] else push
        else:  # no motion changes it, so that nothing is predicted
            columns += now
            thresholds.append(threshold)
            continue

        # Accept the block if it is new, or rightly repeated, and its innovation is within the threshold.
        is_new = _has_changed(now, last) + repeat_is_true
        if issubclass(block.kind, AngularVelocity):
            is_new = is_new + spin_is_true
        is_implausible = (
            _squared_norm(innovation) * (1.0 / (gate * scale) ** 2) > threshold * threshold
        )
        is_accepted = where(is_first, yes, where(is_implausible, zero, is_new))
        columns += [where(is_accepted > 0.0, a, b) for a, b in zip(now, predicted, strict=True)]
        thresholds.append(where(is_first, yes, where(is_implausible, threshold + threshold, yes)))
    return GatedReading(columns, thresholds, noise_evidence)


def _noise_evidence(layout: Layout, read: Columns, memory: GateMemory) -> Field:
    """Evidence for noisy sensors, 0 to `_EVIDENCE`: all of it once spin changes while nothing is commanded.

    Every time that the spin then repeats takes 1 away. An episode begins with 0.
    """
    now, last = (_columns_of(AngularVelocity, layout, x) for x in (read, memory.last))
    less = at_least(memory.noise_evidence - 1.0, 0.0)
    result = less + _has_changed(now, last) * (_EVIDENCE - less)
    return where(memory.idle > _IDLE, result, memory.noise_evidence)


def _rotation_fits_spin(layout: Layout, read: Columns, memory: GateMemory, period: float) -> Field:
    """1 where a changed attitude fits the spin as read better than the spin as predicted, else 0, (N,).

    It is a number by which others are multiplied, no truth.
    """
    spin, predicted_spin = (
        _columns_of(AngularVelocity, layout, x) for x in (read, memory.predicted)
    )
    now, last, predicted = (
        _columns_of(RelativeRotation, layout, x) for x in (read, memory.last, memory.predicted)
    )
    if not now:
        return memory.noise_evidence * 0.0
    tilt = tilt_between(now, predicted)
    # Predicted thrust that did not come would have rotated the craft by half its spin times the period.
    tilt_by_read_spin = [
        angle + 0.5 * period * (b - a)
        for angle, a, b in zip(tilt, spin, predicted_spin, strict=True)
    ]
    fits = _squared_norm(tilt) > _squared_norm(tilt_by_read_spin)
    return where(fits, _has_changed(now, last), memory.noise_evidence * 0.0)


def _columns_of(kind: type[ObservationTerm], layout: Layout, columns: Columns) -> Columns:
    """Columns of the first block of this kind; none if the layout has no such block."""
    return next((part for block, part in layout.split(columns) if issubclass(block.kind, kind)), ())


def _squared_norm(x: Columns) -> Field:
    return sum((a * a for a in x[1:]), start=x[0] * x[0])


def _has_changed(now: Columns, before: Columns) -> Field:
    """0 where all columns are exactly as before, else 1, (N,)."""
    is_same: Field = 1.0
    for a, b in zip(now, before, strict=True):
        is_same = is_same * where(a == b, a * 0.0 + 1.0, a * 0.0)
    return 1.0 - is_same


def _authority(gains: Sequence[Sequence[float]]) -> float:
    """Largest change of velocity in a period along any axis, all thrusters that push one way being open.

    Args:
        gains: (thrusters, axes) changes by each thruster, m/s or rad/s.
    """
    table = np.array(gains)
    forward = table.clip(min=0.0).sum(axis=0)
    backward = -table.clip(max=0.0).sum(axis=0)
    return float(np.maximum(forward, backward).max()) or 1.0
