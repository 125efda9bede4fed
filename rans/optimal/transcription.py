"""Optimal trajectories by direct multiple shooting, on the equations and the task of the engines.

The on/off command of each control period is relaxed to a constant between 0 and 1. What comes out is
a local optimum of the relaxed problem: a mark to measure controllers against, and no controller.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from rans.dynamics import MassProperties, State, advance, wrench
from rans.fields import leaves, map_leaves, unflatten
from rans.optimal.guess import rest_to_rest
from rans.optimal.objectives import Objective
from rans.scenario import scenario
from rans.spacecraft import Spacecraft
from rans.tasks.base import Task

_OPTIONS = {"expand": True, "print_time": False, "error_on_fail": False, "show_eval_warnings": False,
            "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 500}
"""IPOPT on scalar graphs: the most robust of the solvers tried on these problems. A solvable one takes
20 to 60 iterations, so 500 are only spent in vain."""

_FIRST_COMMAND = 0.3
"""Guess of every command: of 0.02, 0.05, 0.1, 0.3 and 0.5 the one that takes fewest iterations."""

_BRANCH = 0.5
"""How far a redundant arrival condition may be off its target, see `_Arrival`: cosines of the wanted
and the opposite attitude differ by 2."""


@dataclass(frozen=True)
class Trajectory:
    """What the optimiser ended with, solved or not."""

    objective: str
    """Name of the objective."""
    status: str
    """The solver's word for how it ended, "Solve_Succeeded" when all went well."""
    solved: bool
    cost: float
    """N s or s, as the objective says."""
    states: Any
    """`State` whose fields are float64 arrays (T + 1,); headings are not wrapped."""
    commands: np.ndarray
    """(T, thrusters), 0 to 1."""
    control_period: float
    """s."""
    iterations: int
    """Of all attempts together."""
    seconds: float
    """Wall time of all attempts together."""


def unsolved(objective: Objective, craft: Spacecraft, start: State, status: str) -> Trajectory:
    """A trajectory of NaN, for a problem whose solver never answered."""
    def nothing(*shape: int) -> np.ndarray:
        return np.full(shape, np.nan)

    count = objective.intervals
    states = map_leaves(lambda _: nothing(count + 1), start)
    return Trajectory(objective.name, status, False, math.nan, states,
                      nothing(count, len(craft.thrusters)), math.nan, 0, 0.0)


class Transcription:
    """One kind of problem for one spacecraft and task, ready to be solved from any start.

    The trajectory starts in the given state and arrives at rest with the task's residual at its
    target. Where thrust is shared ("split") the commands' sum is kept within 1, where sharing is
    linear: any wrench the supply can give has such commands.

    Args:
        craft: what flies.
        task: its residual and residual target say where to arrive.
        objective: what to minimise.
        substeps: integration steps a control period, see `rans.dynamics.advance`. In the plane one
            is exact; in space one is off by less than a millimetre over a smooth optimal trajectory,
            which a replay in Drake shows, and takes a third of the time of two.
    """

    def __init__(self, craft: Spacecraft, task: Task, objective: Objective, substeps: int = 1) -> None:
        self._craft, self._objective = craft, objective
        example = scenario(task, craft.dimension, seed=0, episode=0)
        self._like, self._arrival = example.start, _Arrival(task, example.goal)
        self._step = _step(craft, example.start, substeps)
        self._solver = self._build()

    def _build(self) -> ca.Function:
        """Variables: (command, state after it) of every interval, then the control period.

        Constraints: intervals join, arrival, and with shared thrust the sums of commands.
        """
        count, width = self._objective.intervals, len(leaves(self._like))
        nozzles = len(self._craft.thrusters)
        variables = ca.MX.sym("variables", count * (nozzles + width) + 1)  # type: ignore[arg-type]
        start, goal = ca.MX.sym("start", width), ca.MX.sym("goal", width)  # type: ignore[arg-type]
        table, period = ca.reshape(variables[:-1], nozzles + width, count), variables[-1]
        if self._objective.control_period is not None:  # a constant is differentiated faster
            period = self._objective.control_period
        commands, after = table[:nozzles, :], table[nozzles:, :]
        gaps = after - self._step.map(count)(ca.horzcat(start, after[:, :-1]), commands, period)
        constraints = [ca.vec(gaps), self._arrival.conditions(after[:, -1], goal)]
        if self._craft.thrust_sharing == "split":
            constraints.append(ca.sum1(commands).T)
        problem = {"x": variables, "p": ca.vertcat(start, goal), "g": ca.vertcat(*constraints),
                   "f": self._objective.cost(self._craft, commands, period)}
        return ca.nlpsol("trajectory", "ipopt", problem, _OPTIONS)

    def solve(self, start: State, goal: State) -> Trajectory:
        """The better of two local optima: guessed with the shortest turn, and the other way round.

        Args:
            start: of floats.
            goal: of floats, at rest.

        Returns:
            The trajectory; its status says whether the solver succeeded. Nothing is raised for a
            problem without a solution.
        """
        attempts = [self._attempt(start, goal, long_way) for long_way in (False, True)]
        best = min(attempts, key=lambda attempt: (not attempt.solved, attempt.cost))
        return replace(best, iterations=sum(a.iterations for a in attempts),
                       seconds=sum(a.seconds for a in attempts))

    def _attempt(self, start: State, goal: State, long_way: bool) -> Trajectory:
        begun = time.perf_counter()
        solution = self._solver(p=[*leaves(start), *leaves(goal)],
                                **self._bounds_and_guess(start, goal, long_way))
        statistics = self._solver.stats()
        states, commands, period = self._unpack(np.array(solution["x"]).ravel(), start)
        return Trajectory(self._objective.name, statistics["return_status"], statistics["success"],
                          float(solution["f"]), states, commands, period,
                          statistics["iter_count"], time.perf_counter() - begun)

    def _bounds_and_guess(self, start: State, goal: State, long_way: bool) -> dict[str, np.ndarray]:
        count, nozzles = self._objective.intervals, len(self._craft.thrusters)
        shortest, period, longest = self._objective.periods(self._craft, start, goal)
        states = rest_to_rest(start, goal, count * period, count, long_way)

        def pack(command: float, state: np.ndarray, period: float) -> np.ndarray:
            return np.append(np.vstack([np.full((nozzles, count), command), state]).T, period)

        free = np.full_like(states, np.inf)
        joined = np.zeros(states.size)
        sums = np.ones(count if self._craft.thrust_sharing == "split" else 0)
        return {
            "x0": pack(_FIRST_COMMAND, states, period),
            "lbx": pack(0.0, -free, shortest), "ubx": pack(1.0, free, longest),
            "lbg": np.concatenate([joined, self._arrival.low, 0.0 * sums]),
            "ubg": np.concatenate([joined, self._arrival.high, sums]),
        }

    def _unpack(self, variables: np.ndarray, start: State) -> tuple[State, np.ndarray, float]:
        nozzles = len(self._craft.thrusters)
        table = variables[:-1].reshape(self._objective.intervals, -1)
        rows = np.vstack([leaves(start), table[:, nozzles:]])
        # the interior point method leaves bounds by up to 1e-8
        return unflatten(self._like, rows.T), np.clip(table[:, :nozzles], 0.0, 1.0), float(variables[-1])


