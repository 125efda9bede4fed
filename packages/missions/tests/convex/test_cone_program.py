"""Certificates of infeasibility: hand-worked, of programs that have a solution, and of a solver that fails."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import clarabel
import numpy as np
import pytest
from hypothesis import given, strategies as st
from rans_missions.convex.cone_program import ConeProgram, SolverFailed
from rans_missions.convex.landing import Descent, Lander, landing
from rans_missions.convex.rendezvous import Flights, least_impulse
from rans_missions.tasks.land import Land
from scipy import sparse

from rans.model.spacecraft_file import load_spacecraft
from tests.support.rendezvous import meeting_of


def between(least: float, most: float, farthest: float) -> ConeProgram:
    """One number that is not below the least, nor above the most, nor farther than this from 0."""
    return ConeProgram(
        np.ones(1),
        sparse.csc_matrix([[1.0], [-1.0]]),
        np.array([most, -least]),
        0,
        2,
        (),
        np.array([-farthest]),
        np.array([farthest]),
    )


def test_what_a_certificate_lacks_counts_times_how_far_solutions_may_be():
    """x <= 1 and x >= 2: (1, 1) proves 0 <= -1. (1, 0.9) proves 0.1 x >= 0.8 - ..., that is x <= -8, alone."""
    assert between(2.0, 1.0, 10.0).is_infeasible(np.array([1.0, 1.0]))
    assert not between(2.0, 1.0, 10.0).is_infeasible(np.array([1.0, 0.9]))
    assert between(2.0, 1.0, 7.9).is_infeasible(np.array([1.0, 0.9]))
    # A multiplier below 0 is none.
    assert not between(2.0, 1.0, 10.0).is_infeasible(np.array([1.0, -1.0]))
    assert between(2.0, 1.0, 10.0).solve("a number") is None
    assert between(1.0, 2.0, 10.0).solve("a number").x == pytest.approx([1.0], abs=1e-6)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-6, 1e12), is_tight=st.booleans())
def test_no_multipliers_prove_that_what_has_a_solution_has_none(seed, scale, is_tight):
    """Equations, inequalities and two cones around a random point, in numbers without rounding.

    With multipliers of equations alone the proof would have to exceed 0 by rounding.
    """
    random = np.random.default_rng(seed)
    x = random.integers(-64, 64, 4) / 64.0
    matrix = random.integers(-50, 50, (11, 4)) / 8.0
    # In the cones, (5, 3, 4) and (7, 2, 3, 6) are on the rim.
    inside = np.array([0.0, 0.0, 0.0, 1.0, 5.0, 3.0, 4.0, 7.0, 2.0, 3.0, 6.0])
    program = ConeProgram(
        np.ones(4), sparse.csc_matrix(matrix), matrix @ x + inside, 2, 2, (3, 4), x, x
    )
    certificate = scale * random.normal(size=11)
    if is_tight:
        certificate[2:] = 0.0
    assert not program.is_infeasible(certificate)


LANDER = Lander.of(load_spacecraft("mars-lander-steered"))
START = np.array([2000.0, 0.0, 1500.0]), np.array([80.0, 30.0, -75.0])


@pytest.mark.parametrize("status", ["NumericalError", "MaxIterations", "DualInfeasible", "false"])
def test_a_solver_that_fails_proves_nothing(monkeypatch, status):
    """Also where it says that there is no solution, with multipliers that do not prove it."""

    class Failing:
        def __init__(self, cost: Any, q: Any, matrix: Any, *_: Any) -> None:
            self._size = matrix.shape

        def solve(self) -> Any:
            said = "PrimalInfeasible" if status == "false" else status
            return SimpleNamespace(status=said, x=[0.0] * self._size[1], z=[1.0] * self._size[0])

    meeting, (state,), _, _ = meeting_of(300.0, 1, 3)
    descent = Descent.of(Land())
    assert landing(LANDER, descent, START, 40.0, 2.0, "bound") is None
    monkeypatch.setattr(clarabel, "DefaultSolver", Failing)
    said = "PrimalInfeasible" if status == "false" else status
    for side in ("bound", "flyable"):
        with pytest.raises(SolverFailed, match=f"{said} for a landing in 40 s"):
            landing(LANDER, descent, START, 40.0, 2.0, side)
    with pytest.raises(SolverFailed, match=f"{said} for a meeting at 300 s"):
        least_impulse(meeting, state, 300)
    flights = Flights(meeting, state, 300)
    flights.be_within(300)
    assert flights.least() <= 0.0


def test_a_program_that_is_barely_infeasible_is_asked_again():
    """A moon's start from which nothing lands in 49.5 s; with Clarabel's own regularization it ends in an error."""
    task = Land(gravity=1.62)
    craft = load_spacecraft("mars-lander-steered")
    lander = Lander.of(craft, (), apart=True)
    descent = Descent.of(task, craft=craft)
    start = np.array([132.966, -253.598, 1612.161]), np.array([3.446, -0.592, -44.424])
    assert landing(lander, descent, start, 49.5, 0.5, "bound") is None
    assert landing(lander, descent, start, 50.0, 0.5, "bound") is not None
