"""Safety filter for passive safety: if all thrusters shut, and stay shut, the coast keeps out of a zone.

Families of coasts are those of `rans_missions.passive_safety`, whose distances are certified.
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.extend import Command, Field, Spacecraft, World
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.backup import FlownBackup
from rans_missions.guard.expected import Reserve
from rans_missions.guard.replacing import Replacing
from rans_missions.guard.rows import like, taken
from rans_missions.passive_safety import (
    CoastZone,
    Pieces,
    joined,
    keep_away,
    least_distances,
    pieces_of_periods,
    single_coasts,
)

_SPARE = 5
"""Control periods by which coasts last longer than asked, so that some are left to change a coast that enters."""
_LEVELS = 0.25 ** np.arange(8)
"""Parts of full thrust in commands near the desired one: the least one changes a coast by metres in an orbit."""
_PARTS = 0.75, 0.5, 0.25, 0.0
"""Parts of the desired command that are tried."""
_TRIPLES = 8
"""Largest number of thrusters of which sets of three open together; else sets of two."""
_AT_ONCE = 128
"""Number of commands of a craft whose coasts are computed at once, the nearest first."""


@dataclass(frozen=True)
class SafeCoasts(Replacing):
    """Safety filter that keeps a craft passively safe, a `rans.episode.Guard` around another one.

    The other filter keeps the constraints of the task. After that a command passes if the craft, when all thrusters
    shut at any instant of the control period and stay shut, keeps out of the zone for the time of a coast. Near a
    circular orbit coasts are linear in the state (W. H. Clohessy and R. S. Wiltshire, 1960), and their least
    distance is a certified bound for all instants (`rans_missions.passive_safety`). Within the zone's approach
    everything passes.

    A command that does not pass is replaced by the nearest one that does (least sum of squared differences)
    among parts of the desired one, sets of one to three thrusters at eight levels, and sums of both. Coasts
    last five control periods longer than asked: the filter has that time to change one that would enter in the
    end. If no command passes, it returns the one whose coasts keep the largest distance. That distance leaves
    out coasts that already enter at the start of the period.

    The filter uses the measured state, and the craft as designed.
    """

    inner: FlownBackup
    """Filter of the task's constraints."""
    zone: CoastZone
    """What coasts keep out of."""
    mean_motion: float
    """Mean motion of the target's orbit, rad/s."""
    seconds: float
    """Time for which coasts last, s."""
    name: str = "safe coasts"

    @property
    def delay(self) -> float:
        """Time from a reading until the command acts that is decided by it, s."""
        return self.inner.delay

    def _expected(self) -> tuple[Reserve, float]:
        return self.inner.reserve, self.delay

    def passes(self, world: World, state: Any, goal: Any, command: Command) -> Field:
        """Whether the other filter passes commands (N,) that act in these states, and coasts are safe, (N,)."""
        result = self.inner.passes(world, state, goal, command)
        result[np.flatnonzero(~self._coast_safely(world, state, goal, command))] = False
        return result

    def _coast_safely(self, world: World, state: Any, goal: Any, command: Command) -> np.ndarray:
        ahead = Ahead(world, self.inner.reserve)
        starts = _rows(state)
        near = np.linalg.norm(starts[:, :3], axis=1) < self.zone.approach
        return near | self._keeps(self._coasts(ahead, state, goal, command), len(starts))

    def _instead(self, world: World, state: Any, goal: Any, command: Command) -> Command:
        """Commands (N,) of the inner filter, and the nearest with a safe coast where their coast is not."""
        # The other filter first; the search begins at what it admits.
        admitted, _ = self.inner.admitted(world, state, goal, command)
        ahead = Ahead(world, self.inner.reserve)
        for row in np.flatnonzero(~self._coast_safely(world, state, goal, admitted)):
            one = taken((state, goal, admitted), slice(row, row + 1))
            for x, new in zip(admitted, self._nearest(world, ahead, *one), strict=True):
                x[row] = new
        return admitted

    def safe(self, world: World, state: Any, goal: Any) -> Field:
        """Whether the other filter keeps all margins from these states (N,), and their coasts are safe, (N,)."""
        safe = self.inner.safe(world, state, goal)
        rows = _rows(state)
        lasting = np.full(len(rows), self.seconds + _SPARE * world.timing.control_period)
        keeps = self._keeps(single_coasts(rows, lasting, np.arange(len(rows))), len(rows))
        keeps |= np.linalg.norm(rows[:, :3], axis=1) < self.zone.approach
        safe[np.flatnonzero(~keeps)] = False
        return safe

    def _keeps(self, coasts: Pieces, size: int) -> np.ndarray:
        return keep_away(self.mean_motion, coasts, size, self.zone.radius)

    def _coasts(self, ahead: Ahead, state: Any, goal: Any, command: Command) -> Pieces:
        """Coasts from all instants of a control period with commands, and from its end for longer, (N,) flights.

        Pieces bear the row of their flight, by which `keep_away` and `least_distances` put them together.
        """
        n, period = self.mean_motion, ahead.world.timing.control_period
        before, after = _rows(state), _rows(ahead.fly(state, goal, command).state)
        everyone = np.arange(len(before))
        asked = np.full(len(before), self.seconds + period)
        starts = self._keeps(single_coasts(before, asked, everyone), len(before))
        some = np.flatnonzero(starts)
        return joined(
            [
                pieces_of_periods(
                    n, before[some], after[some], period, self.seconds, self.zone.radius, some
                ),
                single_coasts(after, asked + (_SPARE - 1) * period, everyone),
            ]
        )

    def _nearest(
        self, world: World, ahead: Ahead, state: Any, goal: Any, command: Command
    ) -> np.ndarray:
        """Nearest command (thrusters,) that passes, of one craft; the one that coasts farthest off if none does."""
        desired = np.array([float(x[0]) for x in command])
        tried = _near(world.craft, desired)
        farthest, best = -1.0, desired
        for begin in range(0, len(tried), _AT_ONCE):
            some = tried[begin : begin + _AT_ONCE]
            states, goals = taken((state, goal), np.zeros(len(some), int))
            columns = tuple(_as(x, state) for x in some.T)
            coasts = self._coasts(ahead, states, goals, columns)
            for row in np.flatnonzero(self._keeps(coasts, len(some))).tolist():
                if self._allows(world, states, goals, columns, row):
                    return some[row]
            distances = least_distances(self.mean_motion, coasts, len(some))
            row = int(np.argmax(distances))
            if distances[row] > farthest and self._allows(world, states, goals, columns, row):
                farthest, best = float(distances[row]), some[row]
        return best

    def _allows(self, world: World, state: Any, goal: Any, command: Command, row: int) -> bool:
        """Whether the other filter passes the command in a row."""
        one = taken((state, goal, command), slice(row, row + 1))
        return bool(self.inner.passes(world, *one)[0])


