"""Model predictive control: what an agent must be compared with where constraints and turning matter.

Errors are minimal coordinates of a state around a goal, 6 in the plane, 12 in space: p - p_goal in W, the
rotation vector of R_goal^T R, v - v_goal in W and w - w_goal in B; SI units. Unlike a quaternion's entries
they are independent, which curvature matrices and linear dynamics ask for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.control.lqr import LQR
from rans.extend import (
    Body,
    ConfigError,
    Drift,
    Spacecraft,
    State,
    Task,
    Timing,
    advance,
    around,
    brief,
    coordinates,
    leaves,
    map_leaves,
    rotation_vector,
    scenario,
    whole,
)
from rans_optimal.arrival import path_margins
from rans_optimal.checks import moves_goal
from rans_optimal.guess import allocation_of
from rans_optimal.solver import ca, solution_of
from rans_optimal.transcription import wrench_of


@dataclass(frozen=True)
class MPCSettings:
    """How an MPC looks ahead.

    Raises:
        ConfigError: it is not a positive whole number.
    """

    horizon: int = 20
    """Control periods that are planned; 30 settle no sooner at 5 Hz and cost 1.4 times the time."""

    def __post_init__(self) -> None:
        whole("MPC: horizon", self.horizon)


_SETTINGS = MPCSettings()
_VIOLATION = 1e4
"""Cost of a margin that lacks 1 (SI units) after one period; full thrust along an axis costs 1."""
_RESERVE = 0.01
"""Margin that plans keep after every period, in SI units: between two periods it may be less."""
_WHEEL_EFFORT = 1e-2
"""Price of a wheel's largest torque over that of a thruster's full thrust: wheels take no impulse, and a program
whose curvature were zero in them would be solved less well."""
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0)
"""Parts of the way from a plan to the next one, of which the best is gone where there are constraints."""


class MPC(LQR):
    """Plans the relaxed commands of the next seconds at every step and rounds the first to on/off.

    >>> from rans_optimal.mpc import MPCSettings
    >>> rans.MPC("floating-platform", "go-to-position", settings=MPCSettings(horizon=5))
    <MPC: GoToPosition for floating-platform>

    One sequential quadratic program with Gauss-Newton curvature, carried on from step to step (real-time
    iteration: Diehl, Bock and Schlöder, SIAM J. Control Optim. 43, 2005): the plan of the step before,
    shifted by one period, is flown from the current state by the engines' equations; these are linearised
    along it; and a quadratic program (PIQP) gives the next plan. Deviations cost what they cost the LQR,
    whose cost-to-go ends the horizon. The motion is that of the task's drift, and errors are those from where
    the goal will be; thrust costs by how much it differs from what holds the craft at its goal. Margins of the
    task's constraints are linearised too, and kept above 0.01 m or m/s after every period of the plan unless
    nothing can: what is missing costs `_VIOLATION` per unit (exact penalty). As margins bend, the plan goes only
    part of the way to the program's solution: the part after which it costs least as it is flown.

    Raises:
        ConfigError: the thrusters cannot push the spacecraft in every direction, or cannot turn it as the task
            asks.
    """

    name = "MPC"
    needs_thrusters: ClassVar[bool] = True
    heeds_constraints = True
    tunable: ClassVar = {**LQR.tunable, "settings.horizon": (10, 40)}
    """Bounds for `rans tune`."""
    slow = True
    """Many episodes are flown by many processes."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        weights: Any = LQR.weights,
        deadband: Any = LQR.deadband,
        settings: MPCSettings = _SETTINGS,
    ) -> None:
        super().__init__(craft, task, timing, weights, deadband)
        if not isinstance(settings, MPCSettings):
            raise ConfigError(f"settings must be an MPCSettings, got {brief(settings)}.")
        self._settings = (weights, deadband, settings)
        craft = self._craft
        task = self._task
        period = self._timing.control_period
        self._wrenches = _wrenches(craft)
        self._wheels = craft.wheel_count
        self._tank = craft.propellant is not None
        self._allocation = allocation_of(craft)
        # The quadratic program, of a step of the motion and of the margins of constraints.
        like = scenario(task, craft.dimension, seed=0, episode=0).goal
        step = _step(craft, period, like, task.drift)
        margins = _margins(craft, task, like)
        self._program = _Program(craft, self._regulator, step, settings.horizon, period, margins)
        self._plans = np.zeros((0, len(self._wrenches), settings.horizon))
        self.failures = 0
        """Quadratic programs since `reset` that PIQP did not solve: the plan before was flown on."""

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        super().reset(count)
        self._plans = np.zeros((count, *self._plans.shape[1:]))
        self.failures = 0

    def _demanded(self, state: Any, goal: Any, rest: np.ndarray) -> np.ndarray:
        """The wrench on B, (N, 3 or 6), with which better plans begin; those that rest plan nothing.

        Changes the plans, and counts failures.
        """
        errors = shortest(state, goal)
        goals = self._goals(state, goal)
        holding = self._holding(state, goal)
        momenta = np.array(
            [np.broadcast_to(h, len(rest)) for h in state.stores[int(self._tank) :][: self._wheels]]
        ).reshape(self._wheels, len(rest))
        self._plans[rest] = 0.0
        for k in np.flatnonzero(~rest):
            better = self._program.improved(
                self._plans[k], errors[:, k], goals[:, :, k], holding[k], momenta[:, k]
            )
            self.failures += better is None
            self._plans[k] = self._plans[k] if better is None else better
        first = self._plans[..., 0]  # then one period later; what follows the end is a coast
        self._plans = np.concatenate(
            [self._plans[..., 1:], np.zeros_like(self._plans[..., :1])], axis=-1
        )
        return first @ self._wrenches

    def _goals(self, state: Any, goal: Any) -> np.ndarray:
        """(fields of the goal, horizon + 1, N): now and after every period of the plan.

        The solver's parameters have fields of a goal in the order of `rans.model.fields.leaves`.
        """
        period = self._timing.control_period
        horizon = self._plans.shape[2]
        size = np.shape(state.p.columns()[0])

        def column(time: float) -> list[np.ndarray]:
            goal_then = self._task.later(goal, time)
            return [np.broadcast_to(x, size) for x in leaves(goal_then)]

        now: Any = column(0.0)
        if not moves_goal(self._task):
            table = np.array(now, dtype=float)
            return np.broadcast_to(table[:, None], (len(table), horizon + 1, *size))
        ahead: Any = [now, *(column(k * period) for k in range(1, horizon + 1))]
        return np.moveaxis(np.array(ahead, dtype=float), 0, 1)

    def _holding(self, state: Any, goal: Any) -> np.ndarray:
        """Commands (N, thrusters and wheels) that keep the craft at its goal in its drift, as it is turned.

        The force is for the nominal mass.
        """
        later = self._task.later(goal, self._timing.control_period)
        push = self._regulator.holding(state, goal, later)
        force = state.attitude.to(self._identity).rotate(type(state.p)(*(self._craft.mass * push)))
        wrench = np.zeros((push.shape[1], self._craft.degrees_of_freedom))
        wrench[:, : self._craft.dimension] = np.array(leaves(force)).T
        holding = np.zeros(self._plans.shape[:2])
        if wrench.any():
            holding[:, self._craft.thruster_commands] = self._allocation.commands(wrench)
        return holding


