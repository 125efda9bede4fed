"""Guidance for powered descent: plan the landing of least propellant, follow it, plan again when off it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.planning import PlanningGuidance
from rans.optimal.convex.landing import Descent, Lander, best_landing, landing
from rans.optimal.trajectory.steered_landing import (
    SteeredLanding,
    SteeredLandings,
    angular_velocity,
    direction_of,
    tilt_of,
    tilt_rate,
)
from rans.tasks.base import Task
from rans.tasks.land import Land

_TURNING = 0.9
"""Share of the torques that plans use: the rest follows them."""
_UPRIGHT = math.radians(0.4)
"""Reserve of plans below the tilt limit, rad, because plans treat turns about two axes as independent."""
_ARRIVAL = 0.5
"""Share of the tolerances within which plans end."""
_OFF = 0.4
"""Share of the tolerances by which the end of a plan may be missed before the landing is planned again."""
_ASTRAY = np.array([5.0] * 3 + [1.0] * 3 + [0.04] * 2 + [0.08] * 2)
"""Deviations from a plan that linear corrections may take beyond the limits: m, m/s, rad, rad/s."""
_PAUSE = 4
"""Periods until planning is tried again where it failed."""
_LAST = 12
"""Periods before its end in which a plan is not made anew: what is missed then, nothing can catch up with."""
_LONGER = (3, 5, 9, 15)
"""Periods by which a craft that turns takes longer than the convex optimum, tried one after the other."""
_AGAIN = (0, 1, 3, 6, 10)
"""Periods by which a plan that is made anew is longer than what was left of the old one."""


class LandingGuidance(PlanningGuidance["_Followed"]):
    """Flies the landing of least propellant of a craft that has to turn, planned once and followed.

    >>> rans.LandingGuidance("mars-lander-steered", "land")
    <landing: Land for mars-lander-steered>

    At first, the convex optimum of a craft that turns at once (`rans.optimal.convex.landing`) becomes the guess of
    the landing of one that does not (`rans.optimal.trajectory.steered_landing`). The plan's thrust and turning are
    given, corrected by a time-varying LQR for deviations in position, velocity, tilt and its rate. Where these are
    large, or the corrected flight would still miss the site, the plan is made anew from the state as it is, until
    6 s before its end. A perfect world needs one plan, which takes about a second of a core. Where no landing is
    found, the craft brakes upright.

    Args:
        craft: by name, TOML file or as such; engines that push along z of B together, and reaction wheels that turn
            it about every axis.
        task: an `rans.tasks.land.Land`, or its name.
        timing: control period, and length of the episode.
        reserve: share of the largest thrust that plans leave, so that errors can be corrected.

    Raises:
        ConfigError: the task is no landing, the craft is no lander or no wheels turn it, or the reserve is not at
            least 0 and below 0.5.
    """

    name = "landing"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        reserve: float = 0.003,
    ) -> None:
        super().__init__(craft, task, timing, reserve)
        mission = Land.expected(self._task, "landing guidance flies descents")
        lander = Lander.of(self._craft)
        self._full_thrust = lander.largest_thrust / self._craft.actuators.high
        self._full_mass = lander.mass
        self._inertia = np.array(self._craft.inertia)
        axes = np.array([wheel.axis for wheel in self._craft.wheels]).reshape(-1, 3)
        if np.linalg.matrix_rank(axes) < 3:
            raise ConfigError(
                f"landing guidance turns a craft by reaction wheels about every axis, and those of "
                f"{self._craft.name!r} do not."
            )
        torques = np.array([wheel.max_torque for wheel in self._craft.wheels])
        # Motors turn the craft against their wheels.
        self._shares = -np.linalg.pinv(axes.T) / torques[:, None]
        self._turning = 1.0 / np.abs(self._shares @ self._inertia).sum(axis=1).max()
        descent = Descent.of(mission)
        kept = 1.0 - reserve
        self._lander = replace(lander, largest_thrust=lander.largest_thrust * kept)
        self._descent = replace(
            descent,
            tilt=descent.tilt - _UPRIGHT,
            margin=descent.margin * _ARRIVAL,
            position_tolerance=descent.position_tolerance * _ARRIVAL,
            velocity_tolerance=descent.velocity_tolerance * _ARRIVAL,
        )
        self._landings = SteeredLandings(
            self._lander, self._descent, self._turning * _TURNING, self._timing.control_period
        )

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; reads the state, and where the site is."""
        count = len(observation)
        if len(self._plans) != count:
            self.reset(count)
        columns = [np.asarray(x, float) for x in leaves(replace(state, stores=()))]
        columns.append(np.asarray(state.stores[0], float))
        site = np.stack([np.broadcast_to(x, count) for x in goal.p.columns()], axis=1)
        commands = np.zeros((count, len(self._craft.commands)))
        for k, row in enumerate(np.stack(columns, axis=1)):
            commands[k] = self._command(k, _Here.of(row, site[k], self._lander))
        return commands

    def _command(self, number: int, here: _Here) -> np.ndarray:
        """Command (n,) of one episode."""
        followed = self._plans[number]
        if followed is None:
            followed = self._planned(here)
        elif followed.left > _LAST and followed.is_off(here.state, self._descent):
            followed = self._planned_again(followed, here)
        self._plans[number] = followed
        if followed is None or followed.left < 1:
            # Weight, while what is left of speed and height goes.
            thrust, turning = (
                here.state[10] * self._descent.gravity,
                -here.state[6:8] - here.state[8:10],
            )
        else:
            thrust, *turning = followed.next(here.state)
        turning = self._within_tilt(here.state[6:8], here.state[8:10], np.asarray(turning))
        level = np.clip(
            thrust / self._full_thrust, self._craft.actuators.low, self._craft.actuators.high
        )
        angular = here.acceleration(turning, self._timing.control_period)
        torque = self._inertia @ angular * (here.state[10] / self._full_mass)
        shares = np.clip(self._shares @ torque, -1.0, 1.0)
        return np.concatenate([np.full(len(self._craft.thrusters), level), shares])

    def _within_tilt(self, tilt: np.ndarray, rate: np.ndarray, turning: np.ndarray) -> np.ndarray:
        """Turning (2,), less as far as it would tilt the craft so fast that it could not stop within the limit."""
        period = self._timing.control_period
        after = tilt + period * rate + 0.5 * period**2 * turning
        size = float(np.linalg.norm(after))
        if size < 1e-6:
            return turning
        outwards = after / size
        room = max(0.0, self._descent.tilt + 0.5 * _UPRIGHT - size)
        excess = outwards @ (rate + period * turning) - math.sqrt(2.0 * self._turning * room)
        return turning - outwards * (max(0.0, excess) / period)

    def _planned(self, here: _Here) -> _Followed | None:
        """The first plan of a flight."""
        period = self._timing.control_period
        propellant = here.state[10] - (self._lander.mass - self._lander.propellant)
        start = here.state[:3], here.state[3:6]
        fastest = best_landing(
            self._lander, self._descent, start, period, "bound", propellant=propellant
        )
        if fastest is not None:
            for longer in _LONGER:
                count = len(fastest.acceleration) + longer
                # More time than the convex optimum takes makes a better guess.
                guess = landing(
                    self._lander,
                    self._descent,
                    start,
                    count * period,
                    period,
                    propellant=propellant,
                )
                found = self._landings.from_convex(here.state, guess or fastest, count)
                if found is not None:
                    return _Followed(found)
        self.failures += 1
        return None

    def _planned_again(self, followed: _Followed, here: _Here) -> _Followed:
        """A new plan from here, or the old one where there is none."""
        for longer in _AGAIN:
            found = self._landings.again(here.state, followed.plan, followed.left + longer)
            if found is not None:
                return _Followed(found)
        self.failures += 1
        followed.trust()
        return followed


