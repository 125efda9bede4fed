"""Optimal throttles, at which the search for on/off controls in space begins.

Their impulse is least where nearly all shares are 0 or 1, and little above what the bound says. On/off
commands near it turn as it does, which searches that change one command at a time would have to find.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rans.extend import Field, GoToPose, SpatialState, State
from rans.optimal.certificate.goal_set import GoalSet
from rans.optimal.trajectory.objectives import MinimumFuel
from rans.optimal.trajectory.transcription import Transcription
from rans_space_certificates.reach import SpinLattice

_GUESSES = 2
"""Guesses for every problem: the short way round and the long one."""


class Shares(NamedTuple):
    """A local optimum of throttled thrust."""

    fuel: float
    """N s."""
    duties: np.ndarray
    """(N, thrusters) 0 to 1."""


@dataclass(frozen=True)
class _Arriving(GoToPose):
    """Go to a pose and be slow there."""

    velocity_tolerance: float = 0.05
    """m/s."""

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        return super().errors(state, goal) | {"velocity": (goal.v - state.v).norm()}


def throttled(
    lattice: SpinLattice, start: SpatialState, goal: SpatialState, goal_set: GoalSet, steps: int
) -> list[Shares]:
    """Least impulse that rests in the goal set after so many periods, the cheapest first.

    Local optima from two guesses; none where the optimiser finds none.
    """
    task = _Arriving(
        position_tolerance=goal_set.position,
        attitude_tolerance=goal_set.heading,
        velocity_tolerance=goal_set.velocity,
    )
    objective = MinimumFuel(steps * lattice.period, lattice.period, "set")
    problem = Transcription(lattice.craft, task, objective)
    results = [problem.attempt(start, goal, number) for number in range(_GUESSES)]
    return sorted(
        (Shares(optimum.cost, optimum.commands) for optimum in results if optimum.solved),
        key=lambda optimum: optimum.fuel,
    )
