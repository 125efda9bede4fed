"""The agent of the last 15 m to contact: flights, false claims, and cells of its proof."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("onnx")

from rans_proof.network import Layer, apply, read_network
from rans_proof.problem import Problem, problem_of, read_problem
from rans_proof.prove import prove

from tests.support.clohessy_wiltshire import transition
from tests.support.processes import ROOT

FILES = ROOT / "examples/proofs/contact-agent"
MEAN_MOTION = 0.001027


@pytest.fixture(scope="module")
def problem() -> Problem:
    return read_problem(FILES.with_suffix(".toml"))


@pytest.fixture(scope="module")
def network() -> list[Layer]:
    return read_network(FILES.with_suffix(".onnx"))


def drawn(problem: Problem, count: int, seed: int) -> np.ndarray:
    """Starts (N, 13), half of them at corners."""
    random = np.random.default_rng(seed)
    start = random.uniform(problem.lower, problem.upper, (count, problem.states))
    corner = np.where(random.random(start.shape) < 0.5, problem.lower, problem.upper)
    return np.where(random.random((count, 1)) < 0.5, corner, start)


def contact(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Position and velocity (N, 6) on the plane of the port, of states that are on either side of it."""
    part = before[:, 1] / (before[:, 1] - after[:, 1])
    return before + part[:, None] * (after - before)


def test_flights_come_to_contact(problem, network):
    """Flights by the exact transition over a period, and a part of the proof below their margins."""
    second = transition(MEAN_MOTION, 1.0)
    start = drawn(problem, 200, 0)
    x = start[:, :6]
    met = np.zeros(len(x), dtype=bool)
    force = np.zeros((len(x), 3))
    for k in range(60 * 5):
        if k % 5 == 0:
            read = np.column_stack((x[:, :3] + start[:, 7:10], x[:, 3:] + start[:, 10:]))
            force = 0.1 / 12.0 * start[:, 6:7] * apply(network, read)
        before = x
        x = (np.column_stack((x, force)) @ second.T)[:, :6]
        now = (before[:, 1] < 0.0) & (x[:, 1] >= 0.0)
        assert not (now & met).any()
        met |= now
        at = contact(before[now], x[now])
        assert (np.abs(at[:, [0, 2]]) < 0.1).all()
        assert (np.abs(at[:, [3, 5]]) < 0.005).all()
        assert (at[:, 4] > 0.0).all()
        assert (at[:, 4] < 0.04).all()
    assert met.all()


FALSE = {
    "a miss of 4 cm": ("0.1 - 0.06 * x1 - x2", "0.04 - 0.06 * x1 - x2"),
    "readings off by 10 cm": ("-0.01, -0.01, -0.01, -0.0005", "-0.1, -0.01, -0.01, -0.0005"),
}
"""Claims that flights contradict: a text of the problem, and what stands in its place."""


@pytest.mark.parametrize("claim", FALSE)
def test_a_false_claim_is_refuted(claim, network):
    text = FILES.with_suffix(".toml").read_text("utf-8")
    old, new = FALSE[claim]
    assert text.count(old) == 1
    proof = prove(problem_of(text.replace(old, new)), network)
    assert proof.counterexample is not None


@pytest.mark.slow
def test_cells_at_its_worst_corner_are_accepted(problem, network):
    """A cell with the worst flight, proved and checked; all 64 take 37 s and 145 s on a loaded core."""
    pytest.importorskip("flint")
    from rans_proof.certificate import table
    from rans_proof.check import check
    from rans_proof.flights import worst_start

    worst, margin = worst_start(problem, network)
    assert margin > 0.0
    low = np.array(problem.lower)
    high = np.array(problem.upper)
    part = np.floor(np.clip((worst - low) / (high - low), 0.0, 0.999) * 4.0)
    ends = [(low + (part + k) / 4.0 * (high - low)).tolist() for k in (0, 1)]
    content = FILES.with_suffix(".onnx").read_bytes()
    text = FILES.with_suffix(".toml").read_text("utf-8")
    for old, new in zip((problem.lower, problem.upper), ends, strict=True):
        assert text.count(str(list(old))) == 1
        text = text.replace(str(list(old)), str(new))
    proof = prove(problem_of(text), network)
    assert proof.is_whole
    assert check(json.dumps(table(proof, content)).encode(), content) > 0.0
