"""Proofs against simulated flights, ball arithmetic and planted errors."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rans_proof.flights import lowest_margins
from rans_proof.network import Layer, read_network
from rans_proof.problem import Box, problem_of, read_problem
from rans_proof.prove import ClosedLoop, Proof, broken_start, prove
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.support.processes import ROOT
from tests.support.small_networks import layers

PROOFS = ROOT / "examples/proofs"
HOLD = PROOFS / "hold-agent"
FREE_FLYER = PROOFS / "free-flyer-agent"


def test_the_hold_agent_stays_for_ever():
    """The box in which its flights end is one that it comes back to, so that the ball is never entered."""
    far, near = (read_problem(PROOFS / f"hold-agent{name}.toml") for name in ("", "-near"))
    assert far.end == near.end == Box(near.lower, near.upper)
    assert far.keep == near.keep
    assert far.derivative == near.derivative
    assert far.period == near.period
    assert prove(near, read_network(HOLD.with_suffix(".onnx"))).is_whole


def proved(stem: Path) -> Proof:
    """The whole proof of a network and the problem beside it."""
    proof = prove(read_problem(stem.with_suffix(".toml")), read_network(stem.with_suffix(".onnx")))
    assert proof.is_whole
    return proof


def check_some(proof: Proof, stem: Path, cells: Sequence[int]) -> None:
    """The independent checker accepts some cells of a proof's certificate."""
    pytest.importorskip("flint")
    from rans_proof.certificate import table
    from rans_proof.check import check

    content = stem.with_suffix(".onnx").read_bytes()
    assert check(json.dumps(table(proof, content)).encode(), content, cells) > 0.0


def test_prover_and_checker_keep_a_set_narrow_for_120_periods():
    """A cell of hold, with 4 cm/s at its end: did a part of the set become a box every period, less were left."""
    pytest.importorskip("flint")
    from rans_proof.check import Loop
    from rans_proof.check_problem import problem_table

    problem = read_problem(HOLD.with_suffix(".toml"))
    network = read_network(HOLD.with_suffix(".onnx"))
    low = [0.0, -200.0, 0.0, -0.1, -0.1, -0.1]
    high = [37.5, -140.0, 37.5, 0.1, 0.1, 0.1]
    loop = ClosedLoop(problem, network, torch.device("cpu"))
    margins, _ = loop.margins(np.array([low]), np.array([high]))
    checker = Loop(problem_table(problem.text), HOLD.with_suffix(".onnx").read_bytes())
    for margin in (margins[0], checker.margin(list(zip(low, high, strict=True)))):
        assert 0.035 < margin <= 0.04


@pytest.mark.slow
def test_the_checker_accepts_cells_of_hold():
    proof = proved(HOLD)
    # The first cells, the one of the least margin, and two others: all of them take six minutes.
    check_some(proof, HOLD, [0, 1, int(proof.margins.argmin()), 200, 300])


def test_a_flight_that_leaves_the_range_of_numbers_breaks_its_property():
    """x' = x^3 + u from 2 is infinite after 1/8 s, from 0.1 only after 50 s."""
    problem = problem_of(
        'name = "blow-up"\nperiod = 0.5\nsteps = 4\ncommands = 1\nderivative = ["x0 * x0 * x0 + u0"]\n'
        "[start]\nlower = [0.1]\nupper = [2.0]\n[keep.within]\nlower = [-1e6]\nupper = [1e6]\n"
    )
    still = [Layer(np.zeros((1, 1)), np.zeros(1), "linear")]
    low = np.array([[0.1], [1.9], [0.1]])
    high = np.array([[0.1], [2.1], [0.3]])
    start = broken_start(problem, still, low, high)
    assert start is not None
    assert start[0] == 2.0


