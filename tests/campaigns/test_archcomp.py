"""The problems of ARCH-COMP, and cells that the checker halves; the networks do not come with RANS."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from rans_proof.network import network_of
from rans_proof.problem import read_problem
from scipy.io import savemat

from tests.support.graphs import graph, step

pytest.importorskip("onnx")
pytest.importorskip("flint")

from campaigns.archcomp import HERE, ROWS, renewed


def test_prover_and_checker_read_every_problem() -> None:
    from rans_proof.check_problem import problem_table, statement

    files = {row.problem for row in ROWS.values()}
    assert set(HERE.glob("*.toml")) <= files
    for file in files:
        problem = read_problem(file)
        assert f"to {problem.steps * problem.period:.10g} s" in statement(
            problem_table(problem.text)
        ) or (problem.keep is None)


def test_an_old_network_means_the_same_anew() -> None:
    """Version 6 broadcasts by an attribute, and its Gemm takes four axes as one row: (x - c) W^T + b, rectified."""
    random = np.random.default_rng(0)
    shapes = {"c": (1, 1, 1, 3), "W": (4, 3), "b": (4,), "V": (1, 4), "d": (1,)}
    arrays: dict[str, Any] = {
        name: random.normal(size=shape).astype(np.float32) for name, shape in shapes.items()
    }
    nodes = [
        step("Sub", "x c", "m", broadcast=1),
        step("Gemm", "m W b", "h", broadcast=1, transB=1),
        step("Relu", "h", "r"),
        step("Gemm", "r V d", "y", broadcast=1, transB=1),
    ]
    old = graph(nodes, [1, 1, 1, 3], opset=6, **arrays)
    from rans_proof.network import apply

    layers = network_of(renewed(old), "renewed")
    x = random.normal(size=(20, 3))
    hidden = np.maximum((x - arrays["c"].ravel()) @ arrays["W"].T + arrays["b"], 0.0)
    np.testing.assert_allclose(apply(layers, x), hidden @ arrays["V"].T + arrays["d"], atol=1e-5)
    assert renewed(renewed(old)) == renewed(old)


def test_a_matlab_network_means_the_same_in_onnx() -> None:
    """Layers of a MATLAB file against their formula: ReLU, then a hyperbolic tangent, in double precision."""
    random = np.random.default_rng(0)
    weights, biases = np.empty((1, 2), object), np.empty((1, 2), object)
    for k, shape in enumerate(((5, 3), (2, 5))):
        weights[0, k], biases[0, k] = random.normal(size=shape), random.normal(size=(shape[0], 1))
    file = io.BytesIO()
    savemat(file, {"W": weights, "b": biases, "act_fcns": np.array(["relu", "tanh"])})
    from rans_proof.network import apply

    layers = network_of(renewed(file.getvalue()), "matlab")
    x = random.normal(size=(20, 3))
    hidden = np.maximum(x @ weights[0, 0].T + biases[0, 0].ravel(), 0.0)
    expected = np.tanh(hidden @ weights[0, 1].T + biases[0, 1].ravel())
    np.testing.assert_allclose(apply(layers, x), expected, atol=1e-14)


def test_balancing_is_one_problem_in_two_parts() -> None:
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


def test_half_planes_of_navigation_are_outside_of_its_square() -> None:
    """Both files say the same of a state: whether it is outside of [1, 2] x [1, 2]."""
    states = np.random.default_rng(0).uniform(0.0, 3.0, (20_000, 4))
    is_outside = ((states[:, :2] < 1.0) | (states[:, :2] > 2.0)).any(axis=1)
    for name in ("nav-point", "nav-set"):
        keep = read_problem(HERE / f"{name}.toml").keep
        assert keep is not None
        assert np.array_equal(keep.margins(states) > 0.0, is_outside)
