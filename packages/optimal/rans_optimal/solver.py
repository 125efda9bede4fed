"""CasADi, and answers of its solvers, which flights in several threads may share."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from rans.extend import require

if TYPE_CHECKING:
    import casadi as ca
else:
    ca = require("casadi")

_SOLVING = threading.Lock()
"""Held from a solution to the reading of its statistics, which CasADi keeps of the last one in any thread."""


def solution_of(solver: Any, **problem: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a solver of CasADi answers, and the statistics of this very solution.

    Args:
        solver: of `casadi.nlpsol` or `casadi.conic`.
        problem: arguments of the solver, such as bounds and a guess.
    """
    with _SOLVING:
        return solver(**problem), solver.stats()
