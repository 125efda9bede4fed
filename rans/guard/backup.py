"""Safety filter of on/off and pulsed thrusters: a command passes if a way out of danger can be flown after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

from rans.episode import Command, World
from rans.guard.ahead import Ahead
from rans.guard.coasting import Coasting, periods_of
from rans.guard.manoeuvres import Manoeuvre, Thrusters, manoeuvres
from rans.guard.rows import (
    batched,
    copied,
    count,
    like,
    numbers,
    repeated,
    stacked,
    taken,
    truths,
    where_true,
)
from rans.model.fields import Field

_FEW = 2
"""Manoeuvres that are tried after commands near the wanted one."""
_BLENDS = (0.25, 0.5, 0.75)
"""Shares of a manoeuvre in the commands of pulsed valves near the wanted one."""


@dataclass(frozen=True)
class FlownBackup:
    """Safety filter by flown backups, a `rans.episode.Guard`.

    A state is safe if the craft may coast from now on (`rans.guard.coasting.Coasting`), or if one of
    `rans.guard.manoeuvres.manoeuvres` brings it, within ``periods`` control periods and with every margin kept
    at every check, to a state from which it may. A command passes if it keeps every margin at every check of its
    control period and leads to a safe state. So there is always a command that passes once a start is safe:
    to coast, or the next one of the manoeuvre by which the last command passed (a simplex filter with an
    implicit safe set; K. Hobbs et al., "Runtime Assurance for Safety-Critical Systems", IEEE Control Systems,
    2023). All is flown by the engine's own motion: nothing is linearised.

    Instead of a command that does not pass, the first of these is given that passes: commands that differ from
    it in one thruster (of pulsed valves, mixtures with a manoeuvre's command), all thrusters shut, the first
    command of a manoeuvre. If none passes, the first manoeuvre is flown.

    It knows the state as sensors tell it, and the craft as designed: of noise, late valves, faults and
    disturbances it knows nothing.
    """

    periods: int = 20
    """Control periods that a manoeuvre may take."""
    slack: float = 0.002
    """Least margin that passes, in each margin's unit: for rounding, and for motion that is not quite ours."""
    horizon: float | None = None
    """Time for which coasting is checked where that is not for ever, s; None: the length of an episode."""
    name: str = "flown backup"
    by_values: ClassVar[bool] = True

    def admitted(
        self, world: World, state: Any, goal: Any, command: Command
    ) -> tuple[Command, Field]:
        """See `rans.episode.Guard`."""
        (state, goal, command), single = batched((state, goal, tuple(command)))
        admitted, changed = self._filtered(world, state, goal, command)
        if single:
            return tuple(float(x[0]) for x in admitted), bool(changed[0])
        return admitted, changed

    def safe(self, world: World, state: Any, goal: Any) -> Field:
        """(N,) whether states of arrays or tensors (N,) are safe: whether the filter holds from there on."""
        search = _Search.of(self, world)
        return search.safe(state, goal, search.ways)

    def _filtered(
        self, world: World, state: Any, goal: Any, command: Command
    ) -> tuple[Command, Field]:
        search = _Search.of(self, world)
        size = count((state, command))
        command = tuple(x if getattr(x, "ndim", 0) else like(state, size, x) for x in command)
        refused = where_true(~search.passes(state, goal, command, search.ways))
        changed = truths(state, size)
        if not len(refused):
            return command, changed
        admitted = tuple(copied(x) for x in command)
        instead = search.instead(
            taken(state, refused), taken(goal, refused), taken(command, refused)
        )
        for x, new in zip(admitted, instead, strict=True):
            changed[refused] |= x[refused] != new
            x[refused] = new
        return admitted, changed


class _Arrival(NamedTuple):
    """What a control period leads to."""

    state: Any
    goal: Any
    kept: Field
    """Whether every margin was kept at every check."""
    free: Field
    """Whether it was, and the craft may coast from there."""


@dataclass(frozen=True)
class _Search:
    """A filter at work in one world."""

    world: World
    ahead: Ahead
    coasting: Coasting
    thrusters: Thrusters
    ways: tuple[Manoeuvre, ...]
    periods: int
    slack: float

    @classmethod
    def of(cls, guard: FlownBackup, world: World) -> _Search:
        timing = world.timing
        seconds = guard.horizon or timing.control_period * timing.episode_steps
        coasting = Coasting(world, guard.slack, periods_of(seconds, timing.control_period))
        ways = manoeuvres(world)
        return cls(
            world,
            Ahead(world),
            coasting,
            Thrusters.of(world),
            ways,
            guard.periods,
            guard.slack,
        )

    def safe(self, state: Any, goal: Any, ways: tuple[Manoeuvre, ...]) -> Field:
        """Whether it may coast from these states, or leave them by one of some manoeuvres."""
        safe = self.coasting.safe(state, goal)
        left = where_true(~safe)
        if len(left):
            safe[left] = self._escapes(taken(state, left), taken(goal, left), ways)
        return safe

    def _escapes(self, state: Any, goal: Any, ways: tuple[Manoeuvre, ...]) -> Field:
        """Whether one of some manoeuvres brings these states to where it may coast."""
        size = count(state)
        escaped = truths(state, size)
        left = numbers(state, size)
        # Most are brought out of danger by the first manoeuvre; for the rest all others are flown at once.
        for some in (ways[:1], ways[1:]):
            if some and len(left):
                free = self.leaves_by(some, taken(state, left), taken(goal, left)).any(0)
                escaped[left[free]] = True
                left = left[~free]
        return escaped

    def leaves_by(self, ways: tuple[Manoeuvre, ...], state: Any, goal: Any) -> Any:
        """(manoeuvres, N) whether a manoeuvre brings these states to where they may coast."""
        size = count(state)
        way = repeated(state, ways, size)
        again = stacked([numbers(state, size)] * len(ways))
        state = taken(state, again)
        goal = taken(goal, again)
        escaped = truths(state, len(again))
        rows = numbers(state, len(again))
        for _ in range(self.periods):
            arrival = self._manoeuvred(way, state, goal)
            escaped[rows[arrival.free]] = True
            going = where_true(arrival.kept & ~arrival.free)
            if not len(going):
                break
            rows = rows[going]
            way, state, goal = taken((way, arrival.state, arrival.goal), going)
        return escaped.reshape(len(ways), size)

    def command(self, way: Manoeuvre, state: Any, goal: Any) -> Command:
        """What a manoeuvre commands now."""
        return self.thrusters.pushing(state, way.push(self.world, state, goal))

    def _manoeuvred(self, way: Manoeuvre, state: Any, goal: Any) -> _Arrival:
        """What a control period of a manoeuvre leads to."""
        return self.held(state, goal, self.command(way, state, goal))

    def held(self, state: Any, goal: Any, command: Command) -> _Arrival:
        """What holding a command for a control period leads to."""
        arrival = self.ahead.fly(state, goal, command)
        kept = arrival.least >= self.slack
        free = kept & self.coasting.safe(arrival.state, arrival.goal)
        return _Arrival(arrival.state, arrival.goal, kept, free)

    def passes(self, state: Any, goal: Any, command: Command, ways: tuple[Manoeuvre, ...]) -> Field:
        """Whether commands keep every margin for a period, and lead to safe states."""
        arrival = self.held(state, goal, command)
        passed = arrival.free
        left = where_true(arrival.kept & ~arrival.free)
        if len(left):
            passed[left] = self._escapes(
                taken(arrival.state, left), taken(arrival.goal, left), ways
            )
        return passed

    def instead(self, state: Any, goal: Any, command: Command) -> Command:
        """Commands in place of those that do not pass."""
        size = count(state)
        first = self.command(self.ways[0], state, goal)
        admitted = [copied(x) for x in first]
        open_ = numbers(state, size)

        # Commands near the wanted one, all at once; the first that passes.
        near = self._near(command, first)
        if near:
            again = stacked([open_] * len(near))
            tried = tuple(stacked(list(column)) for column in zip(*near, strict=True))
            good = self.passes(taken(state, again), taken(goal, again), tried, self.ways[:_FEW])
            good = good.reshape(len(near), size)
            replaced = truths(state, size)
            for one, passed in zip(near, good, strict=True):
                new = where_true(passed & ~replaced)
                for x, y in zip(admitted, one, strict=True):
                    x[new] = y[new]
                replaced = replaced | passed
            open_ = open_[~replaced]

        # All shut, then manoeuvres.
        if len(open_):
            here, there = taken(state, open_), taken(goal, open_)
            coasts = self.coasting.safe(here, there)
            for x in admitted:
                x[open_[coasts]] = 0.0
            open_ = open_[~coasts]
        if len(open_):
            here, there = taken(state, open_), taken(goal, open_)
            works = self.leaves_by(self.ways, here, there)
            done = truths(here, len(open_))
            for way, work in zip(self.ways, works, strict=True):
                rows = where_true(work & ~done)
                done = done | work
                if len(rows):
                    tried = self.command(way, taken(here, rows), taken(there, rows))
                    for x, y in zip(admitted, tried, strict=True):
                        x[open_[rows]] = y
        return tuple(admitted)

    def _near(self, command: Command, first: Command) -> list[Command]:
        """Commands near the wanted ones."""
        thrusters = self.world.craft.thrusters
        if self.world.craft.actuators.is_continuous:
            return [
                tuple(x + (y - x) * share for x, y in zip(command, first, strict=True))
                for share in _BLENDS
            ]
        return [
            tuple(1.0 - x if i == k else x for i, x in enumerate(command))
            for k in range(len(thrusters))
        ]
