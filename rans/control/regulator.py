"""Parts that the controllers without training share: gains, prices of deviations, dead bands, goals ahead.

States are fields (N,), gains act on errors in W (m, m/s) and B (rad, rad/s); missions' guidance uses them too.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.base.errors import ConfigError, RansWarning, checked
from rans.control.allocation import Allocation, check_aims, inertia
from rans.control.arguments import craft_and_task
from rans.control.linear_motion import LinearMotion
from rans.control.wheel_torques import WheelTorques
from rans.episode.scenario import scenarios
from rans.model.body import Body
from rans.model.drift import steady
from rans.model.dynamics import advance, wrench
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks import Task
from rans.tasks.derived import is_constrained
from rans.tasks.settings import check_settings


@dataclass(frozen=True)
class Weights:
    """Deviations that cost as much as full thrust (Bryson and Ho, "Applied Optimal Control", 1975).

    Larger ones save thrust and take longer. Where a position is held, the speed that costs as much
    follows from the deviation s and the acceleration a at full thrust: sqrt(a s). On its way in from
    far away an LQR then keeps to speeds that it can brake from as long as it starts within 6 s:
    see `Gains`. The same holds for the attitude.

    Raises:
        ConfigError: a deviation is not a finite number > 0.
    """

    position: float = 0.6
    """m; a sixth of 3.6 m. In tasks whose starts are farther away it grows in proportion: see `distance_scale`."""
    attitude: float = math.radians(30.0)
    """rad; a sixth of half a turn."""
    velocity: float = 0.02
    """m/s, where no position is held; half of what one pulse of a 1 N nozzle changes."""
    spin: float = 0.1
    """rad/s, where no attitude is held; a third of what one pulse of a 1 N nozzle changes."""

    tunable: ClassVar = {
        "weights.position": (0.1, 3.0),
        "weights.attitude": (0.1, 3.0),
        "weights.velocity": (0.003, 0.3),
        "weights.spin": (0.01, 1.0),
    }
    """Bounds for `rans tune`."""

    def __post_init__(self) -> None:
        check_settings(self)


_NEAR = 3.6
"""Distance of starts for which the default weight of positions is meant, m."""
_STARTS = 64
"""Starts whose distance is asked."""


def distance_scale(task: Task, craft: Spacecraft) -> float:
    """How many times farther the starts of a task's episodes are than 3.6 m (median), at least 1.

    Deviations that cost as much as full thrust are in proportion to those that a task begins with, as Bryson's rule
    has it: with 0.6 m, craft that start 250 m away accelerate at full thrust until they must brake.

    The starts are always those of seed 0: other ones change gains, and with them every figure of the LQR.
    """
    starts = scenarios(task.for_evaluation(), craft, seed=0, count=_STARTS)
    offset = starts.start.p - starts.goal.p
    return max(1.0, float(np.median(offset.norm())) / _NEAR)


@dataclass(frozen=True)
class Deadband:
    """When to leave all thrusters shut: while coasting keeps every error well within its tolerance.

    On/off thrusters reach a lattice of velocities only, and a regulator that wants exactly zero
    chatters between its neighbours. Resting saves the LQR on the floating platform 46 % and on the free
    flyer 41 % of the thrust of 25 s of go-to-pose; all of 50 starts settle as soon as without it, and the
    mean position error grows from 0.4 and 0.5 to 2.5 and 2.8 cm (tolerance: 5 cm).

    Raises:
        ConfigError: a value is negative or not finite.
    """

    share: float = 0.8
    """Part of every tolerance that may be used; 0 never rests."""
    look_ahead: float = 0.8
    """How long coasting must stay inside, s."""
    spin: float = 0.1
    """Highest spin to rest at, rad/s, where the task has no tolerance for it."""

    tunable: ClassVar = {
        "deadband.share": (0.4, 0.98),
        "deadband.look_ahead": (0.2, 2.0),
        "deadband.spin": (0.02, 0.3),
    }
    """Bounds for `rans tune`."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(f"deadband: {field.name} must be finite and >= 0, got {value!r}.")

    def holds(
        self,
        craft: Spacecraft,
        task: Task,
        state: Any,
        goal: Any,
        period: float = 0.0,
    ) -> np.ndarray:
        """Which episodes may rest, (N,) bool, of a state and a goal of float64 arrays (N,).

        The craft coasts as the task's drift says, and its goal moves. Coasts last a control period (s) at
        least. Where no thruster turns the craft, a spin that the task does not ask for is no reason not to rest.
        """
        shut = wrench(craft, (0.0,) * craft.thruster_count)
        body = Body.of(craft)
        look_ahead = max(self.look_ahead, period)
        instants = [(state, goal)]
        for time in (0.5 * look_ahead, look_ahead):
            coasted = advance(state, shut, body, time, drift=task.drift)
            instants.append((coasted, task.later(goal, time)))
        bounds = {name: self.share * bound for name, bound in task.tolerances().items()}
        ignored = frozenset() if craft.can_turn else {"spin", "attitude"}
        inside = [
            error < bounds.get(name, self.spin)
            for state_then, aim in instants
            for name, error in task.errors(state_then, aim).items()
            if name not in ignored
        ]
        return np.logical_and.reduce(inside)


