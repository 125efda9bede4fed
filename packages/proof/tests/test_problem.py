"""Problems of proofs: those that are shipped, and mistakes in one."""

from __future__ import annotations

import pytest
from rans_proof.problem import Avoid, Problem, problem_of, read_problem

from rans.errors import ConfigError
from tests.support.processes import ROOT

DOCKING = """
name = "small docking"
period = 1.0
steps = 8
commands = 2
derivative = [
  "x2", "x3",
  "0.000003 * x0 + 0.002 * x3 + 0.08 * u0",
  "-0.002 * x2 + 0.08 * u1",
]
[start]
lower = [70.0, 70.0, -0.1, -0.1]
upper = [90.0, 90.0, 0.1, 0.1]
[keep.speed_limit]
position = [0, 1]
velocity = [2, 3]
base = 0.2
slope = 0.002
"""


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"x2", "x3"', '"x2", "__import__(0)"', "no formula of a problem"),
        ('"x2", "x3"', '"x2", "x3 ** 99"', "no formula of a problem"),
        ('"x2", "x3"', '"x2", "x9"', "no formula of a problem"),
        ("steps = 8", "steps = 0", "steps must be"),
        ("period = 1.0", "period = 0.0", "period must be"),
        ("period = 1.0", "period = nan", "period"),
        ("period = 1.0", "period = true", "period"),
        ("steps = 8", "steps = true", "steps must be"),
        ("commands = 2", "commands = 5", "commands must be"),
        ("position = [0, 1]", "position = [0, 0]", "twice"),
        ("position = [0, 1]", "position = 0", "position must be"),
        ("position = [0, 1]", "position = []", "position must be"),
        ("velocity = [2, 3]", "velocity = [2]", "velocity must be"),
        ("[start]", "[end]\nlower = 1\n[start]", "end must have"),
        ('"x2", "x3"', "2, 3", "derivative must be"),
        ('"x2", "x3"', '"x2", "1e999 * x3"', "no formula of a problem"),
        ('"x2", "x3"', '"x2", "True * x3"', "no formula of a problem"),
        ("upper = [90.0", "upper = [60.0", "must not be above"),
        ("slope = 0.002", "slope = -0.002", "must be >= 0"),
        ("steps = 8", "steps = 8\nhorizon = 3", "must have the keys"),
    ],
)
def test_a_wrong_problem_is_a_sentence(old: str, new: str, sentence: str) -> None:
    assert old in DOCKING
    with pytest.raises(ConfigError, match=sentence):
        problem_of(DOCKING.replace(old, new))


def test_the_shipped_problems_are_read() -> None:
    docking, attitude = (
        read_problem(ROOT / "examples/proofs" / name) for name in ("docking.toml", "attitude.toml")
    )
    assert docking.linear() is not None
    assert attitude.linear() is None
    assert isinstance(attitude.keep, Avoid)
    assert isinstance(docking, Problem)
