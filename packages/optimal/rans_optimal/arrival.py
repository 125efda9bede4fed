"""Where a trajectory must end, as conditions on its last state; corners rounded off for an optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from rans.extend import ConfigError, Field, State, Task, aims, first_line, leaves, map_leaves
from rans_optimal.checks import check_goal
from rans_optimal.solver import ca

Ending = Literal["exact", "set", "free"]
"""At the goal; within the task's tolerances of it; or anywhere."""

_REDUNDANT_BAND = 0.5
"""How far a redundant condition may be off its target, see `Arrival`: cosines of the wanted and the
opposite attitude differ by 2."""
_CORNER_RADIUS = 1e-6
"""Rounding of errors at zero, where bounds of them are not active; four times that (an angle is twice an
arctangent, and the solver leaves 1e-8) is kept from the bounds, so that `Task.reached` holds."""

LEAST_MARGIN = 4 * _CORNER_RADIUS
"""Least margin of constraints, in their own units: rounding may make them this much too large."""

ROUNDINGS = (1e-2, 1e-3)
"""Radii of rounded corners in SI units (of lengths 1 cm and 1 mm), to be solved one after the other. Problems
rounded by the second alone take up to four times the iterations. The first alone costs agents with wide
rewards 0.03 % of the return, those with narrow ones and a price of spin 10 to 30 %."""


def goal_motion(task: Task, like: State) -> ca.Function:
    """Motion of the goal as a function: columns of a goal's fields and a time (s) to the fields then.

    Raises:
        ConfigError: the task's `later` does more than arithmetic on fields.
    """
    goal: Any = map_leaves(lambda _: ca.SX.sym("g"), like)
    time = ca.SX.sym("t")
    try:
        fields = ca.vertcat(*leaves(task.later(goal, time)))
    except (TypeError, NotImplementedError, RuntimeError) as error:
        raise ConfigError(
            f"optimal trajectories need {type(task).__name__}.later as arithmetic on fields "
            f"(rans.model.fields): {first_line(error)}."
        ) from error
    return ca.Function("later", [ca.vertcat(*leaves(goal)), time], [fields])


def path_margins(task: Task, state: State, goal: State) -> ca.Function | None:
    """Margins of the task's constraints: columns of a state's and a goal's fields to them.

    They are rounded as `rounded` says, so that distances have gradients; kept above `LEAST_MARGIN`, which
    makes up for that, the margins themselves are not negative. None: there are no constraints.
    """
    symbols: list[Any] = [
        map_leaves(lambda _: ca.SX.sym("s"), example) for example in (state, goal)
    ]
    margins = [*task.constraints(*symbols).values()]
    if not margins:
        return None
    columns = [ca.vertcat(*leaves(symbol)) for symbol in symbols]
    return rounded(ca.Function("margins", columns, [ca.vertcat(*margins)]), _CORNER_RADIUS)


class Arrival:
    """Conditions on the last state: ``low <= conditions(state, goal) <= high``.

    Exactly: the task's residual at its target, and the rates that `aims` adds the goal's. A rotation's
    entries are more numbers than it has degrees of freedom, and equalities whose gradients depend on each
    other at the solution break the optimiser's assumptions (linear independence constraint
    qualification). So a largest independent set of conditions, judged at the goal, holds as equalities.
    They alone would also accept some opposite attitudes (sin = 0 at half a turn); the others, which
    follow from them near the goal, rule those out as wide bands.

    As a set: the task's errors within its tolerances, and the same rates. The goal, of floats, may be any of
    the task's.

    Raises:
        ConfigError: see `check_goal`; or what the task shows has no gradient at its goal.
    """

    def __init__(self, task: Task, goal: State, ending: Ending) -> None:
        check_goal(task)
        # A state there: what a goal notes is of the goal alone.
        final_state = replace(goal, notes=None)
        state, aim = (
            map_leaves(lambda _: ca.SX.sym("s"), example) for example in (final_state, goal)
        )
        arguments = [ca.vertcat(*leaves(s)) for s in (state, aim)]
        rates = _rate_gaps(task, state, aim) if ending != "free" else []
        if ending == "exact":
            gaps = [*residual(task, state, aim), *rates]
            self.conditions = ca.Function("arrival", arguments, [ca.vertcat(*gaps)])
            gradient = _gradient(self.conditions, leaves(final_state), leaves(goal))
            if not np.isfinite(gradient).all():
                raise ConfigError(
                    f"what {type(task).__name__} shows (its `observation_terms`) has no gradient at the "
                    "goal, which optimal trajectories need; the usual cause is the length of a "
                    "vector that is zero there."
                )
            self.high = np.where(_independent(gradient), 0.0, _REDUNDANT_BAND)
        else:
            tolerances = task.tolerances() if ending == "set" else {}
            errors = task.errors(state, aim)
            gaps = [*(errors[name] for name in tolerances), *rates]
            self.conditions = rounded(
                ca.Function("arrival", arguments, [ca.vertcat(*gaps)]), _CORNER_RADIUS
            )
            self.high = np.array(
                [*(t - 4 * _CORNER_RADIUS for t in tolerances.values()), *(0.0 for _ in rates)]
            )
        self.low = -self.high


