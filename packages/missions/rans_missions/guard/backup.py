"""Safety filter by simulation: a command passes if a backup manoeuvre is safe after it.

Fields (N,): each craft is judged alone; safe means that a manoeuvre from there keeps every margin to the horizon.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rans.extend import Command, Field, World, leaves, map_leaves
from rans_missions.guard.ahead import SLACK, Ahead
from rans_missions.guard.coasting import Coasting, periods_of
from rans_missions.guard.expected import PERIODS, Reserve
from rans_missions.guard.manoeuvres import (
    Manoeuvre,
    Thrusters,
    braking_command,
    manoeuvres,
    slowest_change,
)
from rans_missions.guard.rows import count, is_array, on_numpy, repeated, taken

_FEW = 2
"""Number of manoeuvres that are tried after commands near the desired one."""
_BLENDS = (0.25, 0.5, 0.75)
"""Shares of a manoeuvre in commands of throttles and pulsed valves near the desired one."""


@dataclass(frozen=True)
class FlownBackup:
    """Safety filter by simulated backup manoeuvres, a `rans.episode.step.Guard`.

    A state is safe if the craft may coast from it (`rans_missions.guard.coasting.Coasting`), or if one of
    `rans_missions.guard.manoeuvres.manoeuvres` brings it to such a state within ``periods`` control periods, with
    every margin kept at every check. Throttles brake instead: a state is safe if
    `rans_missions.guard.manoeuvres.braking_command` keeps every margin until the craft is at rest relative to the
    goal, from where it retreats slowly from the nearest boundary. A command passes if it keeps every margin at
    every check of its control period and leads to a safe state. From a safe start there is always a command that
    passes: coasting, or the next command of the manoeuvre by which the last command passed. This is a simplex
    filter with an implicit safe set (K. Hobbs et al., "Runtime Assurance for Safety-Critical Systems", IEEE Control
    Systems, 2023). All predictions use the engine's equations of motion without linearisation.

    A command that does not pass is replaced by the first of these that does: commands that differ from it in one
    thruster (for throttles and pulsed valves, mixtures with the command of a manoeuvre), all thrusters shut, and
    the first command of a manoeuvre. If none passes, because a reading is worse than those before, the backup is
    flown whose least margin is largest.

    It uses the measured state and the craft as designed. `rans_missions.guard.safety_filter` sets reserve and delay
    for known noise and delays; faults and disturbances are not accounted for.
    """

    by_values: ClassVar[bool] = True

    periods: int = PERIODS
    """Largest number of control periods of a backup manoeuvre, or of braking."""
    slack: float = SLACK
    """Least margin that passes, in the unit of each margin."""
    reserve: Reserve = ()
    """Margins that are held in reserve beyond the slack for errors, by constraint."""
    delay: float = 0.0
    """Time from a reading until the command acts that is decided by it, s."""
    horizon: float | None = None
    """Time for which coasting is checked if it cannot be checked for all times, s; None: the length of an
    episode."""
    name: str = "flown backup"

    def admitted(
        self,
        world: World,
        state: Any,
        goal: Any,
        command: Command,
        before: tuple[Command, ...] = (),
    ) -> tuple[Command, Field]:
        """Safe command in place of the desired one, and whether it differs; see `Guard.admitted`."""
        given: Any = next((x for x in leaves((state, goal, command)) if is_array(x)), None)
        state, goal, command, before = on_numpy((state, goal, tuple(command), before))
        if given is None:
            state, goal, before = map_leaves(lambda x: np.array([x]), (state, goal, before))
        size = count((state, command)) if given is not None else 1
        command = tuple(np.array(np.broadcast_to(x, size)) for x in command)
        search = _Search(self, world)
        state, goal = search.ahead.delayed(state, goal, before, self.delay)
        refused = np.flatnonzero(~search.passes(state, goal, command, search.ways))
        changed = np.zeros(size, bool)
        if len(refused):
            instead = search.instead(*taken((state, goal, command), refused))
            for x, new in zip(command, instead, strict=True):
                changed[refused] |= x[refused] != new
                x[refused] = new
        if given is None:
            return tuple(float(x[0]) for x in command), bool(changed[0])
        if isinstance(given, np.ndarray):
            return command, changed
        # Of torch, on the device of the fields.
        return tuple(given.new_tensor(x) for x in command), given.new_tensor(changed) > 0

    def safe(self, world: World, state: Any, goal: Any) -> Field:
        """Whether states (N,) of arrays are safe: the filter can keep all margins from there, (N,)."""
        search = _Search(self, world)
        return search.safe(state, goal, search.ways)


class _Search:
    """Predictions of a filter in one world."""

    def __init__(self, guard: FlownBackup, world: World) -> None:
        timing = world.timing
        seconds = guard.horizon or timing.control_period * timing.episode_steps
        horizon = periods_of(seconds, timing.control_period)
        self._world = world
        self.ahead = Ahead(world, guard.reserve)
        self._coasting = Coasting(self.ahead, horizon)
        self._thrusters = Thrusters.of(world)
        # Throttles have one manoeuvre: to brake.
        self._brakes = world.craft.actuators.kind == "throttle"
        self.ways = manoeuvres(world)[: 1 if self._brakes else None]
        self._periods = guard.periods
        self._slack = guard.slack

    def coasts(self, state: Any, goal: Any) -> Field:
        """Least margin of coasting from these states, (N,); a craft that brakes does not rely on it."""
        if self._brakes:
            return np.full(count(state), -np.inf)
        return self._coasting.least(state, goal)

    def safe(self, state: Any, goal: Any, library: tuple[Manoeuvre, ...]) -> Field:
        """Whether the craft may coast from these states, or reach such a state by one of these manoeuvres, (N,)."""
        safe = self.coasts(state, goal) >= self._slack
        # The first manoeuvre succeeds from most states; for the rest all others are predicted at once.
        for some in (library[:1], library[1:]):
            left = np.flatnonzero(~safe)
            if some and len(left):
                kept = self.kept(some, taken(state, left), taken(goal, left), self._slack)
                safe[left] = (kept >= self._slack).any(axis=0)
        return safe

    def kept(self, library: tuple[Manoeuvre, ...], state: Any, goal: Any, floor: float) -> Any:
        """Least margin with which each manoeuvre leads to a state from which the craft may coast, (manoeuvres, N).

        It is that of the manoeuvre and the coast after it, at the period where it is largest; a craft that brakes
        is at rest in place of coasting. A manoeuvre ends once this margin passes, or one on the way is below a
        floor.
        """
        size = count(state)
        again = np.tile(np.arange(size), len(library))
        manoeuvre = repeated(library, size)
        state, goal = taken((state, goal), again)
        most = np.full(len(again), -np.inf)
        least = np.full(len(again), np.inf)
        rows = np.arange(len(again))
        for _ in range(self._periods):
            arrival = self.ahead.fly(state, goal, self.command(manoeuvre, state, goal))
            least = np.minimum(least, arrival.least)
            if self._brakes:
                # A craft that is slow at the start of a period stops within it, and then retreats.
                slow = (state.v - goal.v).norm() < 0.5 * slowest_change(self._world)
                then = np.where(slow, np.inf, -np.inf)
            else:
                then = self._coasting.least(arrival.state, arrival.goal)
            most[rows] = np.maximum(most[rows], np.minimum(least, then))
            going = np.flatnonzero((least >= floor) & (most[rows] < self._slack))
            if not len(going):
                break
            rows, least = rows[going], least[going]
            manoeuvre, state, goal = taken((manoeuvre, arrival.state, arrival.goal), going)
        return most.reshape(len(library), size)

    def command(self, manoeuvre: Manoeuvre, state: Any, goal: Any) -> Command:
        """Command of a manoeuvre in these states."""
        if self._brakes:
            return braking_command(self._world, state, goal)
        return self._thrusters.pushing(state, manoeuvre.push(self._world, state, goal))

    def passes(
        self, state: Any, goal: Any, command: Command, library: tuple[Manoeuvre, ...]
    ) -> Field:
        """Whether (N,) commands keep every margin for a period, and lead to states that are safe (`safe`)."""
        arrival = self.ahead.fly(state, goal, command)
        passed = arrival.least >= self._slack
        left = np.flatnonzero(passed)
        if len(left):
            passed[left] = self.safe(taken(arrival.state, left), taken(arrival.goal, left), library)
        return passed

    def instead(self, state: Any, goal: Any, command: Command) -> np.ndarray:
        """Replacements (commands, N) of commands that do not pass: near ones, then a backup's.

        Rows are independent: each gets the first of these that passes.
        """
        size = count(state)
        # Commands near the desired one, all at once, the nearest first.
        first = self.command(self.ways[0], state, goal)
        near = np.array(self._near(command, first))
        again = np.tile(np.arange(size), len(near))
        tried = tuple(np.concatenate(near, axis=1))
        good = self.passes(taken(state, again), taken(goal, again), tried, self.ways[:_FEW])
        good = good.reshape(len(near), size)
        result = near[good.argmax(axis=0), :, np.arange(size)].T
        left = np.flatnonzero(~good.any(axis=0))
        if len(left):
            result[:, left] = self._backup(taken(state, left), taken(goal, left))
        return result

    def _backup(self, state: Any, goal: Any) -> np.ndarray:
        """Commands (commands, N) of backups: all shut, or the first of the manoeuvres, whichever works first.

        Where none works, it is that whose least margin is largest.
        """
        if self._brakes:
            return np.array(braking_command(self._world, state, goal))
        size = count(state)
        coasting = self.coasts(state, goal)[None]
        kept = np.concatenate([coasting, self.kept(self.ways, state, goal, self._slack)])
        works = kept >= self._slack
        lost = np.flatnonzero(~works.any(axis=0))
        if len(lost):
            kept[1:, lost] = self.kept(self.ways, taken(state, lost), taken(goal, lost), -np.inf)
        chosen = np.where(works.any(axis=0), works.argmax(axis=0), kept.argmax(axis=0))
        again = np.tile(np.arange(size), len(self.ways))
        pushes = self.command(repeated(self.ways, size), taken(state, again), taken(goal, again))
        commands = np.reshape(pushes, (-1, len(self.ways), size))
        commands = np.concatenate([0.0 * commands[:, :1], commands], axis=1)
        return commands[:, chosen, np.arange(size)]

    def _near(self, command: Command, first: Command) -> list[Command]:
        """Commands near the desired ones, the nearest first.

        Mixtures with the first manoeuvre, or one valve changed.
        """
        if self._world.craft.actuators.is_continuous:
            return [
                tuple(x + (y - x) * blend for x, y in zip(command, first, strict=True))
                for blend in _BLENDS
            ]
        return [
            tuple(1.0 - x if i == k else x for i, x in enumerate(command))
            for k in range(self._world.craft.thruster_count)
        ]
