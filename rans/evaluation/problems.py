"""Optimal problems that installed packages solve: bounds in comparisons, and ``rans optimal``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rans.base.registry import Registry
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task

if TYPE_CHECKING:
    from rans.evaluation.compare.contest import Contest


Reference = Callable[..., None]
"""Adds to a comparison what is possible from its starts, each part as soon as it is finished: optima
(`Comparison.relaxed`), bounds (`Comparison.certified`, of any of `Comparison.events`: a start counts for the events
that have one), or a note that says why there are none. Its arguments are
the comparison and, by their names, those of `Comparison.fly` from ``certified`` to ``returns``."""
REFERENCES: Registry[Reference] = Registry("reference of comparisons", "rans.references")
"""What installed packages compute beside flights, by what it is."""


@dataclass(frozen=True)
class Problem:
    """What is known about the optimum of a kind of task (`rans.tasks.base.Task.optimal_problem`)."""

    bounded: Callable[[Contest], bool]
    """Whether the starts of a contest have bounds; an error (`ConfigError`) says why they have none."""
    bounds: Reference
    """Adds the bounds of first starts to a comparison whose contest is `bounded`: of what a mission spends
    (`Comparison.mission`), or of some of `Comparison.events` (`Comparison.certified`)."""
    opponents: tuple[str, ...] = ()
    """Default opponents of comparisons (`rans.evaluation.fly.controllers.BESIDE`); empty: those of any task."""
    solve: Callable[[Any, Spacecraft, Task], int] | None = None
    """What ``rans optimal`` does: of the command, craft and task, its exit code. None:
    the best trajectory, as for other tasks, unless the task remembers."""

    @staticmethod
    def of(task: Task) -> Problem | None:
        """The problem of a task; None: a trajectory.

        Raises:
            ConfigError: no installed package solves it.
        """
        return None if task.optimal_problem == "trajectory" else PROBLEMS[task.optimal_problem]


PROBLEMS: Registry[Problem] = Registry("optimal problem", "rans.problems", checked=Problem)
"""Problems that installed packages solve, by `Task.optimal_problem`."""


def bounding(contest: Contest) -> Problem | None:
    """The problem that bounds the starts of a contest; None: no package has one.

    Raises:
        ConfigError: the task's own bounds are none of this contest.
    """
    problem = Problem.of(contest.task)
    return problem if problem is not None and problem.bounded(contest) else None