def residual(task: Task, state: State, goal: State) -> tuple[Field, ...]:
    """Difference of the task data from their values at the goal, for each column."""
    return tuple(
        x - target
        for entry in task.observation_terms(state, goal)
        for x, target in zip(entry.columns(), entry.target(), strict=True)
    )


def _rate_gaps(task: Task, state: Any, goal: Any) -> list[Any]:
    """The goal's rates less the state's, of those that keep it there and are not the task itself."""
    added = aims(task) - task.tolerances().keys()
    pairs = [*zip(state.v.columns(), goal.v.columns(), strict=True)] if "velocity" in added else []
    pairs += [*zip(state.spin(), goal.spin(), strict=True)] if "spin" in added else []
    return [b - a for a, b in pairs]


def _gradient(
    conditions: ca.Function, final_state: Sequence[float], goal: Sequence[float]
) -> np.ndarray:
    """Gradient of every condition by the state there, a row each."""
    state, aim = (ca.SX.sym("s", len(numbers)) for numbers in (final_state, goal))
    gradient = ca.Function("gradient", [state, aim], [ca.jacobian(conditions(state, aim), state)])
    return np.array(gradient(final_state, goal))


def _independent(rows: np.ndarray) -> np.ndarray:
    """Whether each row is none of those before it combined."""
    ranks = [0, *(np.linalg.matrix_rank(rows[: k + 1], tol=1e-9) for k in range(len(rows)))]
    return np.diff(ranks) > 0


def rounded(function: ca.Function, radius: float | ca.SX) -> ca.Function:
    """Function of SX with its square roots and absolute values made differentiable.

    sqrt(x) becomes sqrt(x + r^2) - r and |x| becomes sqrt(x^2 + r^2) - r: smooth, zero at zero, and never
    more than r too small. So a distance, which has a corner at the goal, gets a gradient there. The function
    has any number of dense arguments and results; a radius r that is a symbol becomes one more, the last.
    """
    inputs = [ca.SX.sym(f"i{k}", function.sparsity_in(k)) for k in range(function.n_in())]
    outputs = [ca.SX(function.sparsity_out(k)) for k in range(function.n_out())]
    work: dict[int, ca.SX] = {}
    for k in range(function.n_instructions()):
        source = function.instruction_input(k)
        sink = function.instruction_output(k)
        operation = function.instruction_id(k)
        if operation == ca.OP_OUTPUT:
            outputs[sink[0]].nz[sink[1]] = work[source[0]]
        elif operation == ca.OP_INPUT:
            work[sink[0]] = inputs[source[0]].nz[source[1]]
        elif operation == ca.OP_CONST:
            work[sink[0]] = ca.SX(function.instruction_constant(k))
        elif operation in (ca.OP_SQRT, ca.OP_FABS):
            square = work[source[0]] if operation == ca.OP_SQRT else work[source[0]] ** 2
            work[sink[0]] = ca.sqrt(square + radius**2) - radius
        else:
            apply = ca.SX.unary if len(source) == 1 else ca.SX.binary
            work[sink[0]] = apply(operation, *(work[i] for i in source))
    return ca.Function(
        function.name(), [*inputs, *([radius] if isinstance(radius, ca.SX) else [])], outputs
    )
