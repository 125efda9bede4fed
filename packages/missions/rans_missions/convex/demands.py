"""What commands of thrusters have to fulfil, and the impulse below which none do, by weak duality."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from rans_missions.convex.cone_program import Rows


@dataclass(frozen=True)
class Demands:
    """Demands |tail + gain u| <= head + width . u on the commands u of a flight, each from 0 to 1.

    With multipliers y and m, |y| <= m, of each of them, the impulse of such a flight is at least

        sum of (y . tail - m head) - sum over commands of max(0, -(price + y . gain - m width)).

    This holds for any multipliers (S. Boyd and L. Vandenberghe, "Convex Optimization", 2004, section 5.9).
    """

    tail: np.ndarray
    """(K, d)"""
    head: np.ndarray
    """(K,)"""
    gain: np.ndarray
    """(K, d, n)"""
    width: np.ndarray
    """(K, n)"""
    prices: np.ndarray
    """(n,) impulse of each command of 1, N s."""

    def bound(self, multipliers: np.ndarray) -> float:
        """Impulse below which no flight fulfils all demands, N s, from any multipliers (K, d + 1): y, then m."""
        y = multipliers[:, :-1]
        m = np.maximum(multipliers[:, -1], np.linalg.norm(y, axis=1))
        rest = self.prices + np.einsum("kd,kdn->n", y, self.gain) - m @ self.width
        return float((y * self.tail).sum() - m @ self.head + np.minimum(rest, 0.0).sum())

    def multipliers(self, limited: bool = False) -> np.ndarray | None:
        """(K, d + 1) multipliers of the largest bound; None: they prove that no flight is there.

        They are those of the dual program. Whatever the solver ends with, `bound` makes a bound of it.

        Args:
            limited: whether the program has the upper limit of commands, which is a variable more for each, and
                matters where thrust is full for a part of the flight.
        """
        count, size = self.tail.shape
        unknown = count * (size + 1)
        spared = len(self.prices) if limited else 0
        rows = Rows(unknown + spared)
        # By its price: 1 + y . gain - m width and what its limit spares are not negative.
        gains = np.concatenate([self.gain, -self.width[:, None]], axis=1).reshape(unknown, -1)
        unit = sparse.eye(spared)
        by_command = gains.T / self.prices[:, None]
        ones = np.ones(len(self.prices))
        rows.keep_above_zero(sparse.hstack([by_command, unit]) if limited else by_command, ones)
        if limited:
            nothing = sparse.csc_matrix((spared, unknown))
            rows.keep_above_zero(sparse.hstack([nothing, unit]), np.zeros(spared))
        cones = np.eye(unknown, unknown + spared).reshape(count, size + 1, -1)
        for one in cones:
            rows.keep_in_cone(one[size], 0.0, one[:size], np.zeros(size))
        cost = np.concatenate([-self.tail, self.head[:, None]], axis=1).ravel()
        cost = np.concatenate([cost, self.prices[:spared]])
        unlimited = np.full(len(cost), np.inf)
        answer = rows.program(cost, -unlimited, unlimited).answer()
        found = np.nan_to_num(np.array(answer.x)[:unknown], posinf=0.0, neginf=0.0)
        found = found.reshape(count, size + 1)
        # Along such a ray the bound gains and loses; where it gains more, it grows for ever.
        is_ray = "DualInfeasible" in str(answer.status)
        if is_ray and replace(self, prices=0.0 * self.prices).bound(found) > 0.0:
            return None
        return found