def holding(motion: LinearMotion, held: bool, state: Any, goal: Any, later: Any) -> np.ndarray:
    """Acceleration in W, (d, N) m/s^2, that keeps craft at their goals for the time of a motion. d is 2 or 3.

    Args:
        motion: of free points.
        held: whether the task has a place to stay at; otherwise craft move as their goals do where they are.
        state: of the craft.
        goal: now.
        later: the goal after that time.
    """
    reference = goal if held else state
    size = np.shape(state.p.columns()[0])
    return motion.holding(
        *(
            np.array([np.broadcast_to(x, size) for x in vector.columns()])
            for vector in (reference.p, goal.v, later.v)
        )
    )


def mass_share(craft: Spacecraft, state: Any) -> Any:
    """Mass of a craft over that with a full tank, (N,), 1 if it has no propellant; controllers scale inertia by it.

    Where a tank has a place, that and a centre of mass that stays are approximations.
    """
    if craft.propellant is None:
        return 1.0
    return 1.0 - (craft.propellant.mass - np.asarray(state.stores[0])) / craft.mass


class ModelBased:
    """A controller that knows the equations of what it flies, and is told the state: base of the simple ones.

    Spacecraft and task are given by name, TOML file or as such; without a timing, the task's own serves.

    Raises:
        ConfigError: there is no such spacecraft or task, or the task asks a craft to turn that cannot.
    """

    name: str
    observes: ClassVar[bool] = False
    """Whether it reads observations (`rans.episode.flight.Controller`); a subclass that does says so."""

    heeds_constraints: ClassVar[bool] = False
    """Whether it keeps the margins of a task's constraints from being negative; others warn that they do not."""

    follows_orbits: ClassVar[bool] = False
    """Whether it flies in drifts that change along an orbit (`rans.model.drift.Drift.steady`)."""

    needs_thrusters: ClassVar[bool] = False
    """Whether it flies only craft that have a thruster."""

    def __init__(
        self, craft: str | Path | Spacecraft, task: str | Task, timing: Timing | None = None
    ) -> None:
        self._craft, self._task = craft_and_task(craft, task)
        self._timing = self._task.timing if timing is None else checked("timing", timing, Timing)
        check_aims(self._craft, self._task)
        if self.needs_thrusters and not self._craft.thrusters:
            raise ConfigError(
                f"{self.name} flies craft with thrusters, and {self._craft.name!r} has reaction wheels alone: the "
                "LQR flies these."
            )
        if not self.follows_orbits:
            steady(self._task.drift, f"{self.name} computes once")
        if is_constrained(self._task) and not self.heeds_constraints:
            warnings.warn(
                f"{self.name} does not know the constraints of {type(self._task).__name__} and may violate "
                "them; MPC keeps them.",
                RansWarning,
                stacklevel=3,
            )
        self._prepare()

    def _prepare(self) -> None:
        """Compute what depends on spacecraft, task and timing alone."""

    def __repr__(self) -> str:
        return f"<{self.name}: {type(self._task).__name__} for {self._craft.name}>"

    @property
    def craft(self) -> Spacecraft:
        """Spacecraft whose equations the controller knows."""
        return self._craft


