"""Safety filter of throttles by quadratic programs: the nearest command that keeps every margin.

Fields (N,): each craft is filtered alone; margins are in the units of their constraints.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rans.episode import Command
from rans.extend import ConfigError, Field, Spacecraft, World, at_least, where
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.manoeuvres import slope_of_least
from rans_missions.guard.quadratic import nearest
from rans_missions.guard.replacing import Predicting
from rans_missions.guard.rows import (
    copied,
    count,
    like,
    stacked,
    stacked_columns,
    taken,
    truths,
    where_true,
)

_ROUNDS = 3
"""Number of quadratic programs, each linearised about the solution of the last one."""
_STEP = 0.05
"""Step of the difference quotients as a share of a command's range."""
_BEYOND = 1.5
"""Slacks at which programs aim, so that errors of the linearisation leave a whole slack."""
_RETREAT = 0.01
"""Speed out of the constraints with which braking ends, as a share of a period's velocity change."""
_BLENDS = (0.25, 0.5, 0.75)
"""Shares of braking that are tried if the solution does not keep the margins."""


@dataclass(frozen=True)
class BarrierProgram(Predicting):
    """Safety filter by quadratic programs, a `rans.episode.Guard`.

    A state is safe if braking keeps the margin of every constraint above ``slack`` at every check, and between them
    as far as a parabola tells, until the craft is at rest relative to the goal, within ``periods`` control periods.
    A command passes if it keeps them for its period and leads to a safe state. Braking is a feedback law without a
    memory: from a safe state it passes itself, so that a safe state stays safe. In the end it retreats slowly from
    the nearest boundary, so that rest is safe for good. This is active-set invariance filtering with an implicit
    safe set (T. Gurriet et al., "Towards a Framework for Realizable Safety Critical Control through Active Set
    Invariance", ICCPS, 2018).

    In place of another command it returns the nearest that passes (least sum of squared differences), less what
    opposite thrusters have in common. Margins are linearised about the command by difference quotients of
    predictions, up to three times. The solution is checked by a prediction; if it does not pass, it is mixed with
    braking, or is braking alone.
    """

    name: str = "barrier program"

    def passes(self, world: World, state: Any, goal: Any, command: Command) -> Field:
        """Whether commands (N,) of arrays or tensors pass unchanged, without a delay, (N,)."""
        return _Search.of(self, world).kept(state, goal, command)

    def safe(self, world: World, state: Any, goal: Any) -> Field:
        """Whether braking keeps every margin from these states on, (N,)."""
        search = _Search.of(self, world)
        margins = search.ahead.margins(state, goal).values()
        return search.above((*search.braking(state, goal), *margins), count(state), state)

    def _instead(self, world: World, state: Any, goal: Any, command: Command) -> Command:
        return _Search.of(self, world).instead(state, goal, command)