class _Here:
    """A craft's state as plans have it, and its attitude."""

    def __init__(self, state: np.ndarray, rotation: np.ndarray, w: np.ndarray) -> None:
        self.state = state
        """(11,), see `SteeredLanding`."""
        self.rotation = rotation
        """(3, 3) from B to W."""
        self.w = w
        """(3,) angular velocity in B, rad/s."""

    def acceleration(self, turning: np.ndarray, period: float) -> np.ndarray:
        """(3,) angular acceleration in B, rad/s^2, that turns thrust so over a period (s), and ends spin about it.

        Wheels keep the craft's momentum, so that its angular velocity in B changes with this alone.
        """
        tilt = self.state[6:8] + period * self.state[8:10] + 0.5 * period**2 * turning
        rate = self.state[8:10] + period * turning
        # The attitude then, by the shortest way from the one now.
        now, then = self.rotation[:, 2], direction_of(tilt)
        axis = np.cross(now, then)
        cross = np.array(
            [[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]
        )
        turned = (
            self.rotation
            + cross @ self.rotation
            + cross @ cross @ self.rotation / (1.0 + now @ then)
        )
        return (turned.T @ angular_velocity(tilt, rate) - self.w) / period

    @classmethod
    def of(cls, row: np.ndarray, site: np.ndarray, lander: Lander) -> _Here:
        """Of the numbers of a state, and the propellant that is left."""
        w, x, y, z = row[3:7] / np.linalg.norm(row[3:7])
        rotation = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
                [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
                [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        turn = rotation @ row[10:13]
        direction = rotation[:, 2]
        mass = lander.mass - lander.propellant + row[13]
        tilt = tilt_of(direction)
        state = np.concatenate(
            [row[:3] - site, row[7:10], tilt, tilt_rate(direction, turn), [mass]]
        )
        return cls(state, rotation, row[10:13])


class _Followed:
    """A plan, and how much of it has been flown."""

    def __init__(self, plan: SteeredLanding) -> None:
        self.plan = plan
        self._flown = 0
        self._trusted = 0

    @property
    def left(self) -> int:
        """Periods that are still to be flown."""
        return len(self.plan.commands) - self._flown

    def is_off(self, state: np.ndarray, descent: Descent) -> bool:
        """Whether the plan is to be made anew: corrections would miss its end, or be large."""
        if self._flown < self._trusted:
            return False
        off = state - self.plan.states[self._flown]
        missed = self.plan.misses[self._flown] @ off
        return bool(
            (np.abs(off[: len(_ASTRAY)]) > _ASTRAY).any()
            or np.linalg.norm(missed[:3]) > _OFF * descent.position_tolerance
            or np.linalg.norm(missed[3:]) > _OFF * descent.velocity_tolerance
        )

    def trust(self) -> None:
        """Follow it for some periods, however far off it is."""
        self._trusted = self._flown + _PAUSE

    def next(self, state: np.ndarray) -> np.ndarray:
        """Thrust, N, and the tilt's second derivative, rad/s^2, of the next period (3,)."""
        k = self._flown
        self._flown += 1
        off = state - self.plan.states[k]
        return self.plan.commands[k] + self.plan.gains[k] @ off
