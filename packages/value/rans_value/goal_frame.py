"""Flights as seen from their goal: what a task asks of states relative to it, and the engine's step between them.

States are (rows, ...): position (m), attitude (heading, rad, or quaternion) and velocity (m/s) of the craft in the
frame of the goal, spin (rad/s; in space in B), in the plane relative to that of the goal, then the spin of the goal
if there are goals that turn, momenta of the wheels (N m s), and the trade-off between time and impulse, 0 to 1.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial, reduce
from operator import or_
from typing import Any

import torch
from torch import Tensor

from rans import scenarios
from rans.episode.step import Episode
from rans.extend import (
    ConfigError,
    Heading,
    PlanarState,
    Quat,
    Setup,
    Spacecraft,
    SpatialState,
    State,
    Task,
    Timing,
    Vec2,
    Vec3,
    World,
    leaves,
    map_leaves,
    step,
)

_NODES = 4
"""Nodes of the quadrature of translation, of which float32 needs four."""
_TRIED = 64
"""Goals on which is tried whether what a task asks depends on the state relative to the goal alone."""
_EQUAL = 1e-6
"""Largest difference of what is asked for it to be the same, of doubles in SI units."""


def parted(state: Tensor) -> tuple[Tensor, ...]:
    """Rows of position, attitude, velocity and spin of states (rows, ...), and the others."""
    sizes = (3, 4, 3, 3) if len(state) == 14 else (2, 1, 2, 1)
    return state.split((*sizes, len(state) - sum(sizes)))


def equivalent(state: Tensor, turn: Tensor, hand: Tensor) -> Tensor:
    """States (rows, N) as seen from other sides of a craft, see `rans.policy.symmetry.Symmetries`.

    Args:
        state: (rows, N), see `parted`.
        turn: (d, d) of one side for all, or (N, d, d): rotation or mirror of the frame in d dimensions.
        hand: () or (N,): 1 of a rotation, -1 of a mirror.
    """
    p, attitude, v, w, rest = parted(state)

    def seen(rows: Tensor) -> Tensor:
        axes = range(len(rows))
        turned: Any = [sum(turn[..., i, j] * rows[j] for j in axes) for i in axes]
        return torch.stack(turned)

    def axial(rows: Tensor) -> Tensor:
        return hand * (rows if len(rows) == 1 else seen(rows))

    # The axis of a rotation is seen as a spin.
    scalar, axis = attitude.split((len(attitude) - len(w), len(w)))
    return torch.cat((seen(p), scalar, axial(axis), seen(v), axial(w), hand * rest[:-1], rest[-1:]))


class GoalFrame:
    """What a task asks of a craft, as functions of states relative to the goal.

    Goals may turn in the plane at a constant rate, each at its own.

    Args:
        craft: spacecraft without stores.
        task: flight to a place, perhaps with an attitude, limits and an end.
        timing: control period, checks and length of a flight.

    Raises:
        ConfigError: what the task asks depends on more than the state relative to the goal.
    """

    def __init__(self, craft: Spacecraft, task: Task, timing: Timing) -> None:
        self.task = task
        self._world = World(Setup(craft, task, timing), _NODES)
        self.tolerances = task.tolerances()
        if "position" not in self.tolerances or not hasattr(task, "spawn_distance"):
            raise _refused(task, "it has no place that is reached from a spawn_distance")
        drawn = scenarios(task, craft, 0, _TRIED)
        number = partial(torch.as_tensor, dtype=torch.float64)
        goals: Any = map_leaves(lambda x: number(x).expand(_TRIED), drawn.goal)
        # All goals are seen as one of them: from axes in which it has no heading, its place is this.
        aim: Any = map_leaves(lambda x: float(x[0]), goals)
        self._goal: Any = aim
        # Numbers of Python, as torch's compiler begins anew once it has traced a gradient with those of NumPy.
        self._place = tuple(map(float, aim.attitude.inverse().rotate(aim.p).columns()))
        self.turns = craft.dimension == 2 and bool(goals.w.any())
        """Whether there are goals that turn."""
        self._lever = (0.0, 0.0)
        if self.turns:
            fastest = int(goals.w.abs().argmax())
            lever = goals.attitude.inverse().rotate(goals.v).scale(1.0 / goals.w)
            self._lever = tuple(float(x[fastest]) for x in lever.columns())
        self.ends_well = task.done(aim, aim) is not None
        """Whether the task has a success that ends the flight."""
        begun = self._world.begin(drawn.start, drawn.goal, 0)
        self._probes = self._tried(begun.state, goals)

    def _tried(self, starts: State, goals: State) -> Tensor:
        """States (rows, N) on which the task was tried; it is refused where seen from its goal it differs."""
        random = torch.Generator().manual_seed(0)
        states = self.relative(starts, goals, torch.zeros((), dtype=torch.float64))
        # From the start to the goal and beyond, moving.
        p, attitude, v, w, rest = parted(states)
        nearer = torch.rand(p.shape, generator=random, dtype=p.dtype)
        moving = [0.2 * torch.randn(x.shape, generator=random, dtype=p.dtype) for x in (v, w)]
        states = torch.cat((p * nearer, attitude, *moving, rest))
        craft = self._world.craft
        command = torch.ones(craft.command_count, _TRIED, dtype=p.dtype).tril().unbind()
        if not _same(_notes(self._goal), _notes(goals)):
            raise _refused(self.task, "its goals note what differs from flight to flight")
        for _ in range(2):
            there = self._judged(states, goals)
            after, ends, later = self._stepped(states, goals, command)
            here = self._judged(states, self.goal(states))
            alike, alike_ends, _ = self._stepped(states, self.goal(states), command)
            if not (_same(there, here) and _same(after, alike) and _same(ends, alike_ends)):
                raise _refused(self.task, "its goals move, or it depends on where they are")
            if not _same(_notes(goals), _notes(later)):
                raise _refused(self.task, "its goals change in flight")
            states, goals = after, later
        return states

    def goal(self, state: Tensor) -> Any:
        """The goal of states (rows, ...), in the frame in which it has no heading."""
        # Fields, as torch cannot compile cosines of numbers.
        zero = 0.0 * state[-1]
        place = [x + zero for x in self._place]
        if len(place) == 3:
            facing = Quat(1.0 + zero, zero, zero, zero)
            still = Vec3(zero, zero, zero)
            return replace(self._goal, p=Vec3(*place), attitude=facing, v=still, w=still)
        spin = parted(state)[-1][0] if self.turns else zero
        speed = Vec2(*(x * spin for x in self._lever))
        return replace(self._goal, p=Vec2(*place), attitude=Heading(zero), v=speed, w=spin)

    def relative(self, state: State, goal: State, like: Tensor, trade_off: float = 0.0) -> Tensor:
        """States (rows, N) of N spacecraft with stores in the frame of their goals, in a tensor's dtype and device.

        The trade-off counts where the goals note none.
        """
        number = partial(torch.as_tensor, dtype=like.dtype, device=like.device)
        now: Any = map_leaves(number, state)
        aim: Any = map_leaves(number, goal)
        noted = number(getattr(goal.notes, "trade_off", trade_off))
        return _rows(now, aim, *([aim.w] if self.turns else []), noted)

    def step(self, state: Tensor, command: Any) -> tuple[Tensor, Tensor, Tensor]:
        """States after a control period with these commands of the thrusters, and whether it was won or lost."""
        after, (won, lost), _ = self._stepped(state, self.goal(state), command)
        return after, won, lost

    def _stepped(self, state: Tensor, goal: Any, command: Any) -> tuple[Tensor, Tensor, Any]:
        rest = parted(state)[-1].unbind()
        begun = Episode(replace(_placed(state, goal), stores=rest[self.turns : -1]), goal)
        outcome = step(self._world, begun, tuple(command), rewarded=False)
        lost = reduce(or_, (x < 0.0 for x in outcome.margins.values()), outcome.failed)
        won = lost & ~lost if outcome.done is None else outcome.done & ~lost
        later = outcome.episode.goal
        after = _rows(outcome.episode.state, later, *rest[: self.turns], rest[-1])
        return after, torch.stack((won, lost)), later

    def is_over(self, state: Tensor) -> Tensor:
        """Whether flights are over in states (rows, ...): won, failed, or a limit is broken."""
        goal = self.goal(state)
        now = _placed(state, goal)
        over = reduce(or_, (x < 0.0 for x in self.margins(state)), self.task.failed(now, goal))
        done = self.task.done(now, goal)
        return over if done is None else over | done

    def margins(self, state: Tensor) -> list[Tensor]:
        """Margins of the limits, which must not become negative."""
        goal = self.goal(state)
        return [*self.task.constraints(_placed(state, goal), goal).values()]

    def errors(self, state: Tensor) -> list[Tensor]:
        """Errors over their tolerances, in the order of these."""
        goal = self.goal(state)
        errors = self.task.errors(_placed(state, goal), goal)
        return [errors[name] / tolerance for name, tolerance in self.tolerances.items()]

    def is_symmetric(self, turn: Tensor, hand: Tensor) -> bool:
        """Whether the task asks the same of states as seen from another side of the craft."""
        other = equivalent(self._probes, turn.double(), hand.double())
        asked, other_asked = (self._judged(x, self.goal(x)) for x in (self._probes, other))
        return _same(asked, other_asked)

    def serves(self, task: GoalFrame) -> bool:
        """Whether flights of another task are of this kind, to the same tolerances or a finer one of position."""
        mine, theirs = dict(self.tolerances), dict(task.tolerances)
        position, finer = mine.pop("position"), theirs.pop("position")
        fits = finer == position if self.ends_well else finer <= position
        shape = self._probes.shape == task._probes.shape
        if not (fits and shape and mine == theirs):
            return False
        asked, other = (x._judged(self._probes, x.goal(self._probes)) for x in (self, task))
        return _same(asked, other)

    def _judged(self, state: Tensor, goal: Any) -> Tensor:
        """What the task asks of states and goals: errors, margins, failure and success, (rows, N)."""
        now = _placed(state, goal)
        task = self.task
        done = task.done(now, goal)
        asked = [*task.errors(now, goal).values(), *task.constraints(now, goal).values()]
        asked += [task.failed(now, goal)] + ([] if done is None else [done])
        return torch.stack([x.to(state.dtype) for x in torch.broadcast_tensors(*asked)])


def _rows(now: Any, aim: Any, *rest: Tensor) -> Tensor:
    """States (rows, ...) of a craft in the frame of a goal, with the rows that stay: the last is the trade-off."""
    back = aim.attitude.inverse()
    rows = (
        *back.rotate(now.p - aim.p).columns(),
        *leaves(aim.attitude.to(now.attitude).normalised()),
        *back.rotate(now.v - aim.v).columns(),
        *((now.w - aim.w,) if isinstance(now, PlanarState) else now.spin()),
        *rest[:-1],
        *now.stores,
        rest[-1],
    )
    return torch.stack(torch.broadcast_tensors(*rows))


def _placed(state: Tensor, goal: Any) -> Any:
    """State in W of a craft that is so relative to a goal."""
    p, attitude, v, w, _ = parted(state)
    facing = goal.attitude
    if len(w) == 1:
        heading = Heading(facing.angle + attitude[0])
        place = goal.p + facing.rotate(Vec2(*p))
        return PlanarState(place, heading, goal.v + facing.rotate(Vec2(*v)), goal.w + w[0])
    place = goal.p + facing.rotate(Vec3(*p))
    turned = facing.times(Quat(*attitude))
    return SpatialState(place, turned, goal.v + facing.rotate(Vec3(*v)), Vec3(*w))


def _notes(goal: Any) -> Tensor:
    """What goals note beside a trade-off, (fields, N)."""
    notes = goal.notes
    if hasattr(notes, "trade_off"):
        notes = replace(notes, trade_off=0.0)
    fields = [torch.as_tensor(x, dtype=torch.float64).expand(_TRIED) for x in leaves(notes)]
    return torch.stack(fields) if fields else torch.zeros(0)


def _same(one: Tensor, other: Tensor) -> bool:
    return one.shape == other.shape and torch.allclose(one.double(), other.double(), 0.0, _EQUAL)


def _refused(task: Task, why: str) -> ConfigError:
    return ConfigError(
        "value functions are of flights whose errors and limits depend on the state relative to the goal alone, "
        f"and {type(task).__name__} is no such flight: {why}. Take another algorithm or controller."
    )