@dataclass(frozen=True)
class _Search:
    """Predictions of a filter in one world."""

    guard: BarrierProgram
    world: World
    ahead: Ahead

    @classmethod
    def of(cls, guard: BarrierProgram, world: World) -> _Search:
        return cls(guard, world, Ahead.of(world, guard.reserve))

    def margins(self, state: Any, goal: Any, command: Command) -> list[Any]:
        """Every margin at every check of the command's period, then the least of each while the craft brakes."""
        arrival = self.ahead.fly(state, goal, command)
        margins = [margin for margins in arrival.margins for margin in margins.values()]
        return margins + self.braking(arrival.state, arrival.goal)

    def braking(self, state: Any, goal: Any) -> list[Any]:
        """Least value of each margin while the craft brakes, and the speed of rest less that at the end.

        The speed of rest is the velocity change of a control period of thrust. Keys are those of
        `Task.constraints`.
        """
        least: dict[str, Any] = {}
        rest = slowest_change(self.world)
        for _ in range(self.guard.periods):
            at_rest = bool((_speed(state, goal) < 0.5 * rest).all())
            arrival = self.ahead.fly(state, goal, braking_command(self.world, state, goal))
            for margins in arrival.margins:
                for name, margin in margins.items():
                    before = least.get(name, margin)
                    least[name] = where(margin < before, margin, before)
            state = arrival.state
            goal = arrival.goal
            # A craft that is slow at the start of a period stops within it, and then retreats.
            if at_rest:
                break
        return [*least.values(), rest - _speed(state, goal)]

    def above(self, margins: Iterable[Any], size: int, tree: Any) -> Any:
        """Whether all margins are at least the slack, (N,)."""
        holds = truths(tree, size) | True
        for margin in margins:
            holds = holds & (margin >= self.guard.slack)
        return holds

    def kept(self, state: Any, goal: Any, command: Command) -> Any:
        """Whether commands keep all margins, and braking after them, (N,)."""
        size = count((state, command))
        return self.above(self.margins(state, goal, command), size, (state, command))

    def instead(self, state: Any, goal: Any, command: Command) -> Command:
        """Nearest commands (N,) that keep all margins, within their ranges.

        Mixed with braking where none is found.
        """
        ranges = self.world.craft.commands
        size = count((state, command))
        requested = stacked_columns(list(command))
        low = stacked_columns([like(command, 1, command_range.low) for command_range in ranges])[0]
        high = stacked_columns([like(command, 1, command_range.high) for command_range in ranges])[
            0
        ]
        aim = self.guard.slack * _BEYOND
        replacement = tuple(
            where(
                x < command_range.low,
                command_range.low,
                where(x > command_range.high, command_range.high, x),
            )
            for x, command_range in zip(command, ranges, strict=True)
        )
        open_ = where_true(truths(state, size) | True)
        for _ in range(_ROUNDS):
            states, goals, around = taken((state, goal, replacement), open_)
            margins = stacked_columns(self.margins(states, goals, around))
            slopes = self._slopes(states, goals, around, margins)
            linear = aim - margins + (slopes * stacked_columns(list(around))[:, None, :]).sum(-1)
            solved = nearest(requested[open_], slopes, linear, low, high)
            tried = self._without_opposites(tuple(solved[:, k] for k in range(len(ranges))))
            for x, new in zip(replacement, tried, strict=True):
                x[open_] = new
            open_ = open_[~self.kept(states, goals, tried)]
            if not len(open_):
                return replacement

        # If the programs have no solution that passes, mix it with braking, which passes from a safe state.
        brake = braking_command(self.world, *taken((state, goal), open_))
        tried = taken(replacement, open_)
        for blend in (*_BLENDS, 1.0):
            mixed = tuple(x + (y - x) * blend for x, y in zip(tried, brake, strict=True))
            mixed = self._without_opposites(mixed)
            for x, new in zip(replacement, mixed, strict=True):
                x[open_] = new
            states, goals = taken((state, goal), open_)
            bad = where_true(~self.kept(states, goals, mixed))
            if not len(bad):
                break
            open_ = open_[bad]
            brake, tried = taken((brake, tried), bad)
        return replacement

    def _without_opposites(self, command: Command) -> Command:
        """Commands with the same force and torque, without what two opposite thrusters have in common."""
        result = list(command)
        for k, opposite in self.opposites:
            both = where(result[k] < result[opposite], result[k], result[opposite])
            result[k] = result[k] - both
            result[opposite] = result[opposite] - both
        return tuple(result)

    @cached_property
    def opposites(self) -> list[tuple[int, int]]:
        """Pairs of thrusters with opposite forces and torques, each thruster in one pair at most."""
        effects = np.array(self.world.craft.wrench_map)
        pairs: list[tuple[int, int]] = []
        for k, effect in enumerate(effects):
            paired = {index for pair in pairs for index in pair}
            others = np.flatnonzero(np.isclose(effects, -effect, atol=1e-9).all(axis=1))
            free = [int(index) for index in others if index > k and index not in paired]
            if free and k not in paired:
                pairs.append((k, free[0]))
        return pairs

    def _slopes(self, state: Any, goal: Any, command: Command, margins: Any) -> Any:
        """Slopes of the margins over the commands by difference quotients, (N, rows, commands).

        Steps go inwards, since margins beyond the range of a command are those of no flight.
        """
        ranges = self.world.craft.commands
        size = len(margins)
        number = len(ranges)
        again = stacked([where_true(truths(state, size) | True)] * number)
        shifted = [copied(x) for x in taken(tuple(command), again)]
        steps = []
        for k, command_range in enumerate(ranges):
            step = _STEP * (command_range.high - command_range.low)
            inwards = (
                where(command[k] > 0.5 * (command_range.low + command_range.high), -step, step)
                + command[k] * 0.0
            )
            part = slice(k * size, (k + 1) * size)
            shifted[k][part] = shifted[k][part] + inwards
            steps.append(inwards)
        shifted_margins = stacked_columns(
            self.margins(taken(state, again), taken(goal, again), tuple(shifted))
        )
        changes = [
            (shifted_margins[k * size : (k + 1) * size] - margins) / steps[k][:, None]
            for k in range(number)
        ]
        return stacked_columns(changes)