class _Program:
    """The quadratic program: commands u_0 .. u_T-1 and errors e_1 .. e_T, linear in each other.

    Minimises the sum of e' Q e and (u - h)' R (u - h), where the commands h hold the craft at its goal,
    subject to 0 <= u <= 1 (their sum too, where thrust is shared) and e_k+1 = f(e_k, u_k) linearised along
    the plan. Wheels follow the thrusters, with commands from -1 to 1 at a small price, and rows that keep the
    momentum of each within its limit after every period. Where there are constraints, slacks s_1 .. s_T >= 0 at
    their price make up for margins of the errors that would be negative.
    """

    def __init__(
        self,
        craft: Spacecraft,
        regulator: Any,
        step: ca.Function,
        horizon: int,
        period: float,
        margins: ca.Function | None = None,
    ) -> None:
        """Make the program once: it is linearised anew for every solution."""
        thrusters = craft.thruster_count
        self._wheels = craft.wheel_count
        self._nozzles = thrusters + self._wheels
        self._count = horizon
        size = 2 * craft.degrees_of_freedom
        self._slacks = 0 if margins is None else margins.size1_out(0) * horizon
        counts = [self._nozzles * horizon, size * horizon, self._slacks]
        variables = ca.MX.sym("variables", sum(counts))
        plan, errors, slacks = ca.vertsplit(variables, np.cumsum([0, *counts]).tolist())
        plan = ca.reshape(plan, self._nozzles, horizon)
        errors = ca.reshape(errors, size, horizon)
        error = ca.MX.sym("error", size)
        goals = ca.MX.sym("goals", step.size1_in(2), horizon + 1)
        momenta = ca.MX.sym("momenta", self._wheels)
        now, later = goals[:, :-1], goals[:, 1:]

        # Rows with their bounds: the motion, shared thrust, momenta of wheels, and margins.
        before = ca.horzcat(error, errors[:, :-1])
        rows = [(errors - step.map(horizon)(before, plan, now, later), 0.0, 0.0)]
        if craft.thrust_sharing == "split":
            rows.append((ca.sum1(plan[:thrusters, :]), -np.inf, 1.0))
        for number, wheel in enumerate(craft.wheels):
            changes = wheel.max_torque * period * plan[thrusters + number, :]
            spun = momenta[number] + ca.cumsum(changes, 1)
            rows.append((spun, -wheel.max_momentum, wheel.max_momentum))
        given = ca.MX.sym("given", plan.shape)
        flown = step.mapaccum(horizon)(error, given, now, later)
        missing = ca.MX(0, 1)
        if margins is not None:
            rows.append((ca.vec(margins.map(horizon)(errors, later)) + slacks, _RESERVE, np.inf))
            missing = ca.fmax(_RESERVE - ca.vec(margins.map(horizon)(flown, later)), 0.0)
        values = ca.vertcat(*(ca.vec(row) for row, _, _ in rows))
        slope = ca.jacobian(values, variables)
        self._linearised = ca.Function(
            "linearised", [variables, error, goals, momenta], [values, slope]
        )
        # The variables of a plan as it is flown.
        self._flown = ca.Function(
            "flown", [given, error, goals], [ca.vertcat(ca.vec(given), ca.vec(flown), missing)]
        )

        curvature = self._curvature(craft, regulator)
        self._effort = float(curvature[0, 0])
        self._curved = ca.diagcat(curvature, ca.DM(self._slacks, self._slacks))
        self._limits = [
            np.concatenate([np.full(row.numel(), bounds[side]) for row, *bounds in rows])
            for side in range(2)
        ]
        self._bounds = np.repeat([[0.0], [-1.0]], [thrusters, self._wheels], axis=0)
        self._low = np.concatenate(
            [np.tile(self._bounds[:, 0], horizon), np.repeat([-np.inf, 0.0], counts[1:])]
        )
        self._high = np.repeat([1.0, np.inf, np.inf], counts)
        self._solver = ca.conic(
            "plan",
            "piqp",
            {"h": self._curved.sparsity(), "a": slope.sparsity()},
            {"error_on_fail": False, "print_time": False},
        )

    def improved(
        self,
        plan: np.ndarray,
        error: np.ndarray,
        goals: np.ndarray,
        holding: np.ndarray,
        momenta: Sequence[float] | np.ndarray = (),
    ) -> np.ndarray | None:
        """The best plan (thrusters and wheels, horizon) of the linearised problem; None if PIQP finds none.

        Args:
            plan: along which the motion is linearised.
            error: now, (6 or 12,).
            goals: now and after every period, (fields of a goal, horizon + 1).
            holding: commands that hold the craft at its goal, (thrusters and wheels,).
            momenta: of the wheels now, (wheels,) N m s.
        """
        # The program is of the change from the plan as it is flown.
        flown = np.array(self._flown(plan, error, goals)).ravel()
        values, matrix = self._linearised(flown, error, goals, ca.DM(momenta))
        values = np.array(values).ravel()
        slope = np.zeros(len(flown))
        slope[: plan.size] = np.tile(-self._effort * holding, self._count)
        slope[len(flown) - self._slacks :] = _VIOLATION
        answer, statistics = solution_of(
            self._solver,
            h=self._curved,
            g=self._curved @ flown + slope,
            a=matrix,
            lbx=self._low - flown,
            ubx=self._high - flown,
            lba=self._limits[0] - values,
            uba=self._limits[1] - values,
        )
        if not statistics["success"]:
            return None
        change = np.array(answer["x"])[: plan.size].reshape(plan.shape, order="F")
        # The interior point method leaves bounds a little.
        better = np.clip(plan + change, self._bounds, 1.0)
        if not self._slacks:
            return better

        def cost(candidate: np.ndarray) -> float:
            """Cost of a plan as it is flown, with what its margins lack, up to a constant."""
            x = np.array(self._flown(candidate, error, goals)).ravel()
            return float(0.5 * ca.bilin(self._curved, x, x)) + float(slope @ x)

        # Margins bend: of the way to the new plan that part is gone after which the flown plan costs least.
        return min((plan + fraction * (better - plan) for fraction in _SHARES), key=cost)

    def _curvature(self, craft: Spacecraft, regulator: Any) -> ca.DM:
        """Full thrust along the axis that takes it costs 1, as it does for the regulator.

        The force is the same along every axis, either way. Along a strong one it takes a small part of what the
        thrusters can: at the price of that part, thrust along the weak ones would not pay.
        """
        allocation = allocation_of(craft)
        force, _ = allocation.authority()
        axes = np.eye(craft.degrees_of_freedom)[: craft.dimension] * force
        full = allocation.commands(np.vstack([axes, -axes]))
        effort = 1.0 / float((full * full).sum(axis=1).max())
        # Of an error's entries: positions, angles, velocities and spins, in this order.
        size = craft.degrees_of_freedom
        entries = np.arange(2 * size).reshape(2, size)
        stage = np.zeros((2 * size, 2 * size))
        last = np.zeros((2 * size, 2 * size))
        for gains, weights in (
            (regulator.translation, entries[:, : craft.dimension]),
            (regulator.rotation, entries[:, craft.dimension :]),
        ):
            own = np.ix_(weights.ravel(), weights.ravel())
            stage[own] = np.diag(np.repeat(gains.price, weights.shape[1]))
            last[own] = gains.cost_to_go
        stage = ca.sparsify(ca.DM(stage))
        last = ca.sparsify(ca.DM(last))
        efforts = np.repeat(
            [effort, effort * _WHEEL_EFFORT], [self._nozzles - self._wheels, self._wheels]
        )
        return 2.0 * ca.diagcat(
            ca.diag(ca.DM(np.tile(efforts, self._count))), *[stage] * (self._count - 1), last
        )


