"""Guidance for landing without learning: the convex optimum of what is left, solved again and again."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError
from rans.model.fields import Quat, Vec3, leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.convex.landing import Descent, Lander, Landing, best_landing, landing
from rans.tasks import load_task
from rans.tasks.base import Task
from rans.tasks.land import Land

_KNOTS = 30
"""Accelerations of a plan; the first of a minute's plan is held for 2 s."""
_LAST = 4.0
"""Time to go, s, from which on no plan is made: a linear law flies what is left."""
_STEADY = 1.5
"""Least time to go in that law, s: then it is a spring of 1.6 rad/s with a damping ratio of 0.8."""
_OFTEN = 10.0
"""Time to go, s, from which on every control period has a plan of its own, instead of every second one."""
_RESERVE = 0.15
"""Share of the range between least and largest thrust that plans leave at either end, for what they do not know."""
_TILT = math.radians(4.0)
"""By which plans stay away from the tilt limit, rad, for a craft that does not turn at once."""
_LATER = (1.0, 1.06, 1.15, 1.3, 1.6)
"""Times to go, over the one that was planned, that are tried where that one has become too short."""
_HEIGHT = 0.5
"""Height above the site that plans end at, m."""
_SHARE = 0.5
"""Of the tolerances that plans use."""
_STIFFNESS = 1.3
"""Of the attitude control, 1/s: natural frequency of the axis that follows the plan, damped critically."""


@dataclass
class _Plan:
    """What one craft is flying."""

    landing: Landing
    age: float = 0.0
    """Since it was made, s."""

    @property
    def left(self) -> float:
        """Time to go, s."""
        return self.landing.time - self.age

    def acceleration(self, ahead: float = 0.0) -> np.ndarray:
        """By thrust, (3,) m/s^2, so much later than now, s."""
        held = int((self.age + ahead) / self.landing.period)
        return self.landing.acceleration[min(held, len(self.landing.acceleration) - 1)]