def _step(craft: Spacecraft, like: State, substeps: int) -> ca.Function:
    """The engines' motion over one control period: (state, command, period) to the state after."""
    linear = replace(craft, thrust_sharing="none")
    state = map_leaves(lambda _: ca.SX.sym("s"), like)  # type: ignore[call-arg]
    command = [ca.SX.sym("u") for _ in craft.thrusters]  # type: ignore[call-arg]
    period = ca.SX.sym("h")  # type: ignore[call-arg]
    body, applied = MassProperties.of(craft), wrench(linear, command)
    after = advance(state, applied, body, period, substeps)  # type: ignore[type-var]
    columns = [ca.vertcat(*x) for x in (leaves(state), command, leaves(after))]
    return ca.Function("step", [columns[0], columns[1], period], [columns[2]])


class _Arrival:
    """Conditions on the last state: the task's residual at its target, velocity and spin the goal's.

    A rotation's entries are more numbers than it has degrees of freedom, and equalities whose
    gradients depend on each other at the solution break the optimiser's assumptions (linear
    independence constraint qualification). So a largest independent set of conditions, judged at the
    goal, holds as equalities. They alone would also accept some opposite attitudes (sin = 0 at half a
    turn); the others, which follow from them near the goal, rule those out as wide bands.
    """

    def __init__(self, task: Task, goal: State) -> None:
        state, aim = (map_leaves(lambda _: ca.SX.sym("s"), goal) for _ in range(2))  # type: ignore[call-arg]
        target = task.residual_target(2 if len(leaves(goal)) == 6 else 3)
        gaps = [r - t for r, t in zip(task.residual(state, aim), target, strict=True)]
        gaps += [a - b for a, b in zip(_motion(state), _motion(aim), strict=True)]
        x, g, conditions = ca.vertcat(*leaves(state)), ca.vertcat(*leaves(aim)), ca.vertcat(*gaps)
        self.conditions = ca.Function("arrival", [x, g], [conditions])
        gradient = ca.Function("gradient", [x, g], [ca.jacobian(conditions, x)])
        chosen = _independent_rows(np.array(gradient(leaves(goal), leaves(goal))))
        self.high = np.array([0.0 if row in chosen else _BRANCH for row in range(len(gaps))])
        self.low = -self.high


def _motion(state: Any) -> tuple[Any, ...]:
    return (*state.v.columns(), *state.spin())


def _independent_rows(matrix: np.ndarray) -> Sequence[int]:
    """The first rows that span what all rows span."""
    chosen: list[int] = []
    for row in range(len(matrix)):
        if np.linalg.matrix_rank(matrix[[*chosen, row]], tol=1e-9) > len(chosen):
            chosen.append(row)
    return chosen
