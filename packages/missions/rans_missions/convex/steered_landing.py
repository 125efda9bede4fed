"""Least propellant of a powered descent by a rigid craft, which has to turn before its thrust points elsewhere.

`rans_missions.convex.landing` turns thrust at once, which makes a convex program of the descent. Here the tilt of
thrust is a double integrator, so that the program is not convex: IPOPT finds a local optimum of it, from the convex
optimum as its guess. It can be flown, and is no bound.

The tilt is a rotation vector (x, y, 0) in W that turns the vertical into the direction of thrust. Its second
derivative is bounded, and held over a control period as thrust is.

Where engines are dead, the thrust of the others makes an angle with the axis of the craft, whose tilt is limited.
The craft then rolls about its thrust so that its axis is tilted less than its thrust where that helps. The roll is
one more double integrator: the angle about the vertical by which the craft is turned before it is tilted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm, solve

from rans.extend import require
from rans.optimal.solver import solution_of
from rans_missions.convex.landing import Descent, Lander, Landing

if TYPE_CHECKING:
    import casadi as ca
else:
    ca = require("casadi")

_UNITS = np.array([100.0] * 3 + [10.0] * 3 + [1.0] * 4 + [1000.0] + [1.0] * 2)
"""Units in which the solver has states: m, m/s, rad, rad/s, kg; then rad and rad/s of roll, if plans have any."""
_THRUST = 1e4
"""Of the solver's thrust, N."""
_COMMAND_UNITS = np.array([_THRUST, 1.0, 1.0, 1.0])
_STATES = 11
"""Without roll."""
_COMMANDS = 3
"""Without roll."""
_SMOOTHNESS = 1e-2
"""Price of the mean square of the tilt's second derivative, in units of 100 kg per rad^2/s^4: about 0.05 kg a
landing, without which the tilt chatters where nothing depends on it."""
_HEIGHT = 0.05
"""Above the ground in the middle and at the end of every period, m: contact is not exact to a millimetre."""
_OPTIONS = {
    "expand": True,
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 200,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.tol": 1e-6,
}
_ROLLED = 0.3
"""Tilt above which a guess rolls the craft into its plane, rad."""
_STATE_PRICES = (
    1.0 / np.array([10.0] * 3 + [2.0] * 3 + [0.1] * 2 + [0.2] * 2 + [1e4, 0.1, 0.2]) ** 2
)
"""Weights of squared deviations from the plan in every period of the LQR, in the order of the states."""
_LAST_PRICES = 1.0 / np.array([0.1] * 3 + [0.05] * 3 + [0.1] * 2 + [0.2] * 2 + [1e4, 0.1, 0.2]) ** 2
"""The same where the plan ends."""
_COMMAND_PRICES = 1.0 / np.array([500.0, 0.2, 0.2, 0.2]) ** 2
"""Weights of squared changes of thrust, N, and of the second derivatives of tilt and roll, rad/s^2, of the LQR."""


@dataclass(frozen=True)
class SteeredLanding:
    """A landing of a craft that turns, with thrust and turning held for equal periods.

    A state is position (3, m) and velocity (3, m/s) in W, tilt (2, rad), its rate (2, rad/s), and mass (kg): n = 11
    numbers, with m = 3 commands. A craft that rolls has roll (rad) and its rate (rad/s) too, and one command more.
    """

    period: float
    """s."""
    states: np.ndarray
    """(N + 1, n)."""
    commands: np.ndarray
    """(N, m): thrust, N, and the second derivatives of tilt and roll, rad/s^2."""
    gains: np.ndarray
    """(N, m, n): by how much commands change with a deviation from the plan's state (time-varying LQR)."""
    misses: np.ndarray
    """(N + 1, 6, n): how a deviation now changes the last position and velocity, with these gains."""

    @property
    def propellant(self) -> float:
        """Used, kg."""
        return float(self.states[0, 10] - self.states[-1, 10])

    @property
    def time(self) -> float:
        """Flight time, s."""
        return self.period * len(self.commands)


