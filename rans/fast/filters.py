"""Kalman filters within a policy: what it expects to see next, from what it saw and told the thrusters.

Noise in readings hides what a craft is about to do; its mass, its thrust and the commands tell most of it.
Each filter of a bank trusts them more or less (Kalman, "A new approach to linear filtering and prediction
problems", 1960; a bank: Magill, "Optimal adaptive estimation of sampled stochastic processes", 1965). They
work on the columns of what is observed, in B, so that any task's may be filtered (decision 024).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import Field, Vec3, where
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task, sight
from rans.tasks.derived import example_state
from rans.tasks.sight import (
    Block,
    Columns,
    Dimension,
    Drawn,
    Entry,
    Layout,
    OwnAttitude,
    Spin,
    Turn,
    VectorInW,
    matrix_rows,
)

_NOTES = 3
"""Numbers that a filter remembers besides what it expects: its information matrix."""
_Share = tuple[float, float, float]


class Filters(NamedTuple):
    """A bank of filters of one spacecraft and task; readings of poses and velocities are of equal noise.

    What a filter remembers, (N, k + 3), are the columns that it expects next and how well it knows a pose and
    its velocity: the inverse of their covariance, by rows without what symmetry tells. Zeros know nothing.
    """

    drift: tuple[float, ...]
    """Variance by which velocities wander in a control period, in units of their readings' noise, of each."""
    period: float
    """s."""
    push: tuple[tuple[float, ...], ...]
    """Velocity in B that each thruster gives in a period, m/s."""
    twist: tuple[tuple[float, ...], ...]
    """Angular velocity in B that it gives, rad/s."""
    share: tuple[_Share, ...]
    """How much each block of `Layout.body` has of position, velocity and angular velocity."""

    @classmethod
    def of(cls, craft: Spacecraft, task: Task, period: float, drift: Sequence[float]) -> Filters:
        """Of a spacecraft as designed; ConfigError where the task shows what no filter can follow."""
        force, torque = np.split(np.array(craft.wrench_map), [craft.dimension], axis=1)
        spins = slice(-torque.shape[1], None)  # in the plane about z alone
        inertia = np.array(craft.inertia)[spins, spins]
        gains = period / craft.mass * force, period * np.linalg.solve(inertia, torque.T).T
        push, twist = (tuple(map(tuple, gain.tolist())) for gain in gains)
        return cls(tuple(drift), period, push, twist, tuple(_shares(task, craft.dimension)))

    def fits(self, layout: Layout, thrusters: int) -> bool:
        """Whether it has as many rows and numbers as that takes."""
        axes, spins = (block.width for block in layout.blocks[:2])
        sizes = (thrusters, axes), (thrusters, spins), (len(layout.blocks), 3)
        return bool(self.drift) and tuple(map(np.shape, self[2:])) == sizes

    def width(self, layout: Layout) -> int:
        """Numbers that all of them remember of columns of this layout, that of the body."""
        return len(self.drift) * (layout.width + _NOTES)

    def estimates(self, layout: Layout, read: Columns, memory: Columns) -> list[list[Field]]:
        """What each filter makes of columns as they were read."""
        return [columns for columns, _ in self._read(layout, read, memory)]

    def expected(self, layout: Layout, read: Columns, memory: Columns, command: Columns) -> list[Field]:
        """What all remember after columns were read and answered with this command."""
        known = zip(self.drift, self._read(layout, read, memory), strict=True)
        return [x for drift, (columns, notes) in known
                for x in (*self._moved(layout, columns, command), *self._aged(notes, drift))]

    def _read(self, layout: Layout, read: Columns, memory: Columns) -> list[tuple[list[Field], Columns]]:
        """Columns and information of each filter once a reading is taken into account."""
        size, width = layout.width + _NOTES, layout.width
        own = [memory[start:start + size] for start in range(0, len(memory), size)]
        return [self._corrected(layout, read, one[:width], one[width:]) for one in own]

    def _corrected(self, layout: Layout, read: Columns, expected: Columns,
                   notes: Columns) -> tuple[list[Field], Columns]:
        """The columns expected, moved towards those read by Kalman's gains, and what is known then."""
        # A reading's noise is the unit: it adds 1 to the information about a pose and its velocity.
        pose, both, velocity = notes[0] + 1.0, notes[1], notes[2] + 1.0
        scale = 1.0 / (pose * velocity - both * both)
        gain = velocity * scale, -(both * scale), pose * scale

        # How far off what was expected is: how B is turned, then the rest, as seen in the B expected.
        blocks = list(zip(layout.split(read), layout.split(expected), self.share, strict=True))
        turns = [_tilt(now, then) for (block, now), (_, then), _ in blocks if issubclass(block.kind, Turn)]
        tilt: Columns = turns[0] if turns else [0.0] * len(self.twist[0])
        off = [self._off(block, now, then, [-0.5 * x for x in tilt]) for (block, now), (_, then), _ in blocks]
        off_place = _first(off, self.share, 0)
        off_velocity, off_spin = _first(off, self.share, 1), _first(off, self.share, 2)

        # Each block by its own error and by that of its derivative or integral; what no motion changes is as
        # it is read.
        half = _sum(0.5 * gain[0], tilt, 0.5 * gain[1], off_spin)
        own, others = (gain[0], gain[2], gain[2]), (off_velocity, off_place, tilt)
        found: list[Field] = []
        for ((block, _), (_, then), share), error in zip(blocks, off, strict=True):
            for k in _changing(share):
                error = _sum(own[k], error, gain[1] * share[k], others[k])
            found += _seen(block, _sum(1.0, then, 1.0, error), half)
        unknown = notes[0] == 0.0
        return [where(unknown, now, x) for x, now in zip(found, read, strict=True)], (pose, both, velocity)

    @staticmethod
    def _off(block: Block, now: Columns, then: Columns, half: Columns) -> Columns:
        """The error of a block; one that turns with B has none but its tilt."""
        if issubclass(block.kind, Turn):
            return [0.0] * len(then)
        return [a - b for a, b in zip(_seen(block, now, half), then, strict=True)]

    def _moved(self, layout: Layout, columns: Columns, command: Columns) -> list[Field]:
        """The columns a period later, of a rigid body on which nothing acts but its thrusters.

        Forces are constant in B; of its turning within the period the first order is kept.
        """
        push, twist = (_dot(command, gains) for gains in (self.push, self.twist))
        blocks = list(layout.split(columns))
        velocity = _first([mine for _, mine in blocks], self.share, 1)
        spin = _first([mine for _, mine in blocks], self.share, 2)
        half = [(w + 0.5 * more) * (0.5 * self.period) for w, more in zip(spin, twist, strict=True)]
        # Of tangents the second term: half the angle is no longer small in a fast turn.
        half = [x * (1.0 + sum(y * y for y in half) * (1.0 / 3.0)) for x in half]
        gained = [x + turn for x, turn in zip(push, _cross(half, push), strict=True)]
        way = [(v + 0.5 * more) * self.period for v, more in zip(velocity, push, strict=True)]
        found: list[Field] = []
        for (block, mine), share in zip(blocks, self.share, strict=True):
            for k in _changing(share):
                mine = _sum(1.0, mine, share[k], (way, gained, twist)[k])
            found += _seen(block, mine, half)
        return found

    def _aged(self, notes: Columns, drift: float) -> Columns:
        """The information a period later, when velocities have wandered."""
        pose, both, velocity = notes
        scale, period = 1.0 / (pose * velocity - both * both), self.period
        # The covariance, moved on as a pose is by its velocity.
        a, b, c = velocity * scale, -(both * scale), pose * scale
        a, b, c = a + period * (2.0 * b + period * c) + drift * (0.5 * period) ** 2, b + period * c, c + drift
        scale = 1.0 / (a * c - b * b)
        return c * scale, -(b * scale), a * scale


