"""The problems of ARCH-COMP; the networks do not come with RANS."""

import numpy as np
import pytest
from rans_proof.problem import read_problem

from tests.support.processes import ROOT

pytest.importorskip("onnx")
pytest.importorskip("flint")


HERE = ROOT / "packages/proof/archcomp"


def test_prover_and_checker_read_every_problem():
    from rans_proof.check_problem import problem_table, statement

    others = (ROOT / f"examples/proofs/{name}.toml" for name in ("attitude", "docking"))
    for file in (*HERE.glob("*.toml"), *others):
        problem = read_problem(file)
        assert f"to {problem.steps * problem.period:.10g} s" in statement(
            problem_table(problem.text)
        ) or (problem.keep is None)


def test_balancing_is_one_problem_in_two_parts():
    """Flights of the first part end among the starts of the second one, and 8 and 10 s are what is asked."""
    early, late = (read_problem(HERE / f"balancing-{part}.toml") for part in ("early", "late"))
    assert early.end is not None
    assert (early.end.lower, early.end.upper) == (late.lower, late.upper)
    assert (early.earliest or early.steps) == early.steps
    assert early.period == late.period
    assert (early.steps + late.begins) * late.period == 8.0
    assert (early.steps + late.steps) * late.period == 10.0
    x, u = np.random.default_rng(0).normal(size=(2, 4, 9))
    assert np.array_equal(early.rates([*x], [u[0]]), late.rates([*x], [u[0]]))


def test_half_planes_of_navigation_are_outside_of_its_square():
    """Both files say the same of a state: whether it is outside of [1, 2] x [1, 2]."""
    states = np.random.default_rng(0).uniform(0.0, 3.0, (20_000, 4))
    is_outside = ((states[:, :2] < 1.0) | (states[:, :2] > 2.0)).any(axis=1)
    for name in ("nav-point", "nav-set"):
        keep = read_problem(HERE / f"{name}.toml").keep
        assert keep is not None
        assert np.array_equal(keep.margins(states) > 0.0, is_outside)
