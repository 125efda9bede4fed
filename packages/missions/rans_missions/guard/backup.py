"""Safety filter by simulation: a command passes if a backup manoeuvre is safe after it.

Fields (N,): each craft is judged alone; safe means that a manoeuvre from there keeps every margin to the horizon.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rans.episode import Command
from rans.extend import Field, World, leaves, map_leaves
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
    """Safety filter by simulated backup manoeuvres, a `rans.episode.Guard`.

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
        """Safe command in place of the desired one, and whether it differs; see `rans.episode.Guard.admitted`."""
        given: Any = next((x for x in leaves((state, goal, command)) if is_array(x)), None)
        state, goal, command, before = on_numpy((state, goal, tuple(command), before))
        if given is None:
            state, goal, before = map_leaves(lambda x: np.array([x]), (state, goal, before))
        size = count((state, command)) if given is not None else 1
        command = tuple(np.array(np.broadcast_to(x, size)) for x in command)
        search = _Search.of(self, world)
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
        search = _Search.of(self, world)
        return search.safe(state, goal, search.ways)


class _Arrival(NamedTuple):
    """Predicted result of a control period."""

    state: Any
    goal: Any
    kept: Field
    """Whether every margin is kept at every check."""
    free: Field
    """Whether every margin is kept and the craft may coast from there."""


