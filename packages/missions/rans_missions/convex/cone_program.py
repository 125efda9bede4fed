"""Cone programs, solved by Clarabel, whose infeasibility is believed with a checked certificate alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from rans import RansError
from rans.extend import require

_REGULARIZATIONS = 1e-8, 1e-7, 1e-10
"""Clarabel's own, and others that are tried after it. A program that is barely infeasible may end in a numerical
error with one and with a certificate with another; what is believed is checked the same way."""


class SolverFailed(RansError):
    """An optimal control problem ended without a solution; the message gives the solver's status."""


@dataclass(frozen=True)
class ConeProgram:
    """Minimise cost . x such that right - matrix x lies in a product of cones.

    Rows are in the order of the cones: equations, inequalities, second-order cones whose first row is not below
    the norm of the others (S. Boyd and L. Vandenberghe, "Convex Optimization", 2004, section 4.4). All x that
    fulfil the rows lie between `lower` and `upper`; this gives certificates their margin.
    """

    cost: np.ndarray
    """(n,)"""
    matrix: Any
    """(m, n), compressed sparse columns."""
    right: np.ndarray
    """(m,)"""
    equations: int
    """Rows that are to be zero."""
    inequalities: int
    """Rows that are not to be negative."""
    cones: tuple[int, ...]
    """Rows of each second-order cone."""
    lower: np.ndarray
    """(n,) finite."""
    upper: np.ndarray
    """(n,) finite."""

    def solve(self, what: str) -> Any:
        """Clarabel's answer with x, z, objectives and residuals; None: it is proved that no x fulfils all rows.

        Args:
            what: what is sought, for the message.

        Raises:
            SolverFailed: Clarabel ends neither with a solution nor with a certificate that passes `is_infeasible`.
        """
        status = ""
        for regularization in _REGULARIZATIONS:
            answer = self.answer(regularization)
            status = str(answer.status)
            if status in ("Solved", "AlmostSolved"):
                return answer
            if "PrimalInfeasible" in status and self.is_infeasible(np.array(answer.z)):
                return None
        raise SolverFailed(
            f"Clarabel ended with {status} for {what}, which neither solves it nor proves that it has no solution; "
            "the usual cause is one that is just out of reach."
        )

    def answer(self, regularization: float = _REGULARIZATIONS[0]) -> Any:
        """Result of Clarabel, whatever its status is.

        Args:
            regularization: constant that is added to the diagonal of its linear systems.
        """
        # Clarabel has no stubs for what its compiled module holds.
        clarabel: Any = require("clarabel")
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.static_regularization_constant = regularization
        count = len(self.cost)
        return clarabel.DefaultSolver(
            sparse.csc_matrix((count, count)),
            self.cost,
            self.matrix,
            self.right,
            [
                clarabel.ZeroConeT(self.equations),
                clarabel.NonnegativeConeT(self.inequalities),
                *map(clarabel.SecondOrderConeT, self.cones),
            ],
            settings,
        ).solve()

    def least(self) -> float:
        """Cost below which no x fulfils the rows, whatever Clarabel ends with; infinite: it is proved: none."""
        multipliers = np.nan_to_num(np.array(self.answer().z), posinf=0.0, neginf=0.0)
        return math.inf if self.is_infeasible(multipliers) else self.bound(multipliers)

    def is_infeasible(self, multipliers: np.ndarray) -> bool:
        """Whether multipliers (m,) of the rows prove that no x fulfils all of them (Farkas' lemma).

        They do if nothing at all costs more than 0.
        """
        return replace(self, cost=np.zeros(len(self.cost))).bound(multipliers) > 0.0

    def bound(self, multipliers: np.ndarray) -> float:
        """Cost below which no x fulfils the rows, from any multipliers (m,) of them, by weak duality.

        With multipliers z of the dual cone, z . (right - matrix x) is not negative for any x that fulfils the rows.
        So its cost is at least the least of cost . x less this product between `lower` and `upper` (S. Boyd and L.
        Vandenberghe, section 5.9). What z lacks to the dual cone is added, and the rounding of all products
        covered, so that the solver's tolerance does not matter.
        """
        unit = np.finfo(float).eps
        z = multipliers.copy()
        first = self.equations + self.inequalities
        z[self.equations : first] = np.maximum(z[self.equations : first], 0.0)
        for rows in self.cones:
            norm = float(np.linalg.norm(z[first + 1 : first + rows]))
            z[first] = max(z[first], norm * (1.0 + rows * unit))
            first += rows
        slope = self.cost + self.matrix.T @ z
        gains = np.minimum(slope * self.lower, slope * self.upper)
        # The error of a sum of products is below their number times the unit roundoff times the sum of their sizes.
        numbers = np.diff(self.matrix.indptr) + 2
        farthest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        rounding = (numbers * (np.abs(self.cost) + abs(self.matrix).T @ np.abs(z))) @ farthest
        rounding += np.count_nonzero(self.right) * (np.abs(z) @ np.abs(self.right))
        rounding += len(gains) * np.abs(gains).sum()
        return float(gains.sum() - z @ self.right - unit * rounding)


class Rows:
    """Rows of a cone program of n variables x, added in any order."""

    def __init__(self, count: int) -> None:
        none = sparse.csc_matrix((0, count)), np.zeros(0)
        self._equations: list[tuple[Any, np.ndarray]] = [none]
        self._inequalities: list[tuple[Any, np.ndarray]] = [none]
        self._cones: list[tuple[Any, np.ndarray]] = []
        self._sizes: list[int] = []

    def keep_zero(self, matrix: Any, vector: np.ndarray) -> None:
        """Add matrix x + vector = 0 for rows (k, n), perhaps sparse, and (k,)."""
        self._equations.append((-matrix, vector))

    def keep_above_zero(self, matrix: Any, vector: np.ndarray) -> None:
        """Add matrix x + vector >= 0 for rows (k, n), perhaps sparse, and (k,)."""
        self._inequalities.append((-matrix, vector))

    def keep_in_cones(
        self, heads: Any, constants: np.ndarray, matrix: Any, vector: np.ndarray
    ) -> None:
        """Add |matrix x + vector| <= heads x + constants for k cones, perhaps sparse.

        Args:
            heads: (k, n)
            constants: (k,)
            matrix: (k d, n), cone after cone.
            vector: (k d,)
        """
        count = len(constants)
        # The head of each cone comes before its other rows.
        others = count + np.arange(len(vector)).reshape(count, -1)
        order = np.hstack([np.arange(count)[:, None], others]).ravel()
        rows = sparse.vstack([heads, matrix], format="csr")[order]
        self._cones.append((-rows, np.concatenate([constants, vector])[order]))
        self._sizes += [1 + others.shape[1]] * count

    def program(self, cost: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> ConeProgram:
        """The program that minimises cost . x; see `ConeProgram`."""
        every = [*self._equations, *self._inequalities, *self._cones]
        return ConeProgram(
            cost,
            sparse.vstack([matrix for matrix, _ in every], format="csc"),
            np.concatenate([vector for _, vector in every]),
            sum(len(vector) for _, vector in self._equations),
            sum(len(vector) for _, vector in self._inequalities),
            tuple(self._sizes),
            lower,
            upper,
        )
