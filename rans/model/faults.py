"""Which failed thrusters a spacecraft can do without: every push and turn is still possible, on average.

A dead thruster never opens, one stuck open always pushes. What the others give on average over time, each
open for a share u_i in [0, 1] of it, is W u with their wrenches as the columns of W. The craft stays master
of its motion if it can hold still against the stuck ones and from there push and turn every way: zero lies
inside the set of w_stuck + W u. That is so if and only if W has full rank and w_stuck + W u = 0 for some u
with all 0 < u_i < 1 (a linear map takes the inside of a box to the inside of its image). A supply that is
shared by what is open scales all forces alike and changes nothing of this.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from rans.model.spacecraft import Spacecraft

FaultClass = Literal["dead", "stuck-open"]
_LEAST = 1e-6
"""Share of full thrust below which a margin is rounding."""


@dataclass(frozen=True)
class FaultSet:
    """Thrusters that fail together, in the same way."""

    kind: FaultClass
    thrusters: tuple[int, ...]
    margin: float
    """How far the others can stay from always shut and always open while they hold the craft still: a share
    of full thrust, up to 0.5; zero or less: they cannot, or some way they can neither push nor turn."""

    @property
    def recoverable(self) -> bool:
        """Whether the craft can still push and turn every way."""
        return self.margin > _LEAST


def fault_sets(craft: Spacecraft, count: int, kind: FaultClass) -> Iterator[FaultSet]:
    """Every set of so many thrusters that fail in this way, in order."""
    for thrusters in combinations(range(len(craft.thrusters)), count):
        yield FaultSet(kind, thrusters, margin(craft, thrusters, kind))


def margin(craft: Spacecraft, failed: Sequence[int], kind: FaultClass) -> float:
    """See `FaultSet`: the largest m with w_stuck + W u = 0 and m <= u_i <= 1 - m, a linear programme."""
    from scipy.optimize import linprog

    wrenches = np.array(craft.wrench_map)
    scale = np.linalg.norm(wrenches, axis=0).max()
    sound = np.delete(wrenches, list(failed), axis=0).T / scale
    stuck = wrenches[list(failed)].sum(axis=0) / scale if kind == "stuck-open" else np.zeros(len(sound))
    if np.linalg.matrix_rank(sound, tol=1e-9) < craft.degrees_of_freedom:
        return 0.0
    count = sound.shape[1]
    column, eye = np.ones((count, 1)), np.eye(count)
    found = linprog(np.append(np.zeros(count), -1.0), A_eq=np.column_stack((sound, np.zeros(len(sound)))),
                    b_eq=-stuck, A_ub=np.block([[-eye, column], [eye, column]]),
                    b_ub=np.append(np.zeros(count), np.ones(count)), bounds=[(0, 1)] * count + [(None, 0.5)])
    return float(-found.fun) if found.success else 0.0