class SteeredLandings:
    """Landings of one craft, ready to be solved from any state; programs are kept by their number of periods.

    Args:
        lander: what lands.
        descent: what is asked for, with tolerances > 0.
        turning: largest second derivative of either component of the tilt, and of the roll, rad/s^2.
        period: for which commands are held, s.
        offset: angle between thrust and the axis of the craft whose tilt is limited, rad. Seen along the thrust, a
            roll of 0 has this axis towards x. With 0 there is no roll.
    """

    def __init__(
        self,
        lander: Lander,
        descent: Descent,
        turning: float,
        period: float,
        offset: float = 0.0,
    ) -> None:
        self._lander = lander
        self._descent = descent
        self._turning = turning
        self._period = period
        self._offset = offset
        self._step = _step(lander, descent, period, rolls=offset > 0.0)
        state = ca.SX.sym("state", self._step.size1_in(0))
        command = ca.SX.sym("command", self._step.size1_in(1))
        after = self._step(state, command)
        slopes = [ca.jacobian(after, state), ca.jacobian(after, command)]
        self._slopes = ca.Function("slopes", [state, command], slopes)
        self._programs: dict[int, _Program] = {}

    def from_convex(self, state: np.ndarray, plan: Landing, count: int) -> SteeredLanding | None:
        """Landing from a state (n,) in so many periods, guessed from a convex optimum; None: none was found."""
        return self._solved(state, self._guess(state, plan, count), count)

    def again(self, state: np.ndarray, plan: SteeredLanding, count: int) -> SteeredLanding | None:
        """Landing from a state (n,) in so many periods, guessed from the end of a plan; None: none was found."""
        instants = np.linspace(len(plan.commands) - count, len(plan.commands), count + 1)
        planned = np.arange(len(plan.states))
        states = np.stack([np.interp(instants, planned, x) for x in plan.states.T], axis=1)
        held = np.clip(np.floor(instants[:-1]).astype(int), 0, len(plan.commands) - 1)
        return self._solved(state, _packed(states, plan.commands[held]), count)

    def _solved(self, state: np.ndarray, guess: np.ndarray, count: int) -> SteeredLanding | None:
        """The landing over so many periods from a guess, with gains along it; None: IPOPT finds none.

        Programs are made once a length.
        """
        if count not in self._programs:
            self._programs[count] = _Program(
                self._lander,
                self._descent,
                self._turning,
                self._step,
                count,
                self._period,
                self._offset,
            )
        answer = self._programs[count].solve(state, guess)
        if answer is None:
            return None
        states, commands = answer
        gains, misses = self._gains(states, commands)
        return SteeredLanding(self._period, states, commands, gains, misses)

    def _gains(self, states: np.ndarray, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`SteeredLanding.gains` (T, width, size) and `.misses` (T + 1, 6, size), by Riccati's recursion.

        Gains and misses are in SI units, slopes of `_slopes` in the solver's.
        """
        count, width = commands.shape
        size = states.shape[1]
        scales = _UNITS[:size]
        units = _COMMAND_UNITS[:width]
        gains = np.zeros((count, width, size))
        misses = np.zeros((count + 1, 6, size))
        misses[-1, :, :6] = np.eye(6)
        price = np.diag(_LAST_PRICES[:size])
        for k in reversed(range(count)):
            slopes = self._slopes(states[k] / scales, commands[k] / units)
            motion = np.array(slopes[0]) * scales[:, None] / scales
            push = np.array(slopes[1]) * scales[:, None] / units
            weighed = push.T @ price
            gains[k] = -solve(np.diag(_COMMAND_PRICES[:width]) + weighed @ push, weighed @ motion)
            closed = motion + push @ gains[k]
            price = np.diag(_STATE_PRICES[:size]) + motion.T @ price @ closed
            price = 0.5 * (price + price.T)
            misses[k] = misses[k + 1] @ closed
        return gains, misses

    def _guess(self, state: np.ndarray, plan: Landing, count: int) -> np.ndarray:
        """The convex optimum over so many periods as a guess of all variables, smoothed and differentiated."""
        length = len(plan.acceleration)
        knots = np.linspace(0.0, length, count + 1)
        along = np.arange(length + 1)
        upright = math.hypot(*state[6:8]) < 1e-6
        first = [0.0, 0.0, 1.0] if upright else direction_of(state[6:8])
        # Directions of the thrust from the present attitude on, smoothed: the craft cannot turn at once.
        size = np.linalg.norm(plan.acceleration, axis=1)
        directions = np.vstack([first, plan.acceleration / size[:, None]])
        for _ in range(4):
            inner = directions[:-2] + 2.0 * directions[1:-1] + directions[2:]
            directions[1:-1] = 0.25 * inner
        tilt = np.array([tilt_of(direction) for direction in directions])
        # Interpolated at the knots, where the tilt's rate and its rate are differences.
        thrust = size * 0.5 * (plan.mass[1:] + plan.mass[:-1])
        table = np.column_stack([plan.p, plan.v, tilt, plan.mass])
        at_knots = np.stack([np.interp(knots, along, x) for x in table.T], axis=1)
        if count > 1:
            rate = np.gradient(at_knots[:, 6:8], self._period, axis=0)
            turning = np.gradient(rate, self._period, axis=0)[:-1]
        else:
            rate, turning = np.zeros((2, 2)), np.zeros((1, 2))
        held = np.interp(knots[:-1], np.arange(length), thrust)
        states = np.column_stack([at_knots[:, :8], rate, at_knots[:, 8]])
        commands = np.column_stack([held, turning])
        # Thrust at an angle from the axis: the craft rolls so that its axis is tilted less than the thrust.
        if self._offset > 0.0:
            roll = _rolled(states[:, 6:8], float(state[11]))
            rate = np.gradient(roll, self._period) if count > 1 else np.zeros(2)
            states = np.column_stack([states, roll, rate])
            commands = np.column_stack([commands, np.diff(rate) / self._period])
        return _packed(states, commands)


def _rolled(tilts: np.ndarray, first: float) -> np.ndarray:
    """Rolls (N + 1,), from the first one on, with which the axis is tilted less than thrust with these tilts.

    It only begins the search, whose constraints decide.
    """
    roll = np.full(len(tilts), np.nan)
    roll[0] = first
    last = first
    for k in range(1, len(tilts)):
        if np.linalg.norm(tilts[k]) > _ROLLED:
            aligned = math.atan2(tilts[k, 0], -tilts[k, 1])
            last = aligned + math.tau * round((last - aligned) / math.tau)
            roll[k] = last
    defined = np.flatnonzero(np.isfinite(roll))
    roll = np.interp(np.arange(len(tilts)), defined, roll[defined])
    for _ in range(8):
        roll[1:-1] = 0.25 * (roll[:-2] + 2.0 * roll[1:-1] + roll[2:])
    return roll


def direction_of(tilt: np.ndarray) -> np.ndarray:
    """(3,) direction of thrust with a tilt (2,), rad."""
    angle = math.hypot(*tilt)
    sinc = math.sin(angle) / angle if angle > 1e-9 else 1.0
    return np.array([tilt[1] * sinc, -tilt[0] * sinc, math.cos(angle)])


def tilt_of(direction: np.ndarray) -> np.ndarray:
    """(2,) rotation vector in W, rad, that turns the vertical into a direction (3,) above the horizon."""
    x, y, z = direction / np.linalg.norm(direction)
    across = math.hypot(x, y)
    if across < 1e-9:
        return np.array([-y, x])
    return np.array([-y, x]) * (math.atan2(across, z) / across)


def angular_velocity(tilt: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(3,) rad/s in W, of thrust whose tilt (2,), rad, changes at a rate (2,), rad/s, without spin about it."""
    small = 1e-4
    change = direction_of(tilt + small * rate) - direction_of(tilt - small * rate)
    return np.cross(direction_of(tilt), change / (2.0 * small))


def tilt_rate(direction: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(2,) rate of the tilt, rad/s, of thrust along a direction (3,) that turns with w (3,) in W, rad/s."""
    small = 1e-4
    change = np.cross(w, direction) * small
    return (tilt_of(direction + change) - tilt_of(direction - change)) / (2.0 * small)


def attitude_of(tilt: np.ndarray, roll: float) -> np.ndarray:
    """(3, 3) rotation to W from the frame whose z is along thrust, with a tilt (2,), rad, and a roll, rad."""
    turn = np.array([[0.0, 0.0, tilt[1]], [0.0, 0.0, -tilt[0]], [-tilt[1], tilt[0], 0.0]])
    c, s = math.cos(roll), math.sin(roll)
    return expm(turn) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def roll_of(rotation: np.ndarray) -> float:
    """Roll, rad within a turn, of a rotation (3, 3) to W from the frame whose z is along thrust."""
    untilted = attitude_of(tilt_of(rotation[:, 2]), 0.0).T @ rotation
    return math.atan2(untilted[1, 0], untilted[0, 0])


def _packed(states: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """The solver's variables: states after each period, then commands."""
    scales, units = _UNITS[: states.shape[1]], _COMMAND_UNITS[: commands.shape[1]]
    return np.concatenate([(states[1:] / scales).ravel(), (commands / units).ravel()])


def _step(lander: Lander, descent: Descent, period: float, rolls: bool = False) -> ca.Function:
    """Motion over one period in the solver's units, by the classical Runge-Kutta method.

    Both the program and the gains of the guidance have their motion from here.
    """
    state = ca.SX.sym("state", _STATES + 2 * rolls)
    command = ca.SX.sym("command", _COMMANDS + rolls)
    units = ca.DM(_UNITS[: _STATES + 2 * rolls])

    def slope(x: ca.SX) -> ca.SX:
        """Derivative of the scaled state by time, 1/s.

        Position, velocity, tilt, its rate, mass, and roll where the craft rolls.
        """
        tilt = x[6:8]
        angle = ca.sqrt(ca.sumsqr(tilt) + 1e-12)
        sinc = ca.sin(angle) / angle
        direction = ca.vertcat(tilt[1] * sinc, -tilt[0] * sinc, ca.cos(angle))
        push = direction * (command[0] * _THRUST / (x[10] * _UNITS[10]))
        acceleration = push - ca.DM([0.0, 0.0, descent.gravity])
        flow = command[0] * (_THRUST / lander.exhaust_speed)
        derivative = ca.vertcat(x[3:6] * _UNITS[3], acceleration, x[8:10], command[1:3], -flow)
        if rolls:
            derivative = ca.vertcat(derivative, x[12], command[3])
        return derivative / units

    first = slope(state)
    second = slope(state + 0.5 * period * first)
    third = slope(state + 0.5 * period * second)
    fourth = slope(state + period * third)
    after = state + period / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return ca.Function("step", [state, command], [after])


def _height_of_axis(tilt: ca.MX, roll: ca.MX, offset: float) -> ca.MX:
    """Cosine of the tilt (1, N) of an axis off the thrust, whose tilts are (2, N) and whose rolls are (1, N)."""
    angle = ca.sqrt(ca.sum1(tilt**2) + 1e-12)
    sinc = ca.sin(angle) / angle
    towards = tilt[0, :] * ca.sin(roll) - tilt[1, :] * ca.cos(roll)
    return math.cos(offset) * ca.cos(angle) + math.sin(offset) * towards * sinc


class _Program:
    """The nonlinear program of landings in ``count`` periods of ``period`` s.

    Variables are the states after each period (size, count) and its commands (width, count), as of ``step``; each
    kind of rows comes with its bounds. `SteeredLandings` keeps one for each count.
    """

    def __init__(
        self,
        lander: Lander,
        descent: Descent,
        turning: float,
        step: ca.Function,
        count: int,
        period: float,
        offset: float,
    ) -> None:
        self._count = count
        size, width = step.size1_in(0), step.size1_in(1)
        self._size, self._width = size, width
        states = ca.MX.sym("states", size, count)
        commands = ca.MX.sym("commands", width, count)
        start = ca.MX.sym("start", size)
        before = ca.horzcat(start, states[:, :-1])

        # Rows, each with its bounds: intervals join; tilt in the middle and at the end of a period; glide slope;
        # height in the middle; where it ends.
        rows: list[ca.MX] = [ca.vec(states - step.map(count)(before, commands))]
        low = [np.zeros(size * count)]
        high = [np.zeros(size * count)]
        middle = (
            before[6:8, :] + 0.5 * period * before[8:10, :] + 0.125 * period**2 * commands[1:3, :]
        )
        if offset > 0.0:
            half_roll = before[11, :] + 0.5 * period * before[12, :]
            half_roll += 0.125 * period**2 * commands[3, :]
            for tilt, roll in ((middle, half_roll), (states[6:8, :], states[11, :])):
                rows.append(_height_of_axis(tilt, roll, offset).T)
                low.append(np.full(count, math.cos(descent.tilt)))
                high.append(np.full(count, np.inf))
        else:
            for tilt in (middle, states[6:8, :]):
                rows.append(ca.sum1(tilt**2).T)
                low.append(np.full(count, -np.inf))
                high.append(np.full(count, descent.tilt**2))
        halfway = 0.5 * (before[:3, :] + states[:3, :])
        halfway += 0.125 * period * (before[3:6, :] - states[3:6, :]) * (_UNITS[3] / _UNITS[0])
        # Between the periods only craft that roll came below the slope, by centimetres near the ground.
        for positions in (halfway, states[:3, :]) if offset > 0.0 else (states[:3, :],):
            rim = positions[2, :] / math.tan(descent.glide_slope) + descent.margin / _UNITS[0]
            rows.append((rim**2 - ca.sum1(positions[:2, :] ** 2)).T)
            low.append(np.zeros(count))
            high.append(np.full(count, np.inf))
        rows.append(halfway[2, :].T * _UNITS[2])
        low.append(np.full(count, _HEIGHT))
        high.append(np.full(count, np.inf))
        for part, tolerance in (
            (states[:3, -1], descent.position_tolerance / _UNITS[0]),
            (states[3:6, -1], descent.velocity_tolerance / _UNITS[3]),
        ):
            rows.append(ca.sumsqr(part))
            low.append(np.zeros(1))
            high.append(np.full(1, tolerance**2))

        cost = -10.0 * states[10, -1] + _SMOOTHNESS * ca.sumsqr(commands[1:, :]) / count
        problem = {
            "x": ca.vertcat(ca.vec(states), ca.vec(commands)),
            "p": start,
            "f": cost,
            "g": ca.vertcat(*rows),
        }
        self._solver = ca.nlpsol("landing", "ipopt", problem, _OPTIONS)

        least = np.full((count, size), -np.inf)
        least[:, 2] = _HEIGHT / _UNITS[2]
        least[:, 10] = (lander.mass - lander.propellant) / _UNITS[10]
        weakest = [lander.least_thrust / _THRUST, *[-turning] * (width - 1)]
        strongest = [lander.largest_thrust / _THRUST, *[turning] * (width - 1)]
        self._bounds = {
            "lbx": np.concatenate([least.ravel(), np.tile(weakest, count)]),
            "ubx": np.concatenate([np.full(least.size, np.inf), np.tile(strongest, count)]),
            "lbg": np.concatenate(low),
            "ubg": np.concatenate(high),
        }

    def solve(self, state: np.ndarray, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """States (N + 1, n) and commands (N, m) in SI units; None: the solver did not succeed.

        Other local optima come from other guesses, and no solution says that there is none.
        """
        scales = _UNITS[: self._size]
        answer, statistics = solution_of(self._solver, x0=guess, p=state / scales, **self._bounds)
        if not statistics["success"]:
            return None
        x = np.array(answer["x"]).ravel()
        split = self._size * self._count
        after = x[:split].reshape(self._count, self._size) * scales
        commands = x[split:].reshape(self._count, self._width) * _COMMAND_UNITS[: self._width]
        return np.vstack([state, after]), commands
