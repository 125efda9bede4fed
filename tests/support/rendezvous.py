"""Meetings of the deputy, and their least impulse by linear programming."""

from __future__ import annotations

import numpy as np
from rans_missions.convex.rendezvous import Meeting
from rans_missions.tasks import Dock
from scipy.optimize import linprog

from rans.episode.scenario import Scenario, each, scenarios
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from tests.support.clohessy_wiltshire import transition

DEPUTY = load_spacecraft("afrl-deputy")
N = 0.001027
"""rad/s"""


def meeting_of(
    deadline: float, count: int, seed: int
) -> tuple[Meeting, np.ndarray, Scenario, Dock]:
    """A meeting, the states of its starts (count, 6), the starts and their mission."""
    task = Dock(deadline=(deadline, deadline))
    starts = scenarios(task, DEPUTY, seed, count)
    states = np.array([*leaves(starts.start.p), *leaves(starts.start.v)]).T
    return Meeting.of(DEPUTY, task, next(iter(each(starts))).goal), states, starts, task


def program(start: np.ndarray, periods: int, strength: tuple[float, ...] = (1.0,) * 3) -> float:
    """Least impulse, N s, of being at the origin at any speed after so many periods of 10 s, by SciPy.

    Thrusters along each axis push with so many newtons.
    """
    one = transition(N, 10.0)
    effects = [one[:6, 6:] * strength / 12.0]
    for _ in range(periods - 1):
        effects.insert(0, one[:6, :6] @ effects[0])
    matrix = np.hstack(effects)
    coasted = np.linalg.matrix_power(one[:6, :6], periods) @ start
    found = linprog(
        10.0 * np.tile(strength, 2 * periods),
        A_eq=np.hstack([matrix, -matrix])[:3],
        b_eq=-coasted[:3],
        bounds=(0.0, 1.0),
    )
    assert found.success
    return float(found.fun)
