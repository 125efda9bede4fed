"""What the readers of problems and networks make of planted files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rans_proof.network import read_network
from rans_proof.problem import read_problem

from tests.support.graphs import forged
from tests.support.reader_questions import (
    Answer,
    Answers,
    check_said,
    planted,
    written,
)

PROBLEM = """
name = "a mass on a line"
period = 0.5
steps = 20
commands = 1
derivative = ["x1", "0.1 * u0"]
[start]
lower = [4.0, -0.1]
upper = [5.0, 0.1]
[keep.avoid]
lower = [5.5, -9.0]
upper = [9.0, 9.0]
"""


def problem(old: str, new: str) -> Any:
    assert old in PROBLEM
    return written("problem.toml", PROBLEM.replace(old, new), read_problem)


def network(name: str) -> Any:
    def plant(folder: Path) -> Callable[[], object]:
        pytest.importorskip("onnx")
        (folder / "net.onnx").write_bytes(forged()[name])
        return lambda: read_network(folder / "net.onnx")

    return plant


ANSWERS: Answers = {
    "read_problem": {
        "units": "formulas have those of their states, which only their author names",
        "frames": "the same",
        "times": Answer(problem("period = 0.5", "period = 0.0"), "period must be"),
        "order": Answer(problem("upper = [5.0", "upper = [3.0"), "must not be above"),
        "dropped": Answer(
            problem("steps = 20", "steps = 20\nhorizon = 3"), "unknown key 'horizon'"
        ),
        "sizes": Answer(problem("steps = 20", "steps = 1000000000"), "steps must be"),
        "evidence": Answer(problem("0.1 * u0", "0.1 * u7"), "no formula of a problem"),
    },
    "read_network": {
        "units": "a network's numbers have none",
        "frames": "a network names none",
        "times": "a network has none",
        "order": Answer(network("matrix before a batch"), "first axis is that of a batch"),
        "dropped": Answer(network("two outputs"), "one output"),
        "sizes": "files are bounded, and test_network.py has weights too large",
        "evidence": Answer(network("a dead branch"), "node 1|one output"),
    },
}


@planted(ANSWERS)
def test_a_file_that_means_something_else(answer, tmp_path):
    check_said(answer, tmp_path)
