"""Backup manoeuvres of a safety filter: direction of the thrust, and selection of thrusters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from rans.extend import (
    Command,
    ConfigError,
    Field,
    Spacecraft,
    Vec2,
    Vec3,
    Vector,
    World,
    at_least,
    where,
)

_OPEN = 0.5
"""Score above which a thruster opens: within 60 degrees of the direction. Among thrusters along the axes of a
craft, or in pairs across them, some are within 55 degrees of any direction."""
_DESPIN = 0.5
"""Score of a thruster whose pulse would stop the spin."""
_MOST_DESPIN = 0.75
"""Largest score for slowing the spin: a thruster against the direction never opens, one across it may."""
_STEP = 1e-2
"""Step of the difference quotients of margins, m."""
_RETREAT = 0.01
"""Speed out of the constraints with which braking ends, as a share of a period's velocity change."""


@dataclass(frozen=True)
class Manoeuvre:
    """Static feedback law: thrust in a direction of W while the spin is reduced.

    The direction is the sum of ``retreat`` times that in which the least margin grows, ``brake`` times that against
    the velocity relative to the goal, and ``towards``. Values are numbers, or fields (N,) where spacecraft fly
    different manoeuvres.
    """

    retreat: Field
    brake: Field
    towards: Vector

    def push(self, world: World, state: Any, goal: Any) -> Any:
        """Direction of the thrust in W, a unit vector."""
        slope = _unit(slope_of_least(world, state, goal))
        against = _unit(goal.v - state.v)
        return _unit(self.towards + slope.scale(self.retreat) + against.scale(self.brake))


def manoeuvres(world: World) -> tuple[Manoeuvre, ...]:
    """Manoeuvres in the order of trial: feedback laws, then thrust in fixed directions.

    Fixed directions are the four axes and four diagonals in the plane, and six axes and eight diagonals in space.
    """
    dimension = world.craft.dimension
    vector = Vec2 if dimension == 2 else Vec3
    nowhere: Any = vector(*(0.0,) * dimension)
    laws = [Manoeuvre(a, b, nowhere) for a, b in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))]
    signs = itertools.product((0.0, 1.0, -1.0), repeat=dimension)
    allowed = [sign for sign in signs if sum(map(abs, sign)) in (1, dimension)]
    pushes = [
        Manoeuvre(0.0, 0.0, vector(*(x / math.hypot(*sign) for x in sign))) for sign in allowed
    ]
    return (*laws, *pushes)


class Thrusters(NamedTuple):
    """Effects of M thrusters in B."""

    directions: np.ndarray
    """Unit vector of the force of each, (M, d)."""
    despins: np.ndarray
    """Factors of each from an angular velocity, rad/s, to the score for reducing it, (M, 1) or (M, 3)."""
    most: np.ndarray
    """Largest command of each, (M,)."""
    wheels: int
    """Number of reaction wheels, which have zero commands."""

    @classmethod
    def of(cls, world: World) -> Thrusters:
        """Effects of the thrusters of a world's craft, for pulses of its control period."""
        craft = world.craft
        effects = craft.wrenches
        forces = effects[:, : craft.dimension]
        torques = effects[:, craft.dimension :]
        inertia = np.array(craft.inertia)
        if craft.dimension == 2:
            turns = torques / inertia[2, 2]
        else:
            turns = torques @ np.linalg.inv(inertia).T
        turns = turns * world.timing.control_period
        squares = (turns * turns).sum(axis=1, keepdims=True)
        despins = np.where(squares > 1e-12, -_DESPIN * turns / np.maximum(squares, 1e-12), 0.0)
        lengths = np.maximum(np.linalg.norm(forces, axis=1, keepdims=True), 1e-12)
        return cls(
            forces / lengths,
            despins,
            np.array([allowed.high for allowed in craft.commands[craft.thruster_commands]]),
            craft.wheel_count,
        )

    def pushing(self, state: Any, push: Any) -> tuple[Field, ...]:
        """Command with thrust in a direction of W, a unit vector, that also reduces the spin.

        It is the largest command for each thruster that opens, and 0 for the others and for wheels. Fields (N,).
        """
        direction = np.stack(state.attitude.inverse().rotate(push).columns(), axis=-1)
        slower = np.stack(state.spin(), axis=-1) @ self.despins.T
        score = direction @ self.directions.T + np.clip(slower, -_MOST_DESPIN, _MOST_DESPIN)
        opened = np.moveaxis(np.where(score > _OPEN, self.most, 0.0), -1, 0)
        return (*opened, *(0.0 * opened[0] for _ in range(self.wheels)))


def slowest_change(world: World) -> float:
    """Velocity change by the weakest thruster in a control period, m/s."""
    force = min(thruster.force for thruster in world.craft.thrusters)
    return force * world.timing.control_period / world.craft.mass


def braking_command(world: World, state: Any, goal: Any) -> Command:
    """Command that brings the craft to rest relative to the goal without spin, within a period if possible.

    It counters the drift of that period, and leaves a slow motion away from the nearest boundary.

    A state is safe if this law, flown period after period, keeps every margin (`backup.FlownBackup`).
    """
    craft = world.craft
    period = world.timing.control_period
    # Of opposite thrusters the pseudo-inverse gives half to each with opposite signs; negative shares mean zero.
    shares = 2.0 * np.linalg.pinv(np.array(craft.wrench_map).T)
    slope = slope_of_least(world, state, goal)
    slow = _RETREAT * slowest_change(world)
    retreat = slope.scale(slow / at_least(slope.norm(), 1e-9))
    _, drifted = world.task.drift_at(goal).carry(state.p, state.v, period)
    force = state.attitude.inverse().rotate((goal.v + retreat - drifted).scale(craft.mass / period))
    inertia = np.array(craft.inertia) if craft.dimension == 3 else np.array([[craft.inertia[2][2]]])
    torque = np.stack(state.spin(), axis=-1) @ inertia.T / -period
    wrench = np.concatenate([np.stack(force.columns(), axis=-1), torque], axis=-1)
    openings = np.moveaxis(wrench @ shares.T, -1, 0)
    results = [
        np.clip(opening, allowed.low, allowed.high)
        for allowed, opening in zip(craft.commands, openings, strict=False)
    ]
    return (*results, *(0.0 * results[0] for _ in craft.wheels))


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


def slope_of_least(world: World, state: Any, goal: Any) -> Any:
    """Gradient of the least margin of a task's constraints over the position in W, up to a positive factor."""

    def least(p: Vector) -> Field:
        margins = world.task.constraints(replace(state, p=p), goal).values()
        return reduce(lambda a, b: where(b < a, b, a), margins)

    return type(state.p)(*(ahead - back for ahead, back in on_both_sides(state.p, _STEP, least)))


def on_both_sides(vector: Any, step: float, function: Callable[[Any], Any]) -> Iterator[Any]:
    """Along each axis a function's values a step ahead of a vector and a step back."""
    columns = vector.columns()
    for axis, x in enumerate(columns):
        ahead, back = (
            type(vector)(*columns[:axis], x + by, *columns[axis + 1 :]) for by in (step, -step)
        )
        yield function(ahead), function(back)


def _unit(v: Any) -> Any:
    return v.scale(1.0 / at_least(v.norm(), 1e-9))