def _near(craft: Spacecraft, desired: np.ndarray) -> np.ndarray:
    """Commands (K, thrusters) near a desired one, the nearest first.

    The order is stable, so that it decides between equally near ones alike on every machine.
    """
    thrusters = craft.thruster_count
    largest = 3 if thrusters <= _TRIPLES else 2
    levels = _LEVELS if craft.is_continuous else _LEVELS[:1]
    opened = [
        np.isin(np.arange(len(desired)), some).astype(float)
        for number in range(1, largest + 1)
        for some in itertools.combinations(range(thrusters), number)
    ]
    pushes = np.concatenate([level * np.array(opened) for level in levels])
    low = np.array([x.low for x in craft.commands])
    high = np.array([x.high for x in craft.commands])
    scaled = np.outer(_PARTS if craft.is_continuous else (0.0,), desired)
    sums = [np.clip(desired + pushes, low, high), np.clip(desired - pushes, low, high)]
    tried = np.unique(np.concatenate([scaled, pushes, *sums]), axis=0)
    distance = np.sum((tried - desired) ** 2, axis=1)
    order = np.argsort(distance, kind="stable")
    return tried[order[distance[order] > 0.0]]


def _numpy(x: Any) -> np.ndarray:
    """An array or a tensor as an array."""
    return x if isinstance(x, np.ndarray) else x.cpu().numpy()


def _as(x: np.ndarray, tree: Any) -> Any:
    """An array in the library and the precision of a tree's fields."""
    example = like(tree, 1)
    if isinstance(example, np.ndarray):
        return x.astype(example.dtype)
    return sys.modules["torch"].as_tensor(x, dtype=example.dtype, device=example.device)


def _rows(state: Any) -> np.ndarray:
    """Positions and velocities (N, 6) of states in space, as float64."""
    columns = [_numpy(x + like(state, 1)) for x in (*state.p.columns(), *state.v.columns())]
    return np.stack(np.broadcast_arrays(*columns), axis=1).astype(np.float64)