def slowest_change(world: World) -> float:
    """Velocity change by the weakest thruster in a control period, m/s."""
    force = min(thruster.force for thruster in world.craft.thrusters)
    return force * world.timing.control_period / world.craft.mass


def braking_command(world: World, state: Any, goal: Any) -> Command:
    """Command that brings the craft to rest relative to the goal without spin, within a period if possible.

    It counters the drift of that period, and leaves a slow motion away from the nearest boundary.

    A state is safe if this law, flown period after period, keeps every margin (`_Search.braking`).
    """
    craft = world.craft
    period = world.timing.control_period
    allocation = _Shares(craft)
    slope = slope_of_least(world, state, goal)
    slow = _RETREAT * slowest_change(world)
    retreat = slope.scale(slow / at_least(slope.norm(), 1e-9))
    _, drifted = world.task.drift_at(goal).carry(state.p, state.v, period)
    force = state.attitude.inverse().rotate((goal.v + retreat - drifted).scale(craft.mass / period))
    spin = state.spin()
    inertia = np.array(craft.inertia) if craft.dimension == 3 else np.array([[craft.inertia[2][2]]])
    torque = [
        sum((x * float(-entry / period) for x, entry in zip(spin, row, strict=True)), spin[0] * 0.0)
        for row in inertia
    ]
    wrench = (*force.columns(), *torque)
    results = []
    for command_range, row in zip(craft.commands, allocation.matrix, strict=False):
        opening = sum(
            (x * float(entry) for x, entry in zip(wrench, row, strict=True)), spin[0] * 0.0
        )
        opening = where(opening < command_range.low, opening * 0.0 + command_range.low, opening)
        results.append(
            where(opening > command_range.high, opening * 0.0 + command_range.high, opening)
        )
    zero = results[0] * 0.0
    return (*results, *(zero for _ in craft.wheels))


def _speed(state: Any, goal: Any) -> Field:
    return (state.v - goal.v).norm()


@dataclass(frozen=True)
class _Shares:
    """Distribution of a wrench among the thrusters of a craft."""

    craft: Spacecraft

    @property
    def matrix(self) -> np.ndarray:
        """Shares of full force per unit of the wrench, (thrusters, 3 or 6); negative shares mean zero.

        It is for thrusters in opposite pairs, of which the pseudo-inverse gives half to each with opposite signs.
        """
        return 2.0 * np.linalg.pinv(np.array(self.craft.wrench_map).T)


def check_throttles(craft: Spacecraft) -> None:
    """Reject a craft that the filter cannot brake.

    Raises:
        ConfigError: an engine is always lit, or thrusters are not in opposite pairs.
    """
    if any(command_range.low > 0.0 for command_range in craft.commands[craft.thruster_commands]):
        raise ConfigError(f"no safety filter can brake {craft.name}: its engines cannot be shut.")
    effects = craft.wrenches
    forces = effects[:, : craft.dimension]
    alone = [
        k
        for k, effect in enumerate(effects)
        if not np.isclose(effects, -effect, atol=1e-9).all(axis=1).any()
    ]
    if alone or np.linalg.matrix_rank(forces) < craft.dimension:
        raise ConfigError(
            f"the safety filter for throttles brakes with opposite pairs of thrusters in all directions, but "
            f"{craft.name} has none for thrusters {', '.join(map(str, alone)) or 'of some direction'}."
        )
