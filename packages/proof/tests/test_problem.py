"""Problems of proofs that are shipped."""

from __future__ import annotations

from rans_proof.problem import Avoid, Problem, read_problem

from tests.support.processes import ROOT


def test_the_shipped_problems_are_read() -> None:
    docking, attitude = (
        read_problem(ROOT / "examples/proofs" / name) for name in ("docking.toml", "attitude.toml")
    )
    assert docking.linear() is not None
    assert attitude.linear() is None
    assert isinstance(attitude.keep, Avoid)
    assert isinstance(docking, Problem)
