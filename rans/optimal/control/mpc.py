"""Model predictive control: what an agent must be compared with where constraints and turning matter.

Errors are minimal coordinates of a state around a goal, 6 in the plane, 12 in space: p - p_goal in W, the
rotation vector of R_goal^T R, v - v_goal in W and w - w_goal in B; SI units. Unlike a quaternion's entries
they are independent, which curvature matrices and linear dynamics ask for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rans.errors import Late, checked, whole
from rans.flight import Controller
from rans.model.body import Body
from rans.model.coordinates import around, coordinates
from rans.model.drift import Drift
from rans.model.dynamics import State, advance, wrench_of
from rans.model.fields import (
    Heading,
    Quat,
    Vec3,
    leaves,
    map_leaves,
)
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.optimal.control.dead_thrusters import expecting_dead
from rans.optimal.control.regulator import (
    Deadband,
    ModelBased,
    Regulator,
    Weights,
)
from rans.optimal.solver import solution_of
from rans.optimal.trajectory.allocation import Allocation, rounding
from rans.optimal.trajectory.arrival import path_margins
from rans.optimal.trajectory.guess import rotation_vector
from rans.randomization.conditions import Conditions
from rans.scenario import scenario
from rans.tasks.base import Task
from rans.tasks.derived import goal_stands_still

if TYPE_CHECKING:
    import casadi as ca
else:
    ca = Late("casadi")


@dataclass(frozen=True)
class MPCSettings:
    """How an MPC looks ahead.

    Raises:
        ConfigError: a value is not a positive whole number.
    """

    horizon: int = 20
    """Control periods that are planned; 30 settle no sooner at 5 Hz and cost 1.4 times the time."""
    iterations: int = 1
    """Quadratic programs a control period; each starts from the plan of the one before."""

    def __post_init__(self) -> None:
        for key in ("horizon", "iterations"):
            whole(f"MPC: {key}", getattr(self, key))


_WEIGHTS = Weights()
_DEADBAND = Deadband()
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


class MPC(ModelBased):
    """Plans the relaxed commands of the next seconds at every step and rounds the first to on/off.

    >>> from rans.optimal.control.mpc import MPCSettings
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
    tunable: ClassVar = {**Weights.tunable, **Deadband.tunable, "settings.horizon": (10, 40)}
    """Bounds for `rans tune`."""
    slow = True
    """Many episodes are flown by many processes."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        weights: Weights = _WEIGHTS,
        deadband: Deadband = _DEADBAND,
        settings: MPCSettings = _SETTINGS,
    ) -> None:
        super().__init__(craft, task, timing)
        craft = self._craft
        task = self._task
        timing = self._timing
        self._weights = weights
        self._deadband = checked("deadband", deadband, Deadband)
        self._settings = checked("settings", settings, MPCSettings)
        # The craft's means, and the regulator whose price continues the horizon.
        self._wrenches = _wrenches(craft)
        self._wheels = craft.wheel_count
        self._tank = craft.propellant is not None
        self._allocation = Allocation(craft)
        self._identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._regulator = Regulator.of(craft, task, timing, weights)
        self._rounding = rounding(craft, timing.control_period, self._regulator.carried(craft))
        # The quadratic program, of a step of the motion and of the margins of constraints.
        like = scenario(task, craft.dimension, seed=0, episode=0).goal
        step = _step(craft, timing.control_period, like, task.drift)
        margins = _margins(craft, task, like)
        self._program = _Program(
            craft, self._regulator, step, settings.horizon, timing.control_period, margins
        )
        self._plans = np.zeros((0, len(self._wrenches), settings.horizon))
        self.failures = 0
        """Quadratic programs since `reset` that PIQP did not solve: the plan before was flown on."""

    def expecting(self, conditions: Conditions | None) -> Controller:
        """This controller without the thrusters that are dead from the start in every episode of the conditions.

        Where the others cannot push and turn the craft in every direction, it flies as if none were dead.
        """
        return expecting_dead(
            self,
            conditions,
            lambda craft: MPC(
                craft, self._task, self._timing, self._weights, self._deadband, self._settings
            ),
        )

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._rounding.reset(count)
        self._plans = np.zeros((count, *self._plans.shape[1:]))
        self.failures = 0

    def memory(self) -> np.ndarray:
        """What is owed to every episode and its plan, (N, ...); see `recall`."""
        debt = self._rounding.owed
        width = math.prod(self._plans.shape[1:])
        return np.column_stack([debt, self._plans.reshape(len(debt), width)])

    def recall(self, memory: np.ndarray) -> None:
        """Go on from a `memory`, of as many episodes as it has."""
        size = self._rounding.owed.shape[1]
        self._rounding.owed = memory[:, :size]
        self._plans = memory[:, size:].reshape(len(memory), *self._plans.shape[1:]).copy()

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the state, not at the observation."""
        period = self._timing.control_period
        rest = self._deadband.holds(self._craft, self._task, state, goal, period=period)
        return self._rounding.round(self._planned(state, goal, rest), rest, state.stores)

    def _planned(self, state: Any, goal: Any, rest: np.ndarray) -> np.ndarray:
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
        for k in np.repeat(np.flatnonzero(~rest), self._settings.iterations):
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

        The solver's parameters have fields of a goal in the order of `rans.fields.leaves`.
        """
        period = self._timing.control_period
        horizon = self._settings.horizon
        size = np.shape(state.p.columns()[0])

        def column(time: float) -> list[np.ndarray]:
            goal_then = self._task.later(goal, time)
            return [np.broadcast_to(x, size) for x in leaves(goal_then)]

        now: Any = column(0.0)
        if goal_stands_still(self._task):
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
        regulator: Regulator,
        step: ca.Function,
        horizon: int,
        period: float,
        margins: ca.Function | None = None,
    ) -> None:
        """Make the program once: its matrices do not depend on states, only vectors change between solutions."""
        thrusters = craft.thruster_count
        self._wheels = craft.wheel_count
        self._nozzles = thrusters + self._wheels
        self._count = horizon
        self._size = 2 * craft.degrees_of_freedom
        commands = horizon * self._nozzles
        errors = horizon * self._size
        self._linearised = self._linearisation(step)
        curvature = self._curvature(craft, regulator)
        self._effort = float(curvature[0, 0])
        rows = horizon if craft.thrust_sharing == "split" else 0
        sums = ca.kron(  # of the commands of a period
            ca.DM.eye(rows), ca.horzcat(ca.DM.ones(1, thrusters), ca.DM(1, self._wheels))
        )
        self._sharing = ca.horzcat(sums, ca.DM(rows, commands + errors - sums.size2()))
        self._momenta = np.array([wheel.max_momentum for wheel in craft.wheels])
        changes = np.array([wheel.max_torque * period for wheel in craft.wheels])
        of_wheels = ca.horzcat(ca.DM(self._wheels, thrusters), ca.diag(ca.DM(changes)))
        summed = ca.kron(ca.DM(np.tril(np.ones((horizon, horizon)))), of_wheels)
        self._spun = ca.sparsify(ca.horzcat(summed, ca.DM(summed.size1(), errors)))
        self._bounds = np.repeat([[0.0], [-1.0]], [thrusters, self._wheels], axis=0)
        limits = ca.vertcat(
            self._linearised.sparsity_out(1), self._sharing.sparsity(), self._spun.sparsity()
        )

        # Constraints have a slack each, after commands and errors.
        self._margins = None if margins is None else self._margin_rows(margins)
        self._missing = None if margins is None else self._lacking(margins)
        self._slacks = 0 if self._margins is None else self._margins.size1_out(0)
        if self._margins is not None:
            limits = ca.diagcat(limits, ca.Sparsity(0, self._slacks))
            limits = ca.vertcat(limits, self._margins.sparsity_out(1))
            curvature = ca.diagcat(curvature, ca.DM(self._slacks, self._slacks))

        self._solver = ca.conic(
            "plan",
            "piqp",
            {"h": curvature.sparsity(), "a": limits},
            {"error_on_fail": False, "print_time": False},
        )
        counts = [commands, errors, self._slacks]
        self._fixed = {
            "h": curvature,
            "lbx": np.concatenate(
                [np.tile(self._bounds[:, 0], horizon), np.repeat([-np.inf, 0.0], counts[1:])]
            ),
            "ubx": np.repeat([1.0, np.inf, np.inf], counts),
        }

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
        flown, matrix = self._linearised(error, plan, goals)
        slope = np.zeros(self._fixed["lbx"].shape)
        slope[: plan.size] = np.tile(-self._effort * holding, self._count)
        joined = matrix @ ca.vertcat(ca.vec(ca.DM(plan)), ca.vec(flown))
        sums = self._sharing.size1()
        free, full = (
            np.tile(sign * self._momenta - np.asarray(momenta), self._count) for sign in (-1.0, 1.0)
        )
        low = ca.vertcat(joined, -ca.inf * ca.DM.ones(sums), ca.DM(free))
        high = ca.vertcat(joined, ca.DM.ones(sums), ca.DM(full))
        limits = ca.vertcat(matrix, self._sharing, self._spun)
        if self._margins is not None:
            least, by_variables = self._margins(flown, goals)
            slope[-self._slacks :] = _VIOLATION
            limits = ca.vertcat(
                ca.horzcat(limits, ca.DM(limits.size1(), self._slacks)), by_variables
            )
            low = ca.vertcat(low, least)
            high = ca.vertcat(high, ca.inf * ca.DM.ones(self._slacks))
        answer, statistics = solution_of(
            self._solver, **self._fixed, g=slope, a=limits, lba=low, uba=high
        )
        if not statistics["success"]:
            return None
        commands = np.array(answer["x"])[: plan.size].reshape(plan.shape, order="F")
        better = np.clip(
            commands, self._bounds, 1.0
        )  # the interior point method leaves bounds a little
        if self._missing is None:
            return better
        # Margins bend: of the way to the new plan that part is gone after which the flown plan costs least.
        tried = [plan + fraction * (better - plan) for fraction in _SHARES]
        return min(
            tried, key=lambda candidate: self._cost(candidate, error, goals, slope[: plan.size])
        )

    def _cost(self, plan: np.ndarray, error: np.ndarray, goals: np.ndarray, slope: Any) -> float:
        """Cost (a number) of a plan (nozzles, horizon) as it is flown, with what its margins lack.

        Constants of the quadratic cost are left out, so that only differences of it count.
        """
        assert self._missing is not None
        flown, _ = self._linearised(error, plan, goals)
        variables = ca.vertcat(ca.vec(ca.DM(plan)), ca.vec(flown))
        size = variables.size1()
        curvature = self._fixed["h"][:size, :size]
        missing = self._missing(flown, goals)
        commands = plan.ravel(order="F")
        cost = 0.5 * ca.bilin(curvature, variables, variables) + _VIOLATION * missing
        return float(cost) + float(slope @ commands)

    def _linearisation(self, step: ca.Function) -> ca.Function:
        """(first error, plan, goals) to the errors along it and the matrix of e_k+1 - A_k e_k - B_k u_k.

        Its columns are u_0 .. u_T-1, then e_1 .. e_T, and its rows k = 0 .. T-1, of the size of an error each. The
        first error is no variable, so that rows of k = 0 are e_1 - B_0 u_0.
        """
        error = ca.MX.sym("error", self._size)
        goals = ca.MX.sym("goals", step.size1_in(2), self._count + 1)
        now, later = goals[:, :-1], goals[:, 1:]
        plan = ca.MX.sym("plan", self._nozzles, self._count)
        flown = step.mapaccum(self._count)(error, plan, now, later)
        before = ca.horzcat(error, flown[:, :-1])
        x, u, g, h = (ca.SX.sym(n, step.size1_in(i)) for i, n in enumerate("xugh"))
        after = step(x, u, g, h)
        gradient = ca.Function(
            "gradient", [x, u, g, h], [ca.jacobian(after, x), ca.jacobian(after, u)]
        )
        by_error, by_command = gradient.map(self._count)(before, plan, now, later)
        _, *others = ca.horzsplit(by_error, self._size)
        from_before = ca.diagcat(
            ca.MX(self._size, 0), *others, ca.MX(0, self._size)
        )  # one block lower
        matrix = ca.horzcat(
            -ca.diagcat(*ca.horzsplit(by_command, self._nozzles)),
            ca.MX.eye(from_before.size1()) - from_before,
        )
        return ca.Function("linearised", [error, plan, goals], [flown, matrix])

    def _margin_rows(self, margins: ca.Function) -> ca.Function:
        """(errors along the plan, goals) to least values of, and the matrix of, G_k e_k + s_k.

        The last columns are slacks, one a margin, at the price `_VIOLATION`: a plan exists always.
        """
        flown = ca.MX.sym("flown", self._size, self._count)
        goals = ca.MX.sym("goals", margins.size1_in(1), self._count + 1)
        e, g = (ca.SX.sym(n, margins.size1_in(i)) for i, n in enumerate("eg"))
        value = margins(e, g)
        slope = ca.jacobian(value, e)
        linearized = ca.Function("one", [e, g], [_RESERVE - value + slope @ e, slope])
        least, slopes = linearized.map(self._count)(flown, goals[:, 1:])
        by_errors = ca.diagcat(*ca.horzsplit(slopes, self._size))
        matrix = ca.horzcat(
            ca.MX(by_errors.size1(), self._nozzles * self._count),
            by_errors,
            ca.MX.eye(by_errors.size1()),
        )
        return ca.Function("margins", [flown, goals], [ca.vec(least), matrix])

    def _lacking(self, margins: ca.Function) -> ca.Function:
        """(errors along the plan, goals) to the sum of what margins lack."""
        flown = ca.MX.sym("flown", self._size, self._count)
        goals = ca.MX.sym("goals", margins.size1_in(1), self._count + 1)
        value = margins.map(self._count)(flown, goals[:, 1:])
        return ca.Function(
            "lacking", [flown, goals], [ca.sum1(ca.fmax(_RESERVE - ca.vec(value), 0.0))]
        )

    def _curvature(self, craft: Spacecraft, regulator: Regulator) -> ca.DM:
        """Full thrust along the axis that takes it costs 1, as it does for the regulator.

        The force is the same along every axis, either way. Along a strong one it takes a small part of what the
        thrusters can: at the price of that part, thrust along the weak ones would not pay.
        """
        allocation = Allocation(craft)
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
    pushed = wrench_of(craft, u[craft.thruster_commands], None)
    if craft.wheels:
        wheel_torque = ca.DM(np.array(craft.wheel_map).T) @ ca.vertcat(*u[craft.thruster_count :])
        torque = Vec3(*ca.vertsplit(wheel_torque)) if craft.dimension == 3 else wheel_torque
        pushed = replace(pushed, torque=pushed.torque + torque)
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
