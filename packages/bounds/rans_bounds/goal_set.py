"""Goal sets of certified bounds, which tasks have one, and the unit of their impulses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rans.extend import (
    FREE,
    ON_OFF,
    REST_SPEED,
    REST_SPIN,
    ConfigError,
    PlanarState,
    Spacecraft,
    Task,
    around,
    example_state,
    is_constrained,
    wrap,
)
from rans.tasks.derived import goal_stands_still

_TRIED = 256
"""States tried for each tolerance: a direction that a task leaves free in space is near some of them."""


@dataclass(frozen=True)
class GoalSet:
    """Goal set: balls around the goal in which a controller must be at the end.

    Raises:
        ConfigError: a tolerance is negative or not finite.
    """

    position: float = 0.05
    """m."""
    velocity: float = 0.05
    """m/s."""
    heading: float = math.radians(5.0)
    """rad."""
    spin: float = 1e-9
    """rad/s; a start that spins may need more, see `rans_bounds.plane.lattice.Lattice.net_spins`."""

    def __post_init__(self) -> None:
        for key in ("position", "velocity", "heading", "spin"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(
                    f"goal set: {key} must be finite and not negative, got {value!r}."
                )

    def contains(self, state: PlanarState, goal: PlanarState) -> bool:
        """Whether a planar state of floats is in the set."""
        return bool(
            (goal.p - state.p).norm() <= self.position
            and (goal.v - state.v).norm() <= self.velocity
            and abs(wrap(state.attitude.angle - goal.attitude.angle)) <= self.heading
            and abs(state.w - goal.w) <= self.spin + 1e-9
        )


def pulse(craft: Spacecraft, period: float) -> float | None:
    """Unit of impulse in on/off periods, shared or not, N s; None where there is none.

    Thrusters differ in strength there, or may be open for a part of a period.
    """
    forces = np.array([thruster.force for thruster in craft.thrusters])
    equal = craft.actuators == ON_OFF and np.ptp(forces) <= 1e-12 * forces.max()
    return float(forces[0]) * period if equal else None


def goal_set(task: Task) -> GoalSet:
    """Goal set of a task: its tolerances, and rest if it has a tolerance for the position.

    Raises:
        ConfigError: the task has a drift, a moving goal, constraints or errors that leave a direction free, which
            the bounds do not include.
    """
    if task.drift != FREE or not goal_stands_still(task):
        has = "a goal that moves" if task.drift == FREE else task.drift.name
        raise ConfigError(
            f"bounds are for free flight to a goal that stands still; {type(task).__name__} has {has}."
        )
    if is_constrained(task):
        raise ConfigError(
            f"bounds are for motion without constraints, and {type(task).__name__} has some."
        )
    _check_distances(task)
    tolerances = task.tolerances()
    return GoalSet(
        tolerances.get("position", 0.0),
        tolerances.get("velocity", REST_SPEED),
        tolerances.get("attitude", 0.0),
        tolerances.get("spin", REST_SPIN),
    )


def _check_distances(task: Task) -> None:
    """Refuse a task that counts as reached what is beyond a tolerance, such as all places along a line.

    Bounds are for errors that are the whole distance to the goal, the whole angle of the rotation to it, or the
    whole relative velocity or spin.

    Raises:
        ConfigError: a state is reached, although one of these is larger than its tolerance.
    """
    for dimension in task.dimensions:
        start, goal = example_state(task, dimension)
        random = np.random.default_rng(0)
        turns = 1 if dimension == 2 else 3
        widths = {"position": dimension, "attitude": turns, "velocity": dimension, "spin": turns}
        for name, tolerance in task.tolerances().items():
            if name not in widths:
                continue
            # Away from the goal by a little or by much, any way; along each axis too, and nothing else changes.
            axes = widths[name]
            ways = random.normal(size=(axes, _TRIED))
            ways[:, : 2 * axes] = np.hstack([np.eye(axes), -np.eye(axes)])
            ways /= np.linalg.norm(ways, axis=0)
            sizes = tolerance * (1.01 + 10.0 ** random.uniform(-2.0, 2.0, _TRIED))
            if name == "attitude":
                # Half a turn is the largest angle.
                sizes = np.minimum(sizes, math.pi)
                if sizes.min() <= tolerance:
                    continue
            rows = [
                ways * sizes if key == name else np.zeros((width, _TRIED))
                for key, width in widths.items()
            ]
            state = replace(around(goal, np.vstack(rows)), stores=start.stores)
            if np.any(np.broadcast_to(task.reached(state, goal), _TRIED)):
                raise ConfigError(
                    f"bounds are for errors that are the whole distance to the goal; {type(task).__name__} counts "
                    f"as reached what is farther from its goal than its tolerance of {name}, {tolerance:g}."
                )
