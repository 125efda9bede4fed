"""Refinement of the mesh: the same optimal control problem with shorter and shorter control periods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.table import Table

from rans import terminal
from rans.errors import ConfigError
from rans.evaluation.compare.optima import Optimum
from rans.optimal.trajectory.objectives import Objective, ObjectiveName, objective_of

MOST_HALVINGS = 4
"""Largest number of halvings of the control period: each doubles the variables, and four make 800 periods of 50."""


@dataclass(frozen=True)
class Mesh:
    """Optima of all starts with one control period."""

    intervals: int
    """Control periods of a trajectory."""
    costs: np.ndarray
    """(N,) costs in the objective's unit, NaN of starts without a solution."""
    defects: np.ndarray
    """(N,) largest distance between the optimised path and the flight in Drake, m."""
    seconds: float
    """Processor time of the solver, all starts together."""

    @classmethod
    def of(cls, answers: Sequence[Optimum]) -> Mesh:
        """Mesh from its optima, one for each start."""
        return cls(
            len(answers[0].trajectory.commands),
            np.array([answer.trajectory.cost if answer.good else np.nan for answer in answers]),
            np.array([answer.replay_error for answer in answers]),
            sum(answer.trajectory.seconds for answer in answers),
        )


def refined_objectives(
    name: ObjectiveName,
    halvings: int,
    horizon: float | None,
    control_period: float,
    ending: Any,
    intervals: int,
) -> list[Objective]:
    """Objectives whose control periods are halved again and again.

    Args:
        name: see `rans.optimal.trajectory.objectives.objective_of`, as the others.
        halvings: number of halvings.
        horizon: length of the trajectory, s.
        control_period: control period of the coarsest mesh, s.
        ending: "exact" or "set".
        intervals: intervals of the coarsest mesh, for least time.

    Raises:
        ConfigError: there are no halvings or more than `MOST_HALVINGS`; or see `objective_of`.
    """
    if not 1 <= halvings <= MOST_HALVINGS:
        raise ConfigError(
            f"the control period can be halved 1 to {MOST_HALVINGS} times, got {halvings}: each time "
            "doubles the size of the problem."
        )
    return [
        objective_of(name, horizon, control_period / 2**k, ending, intervals * 2**k)
        for k in range(halvings + 1)
    ]


def remaining_errors(meshes: Sequence[Mesh]) -> np.ndarray:
    """(meshes - 1, N) estimates of the errors of the costs of the second and later meshes, in the objective's unit.

    With d the change from the mesh before and D the change before that, larger than d, the changes are taken for a
    geometric series, whose rest is d / (D / d - 1) (Richardson's extrapolation with the observed order). Otherwise
    the estimate is the change itself.
    """
    costs = np.array([mesh.costs for mesh in meshes])
    changes = np.abs(np.diff(costs, axis=0))
    errors = changes.copy()
    for k in range(1, len(changes)):
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = changes[k - 1] / changes[k]
        falls = ratio > 1.5  # below, a series of changes says little about its rest
        errors[k] = np.where(falls, changes[k] / np.maximum(ratio - 1.0, 0.5), changes[k])
        errors[k] = np.where(changes[k] == 0.0, 0.0, errors[k])
    return errors


def refinement_table(measure: str, meshes: Sequence[Mesh]) -> Table:
    """Table with a row for each mesh: size, mean cost, estimated error and defect."""
    solved = np.all([np.isfinite(mesh.costs) for mesh in meshes], axis=0)
    errors = remaining_errors(meshes)
    note = (
        f"Of the {int(solved.sum())} of {len(solved)} starts that every mesh solved. The error is estimated from "
        "the changes of each start's cost and given as the largest; the defect is the largest distance between "
        "the optimised path and Drake's."
    )
    columns = ("intervals", f"mean {measure}", "largest error", "defect mm", "solver s")
    result = terminal.table("Refinement of the mesh", columns, (), note, "right")
    for k, mesh in enumerate(meshes):
        has_error = k > 0 and solved.any()
        result.add_row(
            str(mesh.intervals),
            f"{mesh.costs[solved].mean():.4f}" if solved.any() else "-",
            f"{errors[k - 1][solved].max():.4f}" if has_error else "-",
            f"{1e3 * mesh.defects[solved].max():.4f}" if solved.any() else "-",
            f"{mesh.seconds:.1f}",
        )
    return result


def refinement_json(meshes: Sequence[Mesh]) -> list[dict[str, Any]]:
    """Data for `rans.files.write_json`; missing numbers are NaN."""
    errors = remaining_errors(meshes)
    nothing = np.full(len(meshes[0].costs), np.nan)
    return [
        {
            "intervals": mesh.intervals,
            "costs": mesh.costs.tolist(),
            "errors": (errors[k - 1] if k else nothing).tolist(),
            "defects": mesh.defects.tolist(),
            "seconds": mesh.seconds,
        }
        for k, mesh in enumerate(meshes)
    ]