def _shares(task: Task, dimension: Dimension) -> list[_Share]:
    """How columns of the body's blocks change with position, velocity and angular velocity."""
    state, goal = example_state(task, dimension)
    entries = sight(task, state, goal).entries
    moved = [_nudged(state, name) for name in ("p", "v", "w")]
    changed = [sight(task, one, goal).entries for one in moved]
    return [(0.0, 0.0, 0.0) if issubclass(type(entry), Turn) else _share(entry, others)
            for entry, *others in zip(entries, *changed, strict=True) if not isinstance(entry, OwnAttitude)]


def _nudged(state: State, name: str) -> State:
    value = getattr(state, name)
    return replace(state, **{name: value + type(value)(1.0, *(0.0,) * (len(value.columns()) - 1))
                             if hasattr(value, "columns") else value + 1.0})


def _share(entry: Entry, others: Sequence[Entry]) -> _Share:
    """Of one block: what its first column gains by one unit of each, if it is linear in only one of them."""
    first, *rest = (np.asarray(x, float) for x in entry.columns())
    found = [float(np.round(np.asarray(one.columns()[0], float) - first, 9).reshape(-1)[0]) for one in others]
    still = all(np.allclose(np.asarray(b, float), a) for one in others for a, b in
                zip(rest, one.columns()[1:], strict=True))
    fits = found[:2] if isinstance(entry, VectorInW) else found[2:] if isinstance(entry, Spin) else []
    known = still and len(_changing(found)) <= 1 and any(found) == any(fits)
    if isinstance(entry, Drawn) or not known:
        raise ConfigError(f"filters cannot follow the observed {entry.name!r}: it is neither a place, a "
                          "velocity nor an angular velocity, but changes with them. Train without "
                          "filters, or let the task show it otherwise.")
    return found[0], found[1], found[2]