@dataclass(frozen=True)
class Gains:
    """The discrete-time LQR of d axes: of their deviations, then of their rates.

    With deviation s and acceleration a the gain of an axis that moves alone tends to k = a / s and d = sqrt(3 k)
    for short periods: a damping ratio of 0.87. From a distance e the approach is then at most k e / d fast, and
    braking takes (k e / d)^2 / (2 a) = e^2 / (6 s): less than e as long as e < 6 s.
    """

    price: np.ndarray
    """(2,) of a deviation and a rate squared, along every axis; that of a deviation that is not held is 0."""
    cost_to_go: np.ndarray
    """(2 d, 2 d)"""
    gain: np.ndarray
    """(d, 2 d) accelerations of deviations and rates, which they bring to zero."""

    @classmethod
    def of(
        cls, motion: LinearMotion, acceleration: float, rate: float, deviation: float | None
    ) -> Gains:
        """Solve the Riccati equation of a motion in a control period.

        Args:
            motion: of all axes together, which a drift may couple.
            acceleration: at full thrust, which costs 1.
            rate: that costs as much where no deviation is held.
            deviation: that costs as much; None: none is held, and rates are brought to zero anywhere.
        """
        from scipy.linalg import solve_discrete_are

        price = np.array([0.0, 1.0 / rate**2])
        if deviation is not None:
            price = np.array([1.0 / deviation**2, 1.0 / (acceleration * deviation)])
        count = motion.effect.shape[1]
        priced = slice(count if deviation is None else 0, 2 * count)
        matrix = motion.matrix[priced, priced]
        effect = motion.effect[priced]
        effort = np.eye(count) / acceleration**2
        p = solve_discrete_are(matrix, effect, np.diag(np.repeat(price, count)[priced]), effort)
        cost_to_go = np.zeros((2 * count, 2 * count))
        cost_to_go[priced, priced] = p
        gain = np.zeros((count, 2 * count))
        gain[:, priced] = np.linalg.solve(effort + effect.T @ p @ effect, effect.T @ p @ matrix)
        return cls(price, cost_to_go, gain)

    @classmethod
    def none(cls, count: int) -> Gains:
        """Gains of axes that nothing can move: deviations cost nothing and have no effect."""
        return cls(np.zeros(2), np.zeros((2 * count, 2 * count)), np.zeros((count, 2 * count)))

    def acceleration(self, deviations: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """(d, N) along the axes, against deviations and rates of (d, N)."""
        return -self.gain @ np.vstack([deviations, rates])


@dataclass(frozen=True)
class Regulator:
    """Gains of a spacecraft's translation, in W, and of its rotation, in B, for one task."""

    translation: Gains
    rotation: Gains
    motion: LinearMotion
    """Motion of a free point in a control period."""

    @classmethod
    def of(cls, craft: Spacecraft, task: Task, timing: Timing, weights: Weights) -> Regulator:
        """Holds the position and the attitude where the task has a tolerance for them.

        Translation is that of the task's drift, and has no gains where there is no thruster. Rotation has none
        where nothing turns the craft.

        Raises:
            ConfigError: the thrusters cannot push and turn the spacecraft in every direction.
        """
        checked("weights", weights, Weights)
        held = task.tolerances()
        period = timing.control_period
        if craft.thrusters:
            push, turn = Allocation(craft).accelerations()
        else:
            push, turn = 0.0, WheelTorques(craft, period).acceleration(inertia(craft))
        motion = LinearMotion.of(task.drift, craft.dimension, period)
        translation = Gains.none(craft.dimension)
        if push > 0.0:
            far = weights.position * distance_scale(task, craft) if "position" in held else None
            translation = Gains.of(motion, push, weights.velocity, far)
        angles = craft.degrees_of_freedom - craft.dimension
        rotation = Gains.none(angles)
        if craft.can_turn:
            free = LinearMotion.free(angles, period)
            angle = weights.attitude if "attitude" in held else None
            rotation = Gains.of(free, turn, weights.spin, angle)
        return cls(translation, rotation, motion)

    def holding(self, state: Any, goal: Any, later: Any) -> np.ndarray:
        """Acceleration in W, (d, N) m/s^2, that keeps craft at their goals for one period, see `holding`."""
        return holding(self.motion, self.translation.price[0] > 0, state, goal, later)

    def carried(self, craft: Spacecraft) -> np.ndarray:
        """Components of a wrench along which `Rounding` must carry what is owed.

        A small thrust that holds a deviation has to add up to a pulse in time. A velocity adds up by itself
        what was not given: carried on as well, it would be given twice. With it the LQR tracks velocities
        with the free flyer from 46 of 50 starts and spends 17 N s, without it from all 50 and 3.3 N s.
        """
        stiff = [axis.price[0] > 0 for axis in (self.translation, self.rotation)]
        return np.repeat(stiff, [craft.dimension, craft.degrees_of_freedom - craft.dimension])
