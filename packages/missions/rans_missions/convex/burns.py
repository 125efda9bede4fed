"""The planner of burns: linear programs over changes of velocity in chosen control periods.

In a drift the position at any instant is affine in the burns until then, so that the flight of least impulse along
the axes that keeps linear constraints is a linear program. What is not linear, such as a ball that is kept out of,
is taken as its tangents at the flight before: programs follow one another until their price no longer falls. Where
no flight keeps all constraints of a program, a distance eases them at a price, and the next begins from that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from rans.extend import Drift
from rans_missions.orbits.linear import carried, transition

_CUTS = 25
"""Times at which a program is solved again with the constraints that its flight breaks, at most."""
_EASING = 1.0
"""Price of a metre by which constraints are eased, m/s: far more than one is worth."""
_BROKEN = 1e-6
"""Distance by which a flight breaks a constraint that its program does not have, m: rounding of the solver."""


class Solved(NamedTuple):
    """What a program finds."""

    price: float
    """Sum of the changes of velocity along all axes, and what easing costs, m/s."""
    burns: np.ndarray
    """Changes of velocity, (n,) m/s."""


def cheapest(
    matrix: np.ndarray, side: np.ndarray, begins: np.ndarray, most: float
) -> Solved | None:
    """The burns of least impulse with matrix @ burns >= side; None: the solver ends without them.

    Args:
        matrix: what burns add to each constraint, (m, n) s.
        side: least of each sum, (m,) m.
        begins: which constraints the program has at first, (m,); those that its flight breaks join them.
        most: largest change of velocity of a control period along an axis, m/s.
    """
    size = matrix.shape[1]
    if not len(matrix):
        return Solved(0.0, np.zeros(size))
    used = begins.copy()
    if not used.any():
        used[0] = True
    # One distance eases all.
    costs = np.append(np.ones(2 * size), _EASING)
    matrix = np.hstack([matrix, -matrix, np.ones((len(matrix), 1))])
    ease = 0.0
    for _ in range(_CUTS):
        program = linprog(
            costs,
            A_ub=-matrix[used],
            b_ub=-side[used],
            bounds=[(0.0, most)] * (2 * size) + [(0.0, ease)],
            method="highs-ds",
            options={"presolve": False},
        )
        if program.status == 2 and ease == 0.0:
            ease = math.inf
            continue
        if program.status != 0:
            return None
        broken = (matrix @ program.x < side - _BROKEN) & ~used
        if not broken.any():
            burns = program.x[:size] - program.x[size : 2 * size]
            return Solved(float(program.fun), burns)
        used |= broken
    return None


class Reach(NamedTuple):
    """What burns in some control periods do to the positions of D craft."""

    slots: np.ndarray
    """Control periods that may have a burn, (K,)."""
    times: np.ndarray
    """(T,) s."""
    free: np.ndarray
    """Positions without burns, (D, T, 3) m."""
    effect: np.ndarray
    """Change of the position by a change of velocity in each slot along each axis, (T, 3, 3 K) s."""

    @classmethod
    def of(
        cls, drift: Drift, starts: np.ndarray, period: float, slots: np.ndarray, times: np.ndarray
    ) -> Reach:
        """The reach of craft from states (D, 6), m and m/s in W, with a control period, s.

        Burns are columns by slot and then by axis.
        """
        since = np.maximum(times[:, None] - slots * period, 0.0)
        # During a burn as far as a constant thrust carries it until then, afterwards as an impulse in its middle.
        since = np.where(since < period, since**2 / (2.0 * period), since - 0.5 * period)
        effect = transition(drift, since)[..., :3, 3:]
        return cls(
            slots,
            times,
            carried(drift, starts[:, None], times)[..., :3],
            np.ascontiguousarray(effect.transpose(0, 2, 1, 3)).reshape(len(times), 3, -1),
        )

    def path(self, burns: np.ndarray) -> np.ndarray:
        """Positions (D, T, 3) m of flights with burns (3 D K,) m/s."""
        burns = burns.reshape(len(self.free), -1)
        used = np.flatnonzero(burns.any(axis=0))
        return self.free + np.moveaxis(self.effect[:, :, used] @ burns[:, used].T, 2, 0)