def _changing(share: Sequence[float]) -> list[int]:
    """Of position, velocity and angular velocity, which change a block: none, or one."""
    return [k for k, factor in enumerate(share) if factor]


def _first(values: Sequence[Columns], shares: Sequence[_Share], which: int) -> Columns:
    """Of the first block that has a share of it, in its units; zeros if there is none."""
    for mine, share in zip(values, shares, strict=True):
        if share[which]:
            return [x * (1.0 / share[which]) for x in mine]
    return [0.0] * len(values[0])


def _dot(command: Columns, gains: Sequence[Sequence[float]]) -> list[Field]:
    return [sum((c * gain for c, gain in zip(command, column, strict=True) if gain), start=command[0] * 0.0)
            for column in zip(*gains, strict=True)]


def _sum(a: Field, x: Columns, b: Field, y: Columns) -> list[Field]:
    return [a * p + b * q for p, q in zip(x, y, strict=True)]


def _cross(a: Columns, x: Columns) -> list[Field]:
    """Vector product; in the plane the first vector is along z, and its length stands for it."""
    if len(a) == 1:
        return [-(a[0] * x[1]), a[0] * x[0]]
    return list(Vec3(*a).cross(Vec3(*x)).columns())


def _turned(x: Columns, half: Columns) -> list[Field]:
    """A vector, seen in a frame that has turned by about twice this rotation vector (Cayley's transform)."""
    scale = 2.0 / (1.0 + sum(a * a for a in half))
    once = _cross(half, x)
    return [value + scale * (second - first) for value, first, second in
            zip(x, once, _cross(half, once), strict=True)]


def _seen(block: Block, columns: Columns, half: Columns) -> Columns:
    """A block's columns in a frame that has turned so."""
    if issubclass(block.kind, Turn):
        if len(columns) == 2:
            return _unit(_turned(columns, half))
        turned = [_turned(column, half) for column in zip(*matrix_rows(columns), strict=True)]
        first, second, _ = zip(*turned, strict=True)
        first = _unit(first)
        along = sum(a * b for a, b in zip(first, second, strict=True))
        return [*first, *_unit([b - along * a for a, b in zip(first, second, strict=True)])]
    return _turned(columns, half) if issubclass(block.kind, VectorInW) else columns


def _unit(x: Columns) -> list[Field]:
    """A vector of almost unit length, closer to it: rounding of rows turned again and again would grow.

    The error is squared, as by Newton's method, and no vector comes out longer than 1.
    """
    scale = 2.0 / (1.0 + sum(a * a for a in x))
    return [a * scale for a in x]


def _tilt(now: Columns, then: Columns) -> list[Field]:
    """How B is turned against where it was expected, as a rotation vector, from what both say of one turn."""
    if len(now) == 2:
        return [now[0] * then[1] - now[1] * then[0]]
    columns = [zip(*matrix_rows(one), strict=True) for one in (now, then)]
    turns = [_cross(a, b) for a, b in zip(*columns, strict=True)]
    return [0.5 * sum(axis) for axis in zip(*turns, strict=True)]
