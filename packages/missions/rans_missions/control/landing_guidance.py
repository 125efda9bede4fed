"""Guidance for powered descent: plan the landing of least propellant, follow it, plan again when off it.

Rows of states are those of `rans_missions.convex.steered_landing`, relative to the site; one plan an episode.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

from rans.extend import Conditions, ConfigError, Spacecraft, Task, Timing, leaves
from rans_missions.control.planning import PlanningGuidance
from rans_missions.convex.landing import (
    Descent,
    Lander,
    best_landing,
    full_thrust,
    landing,
    thrust_offset,
)
from rans_missions.convex.steered_landing import (
    SteeredLanding,
    SteeredLandings,
    angular_velocity,
    attitude_of,
    direction_of,
    roll_of,
    tilt_of,
    tilt_rate,
)
from rans_missions.tasks.land import Land
from rans_missions.vectors import components

_STATES = 11
"""Number of states of a plan without roll."""
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

    At first, the convex optimum of a craft that turns at once (`rans_missions.convex.landing`) becomes the guess of
    the landing of one that does not (`rans_missions.convex.steered_landing`). The plan's thrust and turning are
    given, corrected by a time-varying LQR for deviations in position, velocity, tilt and its rate. Where these are
    large, or the corrected flight would still miss the site, the plan is made anew from the state as it is, until
    6 s before its end. A perfect world needs one plan, which takes about a second of a core. Where no landing is
    found, the craft brakes upright. From the contact with the ground on, or once it has landed within tolerances,
    the engines are shut, or give their least thrust if they are always lit, and the wheels give no torque.

    With an engine that it knows to be dead, from ``dead`` or from the conditions of its flights, the thrust of the
    others makes an angle with z of B. They are throttled alike, and the craft
    rolls about their thrust, so that it is tilted less than its thrust where the tilt limit matters.

    Args:
        craft: by name, TOML file or as such; engines that push along z of B together, and reaction wheels that turn
            it about every axis.
        task: an `rans_missions.tasks.land.Land`, or its name.
        timing: control period, and length of the episode.
        reserve: share of the largest thrust that plans leave, so that errors can be corrected.
        dead: numbers of engines that it knows to be dead from the start, in the craft's order from 0.

    Raises:
        ConfigError: the task is no landing, the craft is no lander or no wheels turn it, the reserve is not at
            least 0 and below 0.5, or the engines that are left turn the craft.
    """

    name = "landing"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        reserve: float = 0.003,
        dead: Sequence[int] = (),
    ) -> None:
        super().__init__(craft, task, timing, reserve)
        self.dead = tuple(dead)
        """Numbers of the engines that it knows to be dead."""
        mission = Land.expected(self._task, "landing guidance flies descents")
        self._mission = mission
        lander = Lander.of(self._craft, dead)
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
        live = [k for k in range(self._craft.thruster_count) if k not in dead]
        if dead and np.abs(np.array(self._craft.wrench_map)[live, 3:].sum(axis=0)).max() > 1e-9:
            raise ConfigError(
                f"without engines {[*dead]} the others turn {self._craft.name!r}, and landing guidance flies "
                "craft whose engines push through the centre of mass."
            )
        self._live = np.array(live)
        self._axes = _along_thrust(full_thrust(self._craft, dead))
        """(3, 3) rotation from B to the frame whose z is along thrust, and whose x is towards z of B."""
        self._offset = thrust_offset(self._craft, dead) if dead else 0.0
        descent = Descent.of(mission)
        remaining = 1.0 - reserve
        self._lander = replace(lander, largest_thrust=lander.largest_thrust * remaining)
        self._descent = replace(
            descent,
            tilt=descent.tilt - _UPRIGHT,
            margin=descent.margin * _ARRIVAL,
            position_tolerance=descent.position_tolerance * _ARRIVAL,
            velocity_tolerance=descent.velocity_tolerance * _ARRIVAL,
        )
        self._landings = SteeredLandings(
            self._lander,
            self._descent,
            self._turning * _TURNING,
            self._timing.control_period,
            self._offset,
        )
        self._waits: list[int] = []
        """Periods until a first plan is tried again, of each episode."""
        self._landed = np.zeros(0, bool)
        """Whether each episode has touched the ground or landed."""
        # Thrust may be tilted more than the craft.
        self._convex = replace(self._descent, tilt=self._descent.tilt + self._offset)

    def expecting(self, conditions: Conditions | None) -> LandingGuidance:
        """Guidance that knows the engines that are dead from the start under these conditions; None: no engine is.

        Raises:
            ConfigError: see `LandingGuidance`.
        """
        dead = () if conditions is None else conditions.dead
        if dead == self.dead:
            return self
        return LandingGuidance(self._craft, self._task, self._timing, self._reserve, dead)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; plans are forgotten."""
        super().reset(count)
        self._waits = [0] * count
        self._landed = np.zeros(count, bool)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from the state and the site's position; remembers plans and who has landed.

        Once landed, an episode's engines stay at their least thrust; `reset` begins others.
        """
        count = len(observation)
        if len(self._plans) != count:
            self.reset(count)
        columns = [np.asarray(x, float) for x in leaves(replace(state, stores=()))]
        columns.append(np.asarray(state.stores[0], float))
        site = components(goal.p, count)
        height = np.asarray(state.p.z, float) - site[:, 2]
        self._landed = self._landed | self._mission.reached(state, goal) | (height <= 0.0)
        engines = self._craft.thruster_count
        commands = np.zeros((count, self._craft.command_count))
        commands[:, :engines] = self._craft.actuators.low
        for k, row in enumerate(np.stack(columns, axis=1)):
            if not self._landed[k]:
                commands[k] = self._command(k, self._here(row, site[k]))
        return commands

    def _command(self, number: int, situation: _Here) -> np.ndarray:
        """Command (n,) of one episode by its plan, which it makes, follows or replaces in `_plans`.

        Without one it descends upright.
        """
        followed = self._plans[number]
        if followed is not None:
            situation = situation.near(followed)
        if followed is None:
            if self._waits[number] == 0:
                followed = self._planned(situation)
                self._waits[number] = _PAUSE
            self._waits[number] -= 1
        elif followed.left > _LAST and followed.is_off(situation.state, self._descent):
            followed = self._planned_again(followed, situation)
        self._plans[number] = followed
        if followed is None or followed.left < 1:
            # Weight, while what is left of speed and height goes.
            thrust = situation.state[10] * self._descent.gravity
            turning = -situation.state[6:8] - situation.state[8:10]
            rolling = -situation.state[12:]
        else:
            thrust, *others = followed.next(situation.state)
            turning, rolling = np.array(others[:2]), np.array(others[2:])
        turning = self._within_tilt(situation.state[6:8], situation.state[8:10], turning)
        level = np.clip(
            thrust / self._full_thrust, self._craft.actuators.low, self._craft.actuators.high
        )
        angular = situation.acceleration(turning, rolling, self._timing.control_period)
        torque = self._inertia @ self._axes.T @ angular * (situation.state[10] / self._full_mass)
        gimbals = np.clip(self._shares @ torque, -1.0, 1.0)
        levels = np.full(self._craft.thruster_count, self._craft.actuators.low)
        levels[self._live] = level
        return np.concatenate([levels, gimbals])

    def _here(self, row: np.ndarray, site: np.ndarray) -> _Here:
        """State as plans have it, of a row (14,) of state and propellant left, kg, and the site (3,), m.

        The row has position, quaternion (w first), velocity, spin and propellant, in the order of a state's leaves.
        """
        w, x, y, z = row[3:7] / np.linalg.norm(row[3:7])
        rotation = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
                [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
                [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        mass = self._lander.mass - self._lander.propellant + row[13]
        spin = self._axes @ row[10:13]
        moving = row[:3] - site, row[7:10]
        return _Here.of(moving, rotation @ self._axes.T, spin, mass, rolls=self._offset > 0.0)

    def _within_tilt(self, tilt: np.ndarray, rate: np.ndarray, turning: np.ndarray) -> np.ndarray:
        """Turning (2,), less as far as it would tilt the craft so fast that it could not stop within the limit."""
        period = self._timing.control_period
        after = tilt + period * rate + 0.5 * period**2 * turning
        size = float(np.linalg.norm(after))
        if size < 1e-6:
            return turning
        outwards = after / size
        room = max(0.0, self._convex.tilt + 0.5 * _UPRIGHT - size)
        excess = outwards @ (rate + period * turning) - math.sqrt(2.0 * self._turning * room)
        return turning - outwards * (max(0.0, excess) / period)

    def _planned(self, situation: _Here) -> _Followed | None:
        """The first plan of a flight, from the convex optimum; None counts a failure.

        The convex optimum is on side "bound": no flight is faster, so that its time is where the search begins.
        """
        period = self._timing.control_period
        propellant = situation.state[10] - (self._lander.mass - self._lander.propellant)
        start = situation.state[:3], situation.state[3:6]
        fastest = best_landing(
            self._lander, self._convex, start, period, "bound", propellant=propellant
        )
        if fastest is not None:
            for longer in _LONGER:
                count = len(fastest.acceleration) + longer
                # More time than the convex optimum takes makes a better guess.
                guess = landing(
                    self._lander,
                    self._convex,
                    start,
                    count * period,
                    period,
                    propellant=propellant,
                )
                solution = self._landings.from_convex(situation.state, guess or fastest, count)
                if solution is not None:
                    return _Followed(solution)
        self.failures += 1
        return None

    def _planned_again(self, followed: _Followed, situation: _Here) -> _Followed:
        """A new plan from here.

        Where there is none the old one, which counts as a failure and is trusted for a while.
        """
        for longer in _AGAIN:
            solution = self._landings.again(situation.state, followed.plan, followed.left + longer)
            if solution is not None:
                return _Followed(solution)
        self.failures += 1
        followed.trust()
        return followed


def _along_thrust(force: np.ndarray) -> np.ndarray:
    """(3, 3) rotation from B to a frame whose z is along a force (3,), and whose x is towards z of B."""
    z = force / np.linalg.norm(force)
    x = np.array([0.0, 0.0, 1.0]) - z[2] * z
    if np.linalg.norm(x) < 1e-6:
        return np.eye(3)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


@dataclass(frozen=True)
class _Here:
    """A craft's state as plans have it, and its attitude."""

    state: np.ndarray
    """(n,), see `SteeredLanding`."""
    rotation: np.ndarray
    """(3, 3) to W from the frame whose z is along thrust."""
    w: np.ndarray
    """(3,) angular velocity in that frame, rad/s."""

    def near(self, followed: _Followed) -> _Here:
        """This state with its roll angle within half a turn of that of a plan, which may count whole turns."""
        if len(self.state) == _STATES or followed.left < 1:
            return self
        state = self.state.copy()
        state[11] += math.tau * round((followed.expected[11] - state[11]) / math.tau)
        return replace(self, state=state)

    def acceleration(self, turning: np.ndarray, rolling: np.ndarray, period: float) -> np.ndarray:
        """(3,) angular acceleration, rad/s^2, that turns thrust and rolls so over a period (s).

        Without roll it ends spin about the thrust. Wheels keep the craft's momentum, so that its angular velocity
        in its own frame changes with this alone.
        """
        tilt = self.state[6:8] + period * self.state[8:10] + 0.5 * period**2 * turning
        rate = self.state[8:10] + period * turning
        if len(rolling):
            roll = self.state[11] + period * self.state[12] + 0.5 * period**2 * rolling[0]
            roll_rate = self.state[12] + period * rolling[0]
            attitude = attitude_of(tilt, roll)
            small = 1e-4
            change = attitude_of(tilt + small * rate, roll + small * roll_rate)
            change -= attitude_of(tilt - small * rate, roll - small * roll_rate)
            spin = attitude.T @ change / (2.0 * small)
            return (np.array([spin[2, 1], spin[0, 2], spin[1, 0]]) - self.w) / period
        # The attitude then, by the shortest way from the one now.
        now, then = self.rotation[:, 2], direction_of(tilt)
        axis = np.cross(now, then)
        cross = np.array(
            [[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]
        )
        attitude = (
            self.rotation
            + cross @ self.rotation
            + cross @ cross @ self.rotation / (1.0 + now @ then)
        )
        return (attitude.T @ angular_velocity(tilt, rate) - self.w) / period

    @classmethod
    def of(
        cls,
        moving: tuple[np.ndarray, np.ndarray],
        rotation: np.ndarray,
        w: np.ndarray,
        mass: float,
        rolls: bool,
    ) -> _Here:
        """State of a plan.

        Args:
            moving: position from the site, m, and velocity, m/s, in W, (3,) each.
            rotation: see `_Here`.
            w: see `_Here`.
            mass: kg.
            rolls: whether plans have roll.
        """
        direction = rotation[:, 2]
        tilt = tilt_of(direction), tilt_rate(direction, rotation @ w)
        state = np.concatenate([*moving, *tilt, [mass]])
        if rolls:
            small = 1e-4
            cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
            before, after = (roll_of(rotation @ expm(h * cross)) for h in (-small, small))
            rate = math.remainder(after - before, math.tau) / (2.0 * small)
            state = np.concatenate([state, [roll_of(rotation), rate]])
        return cls(state, rotation, w)


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

    @property
    def expected(self) -> np.ndarray:
        """(n,) state that the plan has now."""
        return self.plan.states[self._flown]

    def is_off(self, state: np.ndarray, descent: Descent) -> bool:
        """Whether the plan is to be made anew: corrections of this state (14,) would miss its end, or be large.

        `misses` says what is left at the end after the plan's own gains have corrected.
        """
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
        """Thrust, N, and the second derivatives of tilt and roll, rad/s^2, of the next period (m,)."""
        k = self._flown
        self._flown += 1
        off = state - self.plan.states[k]
        return self.plan.commands[k] + self.plan.gains[k] @ off