class ConvexDescent:
    """Lands by model predictive control: the landing with the least propellant from where the craft is.

    >>> rans.ConvexDescent("mars-lander-steered", "land")
    <convex-descent: Land for mars-lander-steered>

    Every second control period, and every one near the ground, it solves the relaxed landing problem
    (`rans.optimal.convex.landing`) for the time that is left, now and then for a little less and more. Engines
    are throttled alike; reaction wheels turn the thrust's axis to the plan's. A solution takes some 40 ms.

    Args:
        craft: by name, TOML file or as such: a lander (`rans.optimal.convex.landing.Lander`) with three wheels
            along its axes.
        task: by name or as such; it must be a `rans.Land`.
        timing: control period; None: the task's.

    Raises:
        ConfigError: the craft is no lander, has no three wheels, or the task is another.
    """

    name = "convex-descent"
    slow = True
    """Comparisons fly it from fewer starts."""

    def __init__(
        self, craft: str | Path | Spacecraft, task: str | Task, timing: Timing | None = None
    ) -> None:
        self.craft = load_spacecraft(craft)
        task = load_task(task)
        if not isinstance(task, Land):
            raise ConfigError(f"convex-descent flies land alone, got {type(task).__name__}.")
        self.task = task
        true = self._true = Lander.of(self.craft)
        reserve = _RESERVE * (true.largest_thrust - true.least_thrust)
        self.lander = replace(
            true,
            least_thrust=true.least_thrust + reserve,
            largest_thrust=true.largest_thrust - reserve,
        )
        self._full = true.largest_thrust / self.craft.actuators.high
        axes = [wheel.axis for wheel in self.craft.wheels]
        if axes != [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]:
            raise ConfigError(
                f"convex-descent turns a craft by three wheels along x, y and z of B; {self.craft.name!r} has "
                f"wheels along {axes or 'none'}."
            )
        self.period = (timing or task.timing).control_period
        self.failures = 0
        """Solutions that were not found, so that the craft flew on as planned before."""
        self._descent = Descent(
            gravity=task.gravity,
            glide_slope=task.glide_slope,
            margin=task.position_tolerance,
            tilt=task.tilt_limit - _TILT,
            position_tolerance=_SHARE * task.position_tolerance,
            velocity_tolerance=_SHARE * task.velocity_tolerance,
        )
        self._limits = replace(self._descent, tilt=task.tilt_limit - 0.3 * _TILT)
        self._plans: list[_Plan | None] = []
        self._flown = 0

    def __repr__(self) -> str:
        return f"<{self.name}: {type(self.task).__name__} for {self.craft.name}>"

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._plans = [None] * count
        self._flown = 0
        self.failures = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state, not at the observation."""
        count = len(self._plans)
        wanted = np.zeros((count, 3))
        ahead = np.zeros((count, 3))
        for k in range(count):
            one = map_leaves(lambda x, k=k: float(np.broadcast_to(x, count)[k]), state)
            site = map_leaves(lambda x, k=k: float(np.broadcast_to(x, count)[k]), goal)
            plan = self._plan(k, one, site)
            if plan is None:
                wanted[k] = ahead[k] = (0.0, 0.0, self.task.gravity)
                continue
            if plan.left < _LAST:
                wanted[k] = ahead[k] = self._last(one, site, plan.left)
            else:
                wanted[k] = plan.acceleration(0.5 * self.period)
                ahead[k] = plan.acceleration(self.period)
            plan.age += self.period
        self._flown += 1
        return self._commands(state, wanted, ahead)

    def _plan(self, number: int, state: Any, goal: Any) -> _Plan | None:
        """What this craft flies now, solved anew where it is time to."""
        old = self._plans[number]
        if old is not None and (old.left < _LAST or (self._flown % 2 != 0 and old.left > _OFTEN)):
            return old
        p = np.array(leaves(state.p)) - np.array(leaves(goal.p)) - (0.0, 0.0, _HEIGHT)
        start = p, np.array(leaves(state.v)) - np.array(leaves(goal.v))
        left = float(state.stores[0])
        if not (np.isfinite(p).all() and left > 0.0):
            return old
        if old is None:
            found = best_landing(self.lander, self._descent, start, 2.0, propellant=left)
        else:
            step = 0.03 * old.left
            near = (old.left,) if self._flown % 4 else (old.left, old.left - step, old.left + step)
            found = self._best_of(self.lander, self._descent, start, left, near)
            if found is None:
                # The reserve is for such moments.
                more = tuple(old.left * later for later in _LATER)
                found = self._best_of(self._true, self._limits, start, left, more)
        if found is None:
            self.failures += 1
            return old
        self._plans[number] = _Plan(found)
        return self._plans[number]

    def _best_of(
        self,
        lander: Lander,
        descent: Descent,
        start: tuple[np.ndarray, np.ndarray],
        left: float,
        times: tuple[float, ...],
    ) -> Landing | None:
        """Landing with the least propellant of those in these times, s; None: there is none."""
        found = [
            landing(lander, descent, start, time, time / _KNOTS, "tangent", left)
            for time in times
            if time > 0.0
        ]
        possible = [one for one in found if one is not None]
        return min(possible, key=lambda one: one.propellant) if possible else None

    def _last(self, state: Any, goal: Any, left: float) -> np.ndarray:
        """Acceleration by thrust, (3,) m/s^2, that changes linearly and stops at the site in the time left (s).

        It is 6 way / t^2 - 4 v / t against the weight, as Apollo's (A. R. Klumpp, "Apollo lunar descent guidance",
        Automatica 10, 1974), within the tilt limit.
        """
        time = max(left, _STEADY)
        way = np.array(leaves(goal.p)) - np.array(leaves(state.p)) + (0.0, 0.0, _HEIGHT)
        speed = np.array(leaves(state.v)) - np.array(leaves(goal.v))
        wanted = 6.0 * way / time**2 - 4.0 * speed / time + (0.0, 0.0, self.task.gravity)
        wanted[2] = max(wanted[2], 0.3 * self.task.gravity)
        most = math.tan(self._limits.tilt) * wanted[2]
        wanted[:2] *= min(1.0, most / max(float(np.hypot(*wanted[:2])), 1e-9))
        return wanted

    def _commands(self, state: Any, wanted: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """Throttles and torques, (N, commands), for accelerations (N, 3) now and a period later, m/s^2."""
        mass = self.lander.mass - self.lander.propellant + state.stores[0]
        attitude: Quat = state.attitude
        # The thrust along the craft's axis whose part along the wanted one is what is wanted.
        axis = np.array(leaves(attitude.rotate(Vec3(0.0, 0.0, 1.0))))
        size = np.linalg.norm(wanted, axis=1)
        aligned = np.maximum((axis.T * wanted).sum(axis=1) / size, 0.5)
        throttle = mass * size / (self._full * aligned)
        least, most = self.craft.actuators.low, self.craft.actuators.high
        throttles = np.clip(np.tile(throttle[:, None], len(self.craft.thrusters)), least, most)
        # Torques that turn the axis to the wanted one: their error is the cross product of both, in B.
        direction = (ahead / np.linalg.norm(ahead, axis=1, keepdims=True)).T
        seen = attitude.conjugate().rotate(Vec3(*direction))
        error = np.array([-seen.y, seen.x, 0.0 * seen.x])
        spin = np.array(leaves(state.w))
        turn = _STIFFNESS**2 * error - 2.0 * _STIFFNESS * spin
        inertia = (
            np.array(self.craft.inertia)[range(3), range(3)][:, None] * mass / self.lander.mass
        )
        strongest = np.array([wheel.max_torque for wheel in self.craft.wheels])[:, None]
        torques = np.clip(-inertia * turn / strongest, -1.0, 1.0)
        return np.hstack([throttles, torques.T])
