"""Optimal trajectories by direct multiple shooting, on the equations and the task of the engines.

The on/off command of each control period is relaxed to a constant between 0 and 1. What comes out is
a local optimum of the relaxed problem: a mark to measure controllers against, and no controller.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.extend import (
    Body,
    ConfigError,
    Drift,
    Spacecraft,
    State,
    Task,
    Vec2,
    Vec3,
    Wrench,
    advance,
    aims,
    leaves,
    map_leaves,
    scenario,
    unflatten,
)
from rans_optimal.arrival import (
    LEAST_MARGIN,
    ROUNDINGS,
    Arrival,
    goal_motion,
    path_margins,
)
from rans_optimal.checks import check_craft, check_task, moves_goal
from rans_optimal.guess import allocation_of, guess, needed_wrenches, transfer_time
from rans_optimal.objectives import MinimumTime, Objective, SymbolicTrajectory
from rans_optimal.solver import ca, solution_of

_OPTIONS = {
    "expand": True,
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": 500,
    "ipopt.min_refinement_steps": 0,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
}
"""IPOPT on scalar graphs: the most robust of the solvers tried on these problems. A solvable one takes
20 to 60 iterations, so 500 are only spent in vain. Their numbers are all about one, so their
linear systems need no scaling and seldom a refinement, which saves a seventh of the time."""
_NODES = 4
"""Nodes of the quadrature in the plane: 1e-11 of the thrust's effect is lost in a period (see
`rans.model.dynamics.NODES`), which is less than the solver leaves open."""
_OPENED = 0.03
"""Share by which every thruster is opened beyond what the guessed motion takes: interior point methods
start away from bounds: of 0.03, 0.1 and 0.3 the fastest."""
START_IS_GOAL = "Start_Is_Goal"
"""Status of a trajectory of no length."""
_SOLVED = 1e-8
"""What the solver leaves open of a constraint (IPOPT's ``tol``)."""
_SAME = 1e-4
"""Relative difference of costs up to which they are of one optimum: a hundred times what the solver leaves open."""
_COMMAND_GUESS = 0.3
"""Guess of every command where thrusters cannot give a wanted wrench."""


@dataclass(frozen=True)
class Trajectory:
    """Trajectory that the optimiser ended with, solved or not."""

    objective: str
    """Name of the objective."""
    status: str
    """The solver's word for how it ended, "Solve_Succeeded" when all went well."""
    solved: bool
    cost: float
    """In the objective's unit; NaN where nothing was solved."""
    states: Any
    """`State` whose fields are float64 arrays (T + 1,); headings are not wrapped."""
    commands: np.ndarray
    """(T, thrusters), 0 to 1."""
    control_period: float
    """s; 0 where the start is the goal of a least time."""
    iterations: int
    """Iterations of all attempts together."""
    seconds: float
    """Wall time of all attempts together."""
    attempts: int = 1
    """Guesses that were started from."""
    agreeing: int = 1
    """Guesses that led to this cost."""
    optima: int = 1
    """Local optima of different costs that the guesses led to."""


def usual_guesses(craft: Spacecraft, task: Task, objective: Objective) -> int:
    """Guesses to start from where nobody says how many.

    1, but 3 for least times with an attitude or a spin to reach in space, and for tasks that leave the attitude
    free, in space 5. See `rans_optimal.guess.guess`: the fastest turns are about no fixed axis, and from
    one guess the least time of tracking a velocity may be a third too long, where the start is midway between two
    attitudes from which the craft pushes hardest.
    """
    if not {"attitude", "spin"} & aims(task):
        return 3 if craft.dimension == 2 else 5
    return 3 if craft.dimension == 3 and isinstance(objective, MinimumTime) else 1


def at_once(objective: Objective, craft: Spacecraft, start: State) -> Trajectory:
    """The least time from a start that is the goal: none, in control periods of no length.

    Callers read its length and states like those of any other trajectory.
    """
    count = objective.intervals
    return Trajectory(
        objective=objective.name,
        status=START_IS_GOAL,
        solved=True,
        cost=0.0,
        states=map_leaves(lambda x: np.full(count + 1, float(x)), start),
        commands=np.zeros((count, craft.command_count)),
        control_period=0.0,
        iterations=0,
        seconds=0.0,
    )


def unsolved(objective: Objective, craft: Spacecraft, start: State, status: str) -> Trajectory:
    """A trajectory of NaN, for a problem whose solver never answered.

    Its arrays have the shapes of a solved one, so that tables of starts stay rectangular.
    """
    nothing = np.full((objective.intervals + 1, craft.command_count), np.nan)
    return Trajectory(
        objective=objective.name,
        status=status,
        solved=False,
        cost=math.nan,
        states=map_leaves(lambda _: nothing[:, 0], start),
        commands=nothing[1:],
        control_period=math.nan,
        iterations=0,
        seconds=0.0,
        attempts=0,
        agreeing=0,
        optima=0,
    )


def _best(result: Sequence[Trajectory]) -> Trajectory:
    """The cheapest of those solved, with the iterations and the time of all."""
    best = min(result, key=lambda attempt: (not attempt.solved, attempt.cost))
    return replace(
        best,
        iterations=sum(solution.iterations for solution in result),
        seconds=sum(solution.seconds for solution in result),
    )


def _compared(attempts: Sequence[Trajectory]) -> Trajectory:
    """The best, with how many led to its cost and how many costs there are."""
    costs = sorted(attempt.cost for attempt in attempts if attempt.solved)
    gaps = [b - a > _SAME * max(abs(a), abs(b)) for a, b in itertools.pairwise(costs)]
    agreeing = gaps.index(True) + 1 if any(gaps) else len(costs)
    optima = sum(gaps) + 1 if costs else 0
    return replace(_best(attempts), attempts=len(attempts), agreeing=agreeing, optima=optima)


class Transcription:
    """One kind of problem for one spacecraft and task, ready to be solved from any start.

    The trajectory starts in the given state and ends as the objective says, see `Arrival`, where the goal is
    then (`rans.tasks.base.Task.later`). The margins of the task's constraints are not negative at the instants
    of every control period that its timing names (`Timing.checks`);
    between two of them nothing is asked. Where thrust is shared ("split") the commands' sum is kept within 1,
    where sharing is linear: any wrench the supply can give has such commands.

    Each period's wrench is a variable of its own, tied to the commands by a linear constraint: the motion
    is then differentiated in 3 or 6 directions instead of one per thruster, which in space takes the
    Hessian a third of the operations.

    One integration step a control period (`rans.model.dynamics.advance`) is exact in the plane and of order
    six in space, which a replay in Drake shows to be enough. Points drift as the task says.

    Raises:
        ConfigError: see `Arrival`; or the task asks a craft to turn that cannot.
    """

    def __init__(
        self,
        craft: Spacecraft,
        task: Task,
        objective: Objective,
    ) -> None:
        check_craft(craft)
        check_task(craft, task)
        self._craft = craft
        self._task = task
        self._objective = objective
        example = scenario(task, craft.dimension, seed=0, episode=0)
        self._like = example.start
        self._aims = aims(task)
        self._arrival = Arrival(task, example.goal, objective.ending)
        self._later = goal_motion(task, example.goal) if moves_goal(task) else None
        self._margins = path_margins(task, example.start, example.goal)
        self._checks = task.timing.checks
        self._wrenches = craft.wrenches.T
        self._step = _step(craft, example.start, task.drift)
        self._low, self._high = np.array(
            [(command.low, command.high) for command in craft.commands]
        ).T[:, :, None]
        self._allocation = None
        with contextlib.suppress(ConfigError):  # thrusters that cannot give every wrench
            self._allocation = allocation_of(craft)
        self._rows = (craft.thruster_count, len(self._wrenches), len(leaves(self._like)))
        self._build(len(leaves(example.goal)))

    def _build(self, goal_width: int) -> None:
        """Variables: (commands, wrench, state after) of every interval, then the control period.

        Constraints, with their bounds: intervals join, wrenches are the commands', arrival, with shared thrust the
        sums of commands, and margins of the task's constraints. Sets the functions and sizes that all other methods
        read, in this order of variables.
        """
        # Symbols of the variables and parameters.
        count = self._objective.intervals
        (nozzles, forces, width) = self._rows
        variables = ca.MX.sym("variables", count * sum(self._rows) + 1)
        start = ca.MX.sym("start", width)
        goal = ca.MX.sym("goal", goal_width)
        table = ca.reshape(variables[:-1], sum(self._rows), count)
        period = variables[-1]
        if self._objective.control_period is not None:  # a constant is differentiated faster
            period = self._objective.control_period
        commands, applied, after = ca.vertsplit(
            table, [0, nozzles, nozzles + forces, sum(self._rows)]
        )
        goals = ca.repmat(goal, 1, count)
        if self._later is not None:
            times = period * ca.DM(range(1, count + 1)).T
            goals = self._later.map(count)(goals, times)
        # Constraints.
        gaps = after - self._step.map(count)(ca.horzcat(start, after[:, :-1]), applied, period)
        arrival = self._arrival
        constraints = [
            (gaps, 0.0, 0.0),
            (ca.DM(self._wrenches) @ commands - applied, 0.0, 0.0),
            (arrival.conditions(after[:, -1], goals[:, -1]), arrival.low, arrival.high),
        ]
        if self._craft.thrust_sharing == "split":
            constraints.append((ca.sum1(commands), 0.0, 1.0))
        if self._margins is not None:
            # At every check of every interval, of which the last is its end.
            margins = self._margins.map(count)
            before = ca.horzcat(start, after[:, :-1])
            for check in range(1, self._checks):
                fraction = check / self._checks
                state = self._step.map(count)(before, applied, fraction * period)
                goal_then = goals
                if self._later is not None:
                    instants = period * (ca.DM(range(count)).T + fraction)
                    goal_then = self._later.map(count)(ca.repmat(goal, 1, count), instants)
                constraints.append((margins(state, goal_then), LEAST_MARGIN, np.inf))
            constraints.append((margins(after, goals), LEAST_MARGIN, np.inf))
        self._limits = {
            name: np.concatenate(
                [np.zeros(row.numel()) + bounds[side] for row, *bounds in constraints]
            )
            for side, name in enumerate(("lbg", "ubg"))
        }
        # Cost, whose corners are rounded by a parameter for the solver.
        corner = ca.MX.sym("corner")
        path = SymbolicTrajectory(
            self._craft, self._task, start, after, commands, period, goals, corner
        )
        cost = self._objective.cost(path)
        problem = {
            "x": variables,
            "p": ca.vertcat(start, goal, corner),
            "f": cost,
            "g": ca.vertcat(*(ca.vec(row) for row, _, _ in constraints)),
        }
        self._corners = ROUNDINGS if ca.depends_on(cost, corner) else ROUNDINGS[:1]
        self._solver = ca.nlpsol("trajectory", "ipopt", problem, _OPTIONS)
        exact = self._objective.cost(replace(path, corner=None))
        self._cost = ca.Function("cost", [variables, start, goal], [exact])

    def solve(self, start: State, goal: State, guesses: int = 1) -> Trajectory:
        """The best local optimum from some guesses.

        Where none of them (`rans_optimal.guess.guess`) leads to one, one more is tried. Start and
        goal are of floats. The status says whether the solver succeeded: nothing is raised for a problem
        without a solution.

        Raises:
            ConfigError: there are no guesses, or for least time the thrusters cannot push the spacecraft in
                every direction.
        """
        if guesses < 1:
            raise ConfigError(f"the optimiser needs at least one guess, got {guesses}.")
        if not np.isfinite([*leaves(start), *leaves(goal)]).all():
            return unsolved(self._objective, self._craft, start, "Invalid_Number_Detected")
        if self._objective.control_period is None and self._is_there(start, goal):
            return at_once(self._objective, self._craft, start)
        attempts = [self.attempt(start, goal, number) for number in range(guesses)]
        if not any(attempt.solved for attempt in attempts):
            attempts.append(self.attempt(start, goal, guesses))
        return _compared(attempts)

    def _is_there(self, start: State, goal: State) -> bool:
        """Whether a start fulfils the conditions of the arrival, as closely as the solver does."""
        gaps = np.array(self._arrival.conditions(leaves(start), leaves(goal))).ravel()
        excess = np.maximum(self._arrival.low - gaps, gaps - self._arrival.high)
        return bool((excess <= _SOLVED).all())

    def attempt(self, start: State, goal: State, number: int) -> Trajectory:
        """From one guess; what has corners is solved again with sharper ones, from the answer before.

        Only the first corner begins from the guess. The result is the best of those that were solved.
        """
        problem = self._bounds_and_guess(start, goal, number)
        results = []
        for corner in self._corners:
            begun = time.perf_counter()
            parameters = [*leaves(start), *leaves(goal), corner]
            solution, statistics = solution_of(self._solver, p=parameters, **problem)
            seconds = time.perf_counter() - begun
            results.append(self._trajectory(solution, statistics, start, goal, seconds))
            if not results[-1].solved:
                break
            problem["x0"] = np.array(solution["x"]).ravel()
        return _best(results)

    def _trajectory(
        self,
        solution: dict[str, Any],
        statistics: dict[str, Any],
        start: State,
        goal: State,
        seconds: float,
    ) -> Trajectory:
        """The trajectory of a solution of the nonlinear program, whose variables are in the order of `_build`."""
        variables = np.array(solution["x"]).ravel()
        table = variables[:-1].reshape(self._objective.intervals, -1)
        (nozzles, forces, _) = self._rows
        states = unflatten(self._like, np.vstack([leaves(start), table[:, nozzles + forces :]]).T)
        # Interior point methods leave bounds by up to 1e-8.
        commands = np.clip(table[:, :nozzles], self._low.T, self._high.T)
        success = statistics["success"]
        cost = float(self._cost(variables, leaves(start), leaves(goal))) if success else math.nan
        return Trajectory(
            objective=self._objective.name,
            status=statistics["return_status"],
            solved=success,
            cost=cost,
            states=states,
            commands=commands,
            control_period=float(variables[-1]),
            iterations=statistics["iter_count"],
            seconds=seconds,
        )

    def _bounds_and_guess(self, start: State, goal: State, number: int) -> dict[str, np.ndarray]:
        """Guess x0 and bounds of variables (lbx, ubx) and constraints (lbg, ubg), as arguments of the solver.

        Variables are in the order of `_build`: commands, wrench and state after of the first interval, then those
        of the next, and at last the control period.

        Args:
            start: of floats.
            goal: of floats.
            number: of the guess.
        """
        count = self._objective.intervals
        (_, forces, width) = self._rows
        fixed = self._objective.control_period
        if fixed is None:
            period = transfer_time(self._craft, self._aims, start, goal) / count
            # Without bounds the optimiser can wander to zero.
            shortest, longest = 0.1 * period, 10.0 * period
        else:
            period = shortest = longest = fixed
        states = self._guess(start, goal, count, period, number)
        command = self._commands(start, states, period)

        def pack(
            command: np.ndarray, applied: np.ndarray, state: np.ndarray, period: float
        ) -> np.ndarray:
            return np.append(np.vstack([command, applied, state]).T, period)

        free = np.full((width, count), np.inf)
        unbound = np.full((forces, count), np.inf)
        return {
            "x0": pack(command, self._wrenches @ command, states, period),
            "lbx": pack(0.0 * command + self._low, -unbound, -free, shortest),
            "ubx": pack(0.0 * command + self._high, unbound, free, longest),
            **self._limits,
        }

    def _guess(
        self, start: State, goal: State, count: int, period: float, number: int
    ) -> np.ndarray:
        """Arrives at the end, where the goal is then; where no end is prescribed, soon, and then moves on.

        States are (leaves, count).
        """
        moving = count
        if self._objective.ending == "free":
            moving = min(
                count, math.ceil(transfer_time(self._craft, self._aims, start, goal) / period)
            )
        aim = self._task.later(goal, moving * period) if self._later is not None else goal
        path = guess(self._aims, start, aim, moving * period, moving, number)
        if moving == count:
            return path
        arrived = unflatten(start, path[:, -1])
        return np.hstack(
            [path, guess((), arrived, arrived, (count - moving) * period, count - moving)]
        )

    def _commands(self, start: State, states: np.ndarray, period: float) -> np.ndarray:
        """(thrusters, T) about what a guessed motion (leaves, T) takes, away from the bounds."""
        if self._allocation is None:
            openings = np.full((self._rows[0], states.shape[1]), _COMMAND_GUESS)
            return self._low + (self._high - self._low) * openings
        wrenches = needed_wrenches(
            self._craft, unflatten(start, np.column_stack([leaves(start), states])), period
        )
        return np.clip(self._allocation.commands(wrenches).T + _OPENED, _OPENED, 1.0 - _OPENED)


def _step(craft: Spacecraft, like: State, drift: Drift) -> ca.Function:
    """The engines' motion over one control period: (state, wrench on B, period) to the state after.

    One substep a period, of `_NODES` nodes: `Trajectory.replay_error` says what that leaves out.
    """
    state: Any = map_leaves(lambda _: ca.SX.sym("s"), like)
    period, *parts = [ca.SX.sym("s") for _ in range(1 + craft.degrees_of_freedom)]
    after = advance(state, wrench_of(parts), Body.of(craft), period, 1, _NODES, drift=drift)
    columns = [ca.vertcat(*x) for x in (leaves(state), parts, leaves(after))]
    return ca.Function("step", [columns[0], columns[1], period], [columns[2]])


def wrench_of(parts: Sequence[Any]) -> Wrench:
    """The wrench on B of its 3 or 6 numbers, N and N m."""
    if len(parts) == 3:
        return Wrench(Vec2(*parts[:2]), parts[2])
    return Wrench(Vec3(*parts[:3]), Vec3(*parts[3:]))