@dataclass(frozen=True)
class _Search:
    """Predictions of a filter in one world."""

    world: World
    ahead: Ahead
    coasting: Coasting
    thrusters: Thrusters
    ways: tuple[Manoeuvre, ...]
    periods: int
    slack: float
    brakes: bool
    """Whether thrusters are throttles, whose one manoeuvre is to brake."""

    @classmethod
    def of(cls, guard: FlownBackup, world: World) -> _Search:
        """The search of a filter in one world: its manoeuvres, and how far ahead they are flown."""
        timing = world.timing
        seconds = guard.horizon or timing.control_period * timing.episode_steps
        horizon = periods_of(seconds, timing.control_period)
        ahead = Ahead(world, guard.reserve)
        coasting = Coasting(ahead, guard.slack, horizon)
        library = manoeuvres(world)
        brakes = world.craft.actuators.kind == "throttle"
        return cls(
            world,
            ahead,
            coasting,
            Thrusters.of(world),
            library[:1] if brakes else library,
            guard.periods,
            guard.slack,
            brakes,
        )

    def coasts(self, state: Any, goal: Any) -> Field:
        """Whether the craft may coast from these states, (N,); one that brakes does not rely on it."""
        if self.brakes:
            return np.zeros(count(state), bool)
        return self.coasting.safe(state, goal)

    def safe(self, state: Any, goal: Any, library: tuple[Manoeuvre, ...]) -> Field:
        """Whether the craft may coast from these states, or reach such a state by one of these manoeuvres."""
        safe = self.coasts(state, goal)
        left = np.flatnonzero(~safe)
        if len(left):
            safe[left] = self._escapes(taken(state, left), taken(goal, left), library)
        return safe

    def _escapes(self, state: Any, goal: Any, library: tuple[Manoeuvre, ...]) -> Field:
        """Whether (N,) one of these manoeuvres leads to a state from which the craft may coast.

        The first is tried alone.
        """
        size = count(state)
        escaped = np.zeros(size, bool)
        left = np.arange(size)
        # The first manoeuvre succeeds from most states; for the rest all others are predicted at once.
        for some in (library[:1], library[1:]):
            if some and len(left):
                free = self.leaves_by(some, taken(state, left), taken(goal, left)).any(0)
                escaped[left[free]] = True
                left = left[~free]
        return escaped

    def leaves_by(self, library: tuple[Manoeuvre, ...], state: Any, goal: Any) -> Any:
        """Whether each manoeuvre leads to a state from which the craft may coast, (manoeuvres, N).

        Rows that have left or lost are dropped on the way; the order of manoeuvres is that of the library.
        """
        size = count(state)
        manoeuvre = repeated(library, size)
        again = np.tile(np.arange(size), len(library))
        state = taken(state, again)
        goal = taken(goal, again)
        escaped = np.zeros(len(again), bool)
        rows = np.arange(len(again))
        for _ in range(self.periods):
            arrival = self._manoeuvred(manoeuvre, state, goal)
            escaped[rows[arrival.free]] = True
            going = np.flatnonzero(arrival.kept & ~arrival.free)
            if not len(going):
                break
            rows = rows[going]
            manoeuvre, state, goal = taken((manoeuvre, arrival.state, arrival.goal), going)
        return escaped.reshape(len(library), size)

    def command(self, manoeuvre: Manoeuvre, state: Any, goal: Any) -> Command:
        """Command of a manoeuvre in these states."""
        if self.brakes:
            return braking_command(self.world, state, goal)
        return self.thrusters.pushing(state, manoeuvre.push(self.world, state, goal))

    def _manoeuvred(self, manoeuvre: Manoeuvre, state: Any, goal: Any) -> _Arrival:
        """Predicted result of a control period of a manoeuvre."""
        arrival = self.held(state, goal, self.command(manoeuvre, state, goal))
        if not self.brakes:
            return arrival
        # A craft that is slow at the start of a period stops within it, and then retreats.
        slow = (state.v - goal.v).norm() < 0.5 * slowest_change(self.world)
        return arrival._replace(free=arrival.kept & slow)

    def held(self, state: Any, goal: Any, command: Command) -> _Arrival:
        """Predicted result of holding a command for a control period."""
        arrival = self.ahead.fly(state, goal, command)
        holds = arrival.least >= self.slack
        free = holds & self.coasts(arrival.state, arrival.goal)
        return _Arrival(arrival.state, arrival.goal, holds, free)

    def passes(
        self, state: Any, goal: Any, command: Command, library: tuple[Manoeuvre, ...]
    ) -> Field:
        """Whether (N,) commands keep every margin for a period, and a manoeuvre is safe after each.

        Coasting is asked first, as it is cheap; only the others fly manoeuvres.
        """
        arrival = self.held(state, goal, command)
        passed = arrival.free
        left = np.flatnonzero(arrival.kept & ~arrival.free)
        if len(left):
            passed[left] = self._escapes(
                taken(arrival.state, left), taken(arrival.goal, left), library
            )
        return passed

    def instead(self, state: Any, goal: Any, command: Command) -> Command:
        """Replacements (N,) of commands that do not pass: near ones, then a backup's, then whatever keeps most.

        Rows are independent: each gets the first of these that passes.
        """
        size = count(state)
        first = self.command(self.ways[0], state, goal)
        admitted = [np.array(x) for x in first]
        open_ = np.arange(size)

        # Commands near the desired one, all at once; the first that passes.
        near = self._near(command, first)
        if near:
            again = np.tile(open_, len(near))
            tried = tuple(map(np.concatenate, zip(*near, strict=True)))
            good = self.passes(taken(state, again), taken(goal, again), tried, self.ways[:_FEW])
            good = good.reshape(len(near), size)
            replaced = np.zeros(size, bool)
            for neighbour, passed in zip(near, good, strict=True):
                new = np.flatnonzero(passed & ~replaced)
                for x, y in zip(admitted, neighbour, strict=True):
                    x[new] = y[new]
                replaced = replaced | passed
            open_ = open_[~replaced]

        # All shut, then manoeuvres.
        if len(open_):
            open_ = self.backups(admitted, state, goal, open_)
        if len(open_):
            best = self.best(taken(state, open_), taken(goal, open_))
            for x, y in zip(admitted, best, strict=True):
                x[open_] = y
        return tuple(admitted)

    def backups(self, admitted: list[Any], state: Any, goal: Any, open_: Any) -> Any:
        """Set commands of rows ``open_`` to those of backups that work; the rows without any.

        ``admitted`` is changed in place: columns of commands of all rows.
        """
        states, goals = taken(state, open_), taken(goal, open_)
        coasts = self.coasts(states, goals)
        for x in admitted:
            x[open_[coasts]] = 0.0
        open_ = open_[~coasts]
        if not len(open_):
            return open_
        states, goals = taken(state, open_), taken(goal, open_)
        works = self.leaves_by(self.ways, states, goals)
        done = np.zeros(len(open_), bool)
        for manoeuvre, work in zip(self.ways, works, strict=True):
            rows = np.flatnonzero(work & ~done)
            done = done | work
            if len(rows):
                tried = self.command(manoeuvre, taken(states, rows), taken(goals, rows))
                for x, y in zip(admitted, tried, strict=True):
                    x[open_[rows]] = y
        return open_[~done]

    def best(self, state: Any, goal: Any) -> Command:
        """Commands of the backups whose least margin is largest: coasting, or a manoeuvre and then coasting."""
        if self.brakes:
            return braking_command(self.world, state, goal)
        size = count(state)
        kept = self.coasting.least(state, goal)
        result = tuple(np.zeros(size) for _ in self.world.craft.commands)
        again = np.tile(np.arange(size), len(self.ways))
        manoeuvre = repeated(self.ways, size)
        state, goal = taken((state, goal), again)
        first = self.command(manoeuvre, state, goal)
        command = first
        least = np.full(len(again), np.inf)
        most = -least
        for _ in range(self.periods):
            arrival = self.ahead.fly(state, goal, command)
            state, goal = arrival.state, arrival.goal
            least = np.minimum(least, arrival.least)
            then = np.minimum(least, self.coasting.least(state, goal))
            most = np.maximum(then, most)
            command = self.command(manoeuvre, state, goal)
        rows = most.reshape(len(self.ways), size)
        commands = [x.reshape(len(self.ways), size) for x in first]
        for k in range(len(self.ways)):
            better = rows[k] > kept
            kept = np.where(better, rows[k], kept)
            result = tuple(np.where(better, x[k], y) for x, y in zip(commands, result, strict=True))
        return result

    def _near(self, command: Command, first: Command) -> list[Command]:
        """Commands near the desired ones, the nearest first.

        Mixtures with the first manoeuvre, or one valve changed.
        """
        if self.world.craft.actuators.is_continuous:
            return [
                tuple(x + (y - x) * blend for x, y in zip(command, first, strict=True))
                for blend in _BLENDS
            ]
        return [
            tuple(1.0 - x if i == k else x for i, x in enumerate(command))
            for k in range(self.world.craft.thruster_count)
        ]