def test_the_free_flyers_states_move_as_a_rigid_body():
    """The formulas against a flight in the world frame, with SciPy's rotations."""
    problem = read_problem(FREE_FLYER.with_suffix(".toml"))
    random = np.random.default_rng(0)
    x = 0.6 * random.normal(size=16)
    x[12] = 1.04
    u = random.uniform(-1.0, 1.0, 6)
    tolerances = {"rtol": 1e-10, "atol": 1e-12}
    after = solve_ivp(
        lambda _, y: problem.rates(y.tolist(), u.tolist()), (0.0, 1.5), x, **tolerances
    ).y[:, -1]

    def turn(vector):
        return Rotation.from_mrp(vector / 4.0)

    def world(_, y):
        attitude = Rotation.from_quat(y[6:10] / np.linalg.norm(y[6:10]))
        spin = y[10:]
        force = attitude.apply(0.263 * x[12] * u[:3])
        q = y[6:10]
        change = 0.5 * np.array(
            [
                q[3] * spin[0] + q[1] * spin[2] - q[2] * spin[1],
                q[3] * spin[1] + q[2] * spin[0] - q[0] * spin[2],
                q[3] * spin[2] + q[0] * spin[1] - q[1] * spin[0],
                -q[:3] @ spin,
            ]
        )
        return np.concatenate((y[3:6], force, change, 2.0 * x[12] * u[3:]))

    first = turn(x[6:9])
    begin = (first.apply(x[:3]), first.apply(x[3:6]), first.as_quat(), x[9:12])
    end = solve_ivp(world, (0.0, 1.5), np.concatenate(begin), **tolerances).y[:, -1]
    last = Rotation.from_quat(end[6:10])
    np.testing.assert_allclose(last.inv().apply(end[:3]), after[:3], atol=1e-7)
    np.testing.assert_allclose(last.inv().apply(end[3:6]), after[3:6], atol=1e-7)
    assert (last.inv() * turn(after[6:9])).magnitude() < 1e-7
    np.testing.assert_allclose(end[10:], after[9:12], atol=1e-9)


@pytest.mark.slow
def test_the_free_flyer_is_proved():
    proof = proved(FREE_FLYER)
    # One cell of four: all of them take another six seconds.
    check_some(proof, FREE_FLYER, range(0, len(proof.low), 4))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["docking-agent", "pose-agent"])
def test_the_agents_of_the_page_are_proved(name):
    proved(PROOFS / name)


def test_the_hold_agent_from_ahead_is_refuted():
    """Its guidance knows nothing of the ball, which is then on its way."""
    problem = read_problem(HOLD.with_suffix(".toml"))
    ahead = replace(
        problem, steps=60, end=None, lower=(-5, 150, -5, 0, 0, 0), upper=(5, 160, 5, 0, 0, 0)
    )
    network = read_network(HOLD.with_suffix(".onnx"))
    proof = prove(ahead, network)
    assert proof.counterexample is not None
    assert lowest_margins(ahead, network, proof.counterexample[None])[0] < 0.0


def test_a_lost_cell_leaves_the_margins_of_others_alone():
    """Cells of one batch, some of which end beyond the box, or have no bound, against each cell by itself."""
    problem = problem_of(
        'name = "it"\nperiod = 0.5\nsteps = 6\ncommands = 1\nderivative = ["x0 * x0", "u0"]\n'
        "[start]\nlower = [-1.0, -1.0]\nupper = [1.0, 1.0]\n"
        "[keep.within]\nlower = [-1.5, -1.5]\nupper = [0.5, 1.5]\n"
        "[end]\nlower = [-1.2, -1.2]\nupper = [0.4, 1.2]\n"
    )
    loop = ClosedLoop(problem, layers([2, 4, 1], 0, scale=0.1), torch.device("cpu"))
    low = np.array([[-0.4, 0.0], [0.4, 0.0], [-0.5, -0.1], [0.9, 0.9], [-0.3, 0.1]])
    high = low + 0.05
    margins = loop.margins(low, high)[0]
    alone = [loop.margins(low[k : k + 1], high[k : k + 1])[0][0] for k in range(len(low))]
    np.testing.assert_allclose(margins, alone, rtol=0.02)  # cells of a batch have the same steps
    assert ((margins > 0.0) == [True, False, True, False, True]).all()
    assert len(set(margins[margins > 0.0].round(6))) == 3