def _step(craft: Spacecraft, period: float, like: State, drift: Drift) -> ca.Function:
    """The engines' motion over one control period: (error, command, goal, goal after it) to the error after it.

    Commands are shares of full force, in which the motion is smooth: a shared supply is linear while their sum
    stays within 1, and the least level of a throttle is left to the rounding, since at no thrust it has no slope.
    One integration step is off by 0.2 mm after the 4 s of a plan.
    """
    body = Body.of(craft)
    goal = map_leaves(lambda _: ca.SX.sym("g"), like)
    later = map_leaves(lambda _: ca.SX.sym("l"), like)
    e = [ca.SX.sym("e") for _ in range(2 * craft.degrees_of_freedom)]
    u = [ca.SX.sym("u") for _ in _wrenches(craft)]
    pushed = wrench_of(ca.vertsplit(ca.DM(_wrenches(craft).T) @ ca.vertcat(*u)))
    after = advance(around(goal, e), pushed, body, period, drift=drift)
    columns = [
        ca.vertcat(*x) for x in (e, u, leaves(goal), leaves(later), coordinates(after, later))
    ]
    return ca.Function("step", columns[:4], columns[4:])


def _wrenches(craft: Spacecraft) -> np.ndarray:
    """(thrusters and wheels, 3 or 6) wrench of each command of 1, N and N m."""
    wheels = np.zeros((craft.wheel_count, craft.degrees_of_freedom))
    if craft.wheels:
        wheels[:, craft.dimension :] = craft.wheel_map
    return np.vstack([craft.wrenches, wheels])


def _margins(craft: Spacecraft, task: Task, like: State) -> ca.Function | None:
    """Margins of the task's constraints: (error, goal) to the margins; None without constraints."""
    start = scenario(task, craft.dimension, seed=0, episode=0).start
    of_states = path_margins(task, start, like)
    if of_states is None:
        return None
    goal: Any = map_leaves(lambda _: ca.SX.sym("g"), like)
    e = ca.SX.sym("e", 2 * craft.degrees_of_freedom)
    columns = ca.vertcat(*leaves(goal))
    state = ca.vertcat(*leaves(around(goal, ca.vertsplit(e))))
    return ca.Function("margins", [e, columns], [of_states(state, columns)])


def shortest(state: State, goal: State) -> np.ndarray:
    """The coordinates whose rotation is at most half a turn, (6 or 12, N), of states of arrays (N,)."""
    turn = rotation_vector(goal.attitude.to(state.attitude))
    p, v = (np.array(leaves(a - b)) for a, b in ((state.p, goal.p), (state.v, goal.v)))
    return np.concatenate([p, turn, v, np.array(state.spin()) - np.array(goal.spin())])
