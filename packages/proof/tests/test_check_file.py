"""Certificates and problems are read by a closed schema, and what is proved is said in full."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings, strategies as st
from rans_proof.formula import formula_value
from rans_proof.network import network_of
from rans_proof.problem import problem_of
from rans_proof.prove import ClosedLoop

from rans import ConfigError
from tests.support.graphs import graph

pytest.importorskip("onnxruntime")
pytest.importorskip("flint")

from flint import arb
from rans_proof.balls import Refused
from rans_proof.check import Loop
from rans_proof.check_motion import formula
from rans_proof.check_problem import claim_of, difference, problem_table, statement

PROBLEM = """
name = "a mass on a line"
period = 0.5
steps = 40
commands = 1
derivative = ["x1", "0.1 * u0"]
[start]
lower = [-1.0, -0.2]
upper = [1.0, 0.2]
[end]
lower = [-2.0, -0.3]
upper = [0.5, 0.3]
[keep.avoid]
lower = [2.0, -9.0]
upper = [9.0, 9.0]
"""
LIMITS = {
    "avoid": "[keep.avoid]\nlower = [2.0, -9.0]\nupper = [9.0, 9.0]\n",
    "within": "[keep.within]\nlower = [-2.0, -9.0]\nupper = [9.0, 9.0]\n",
    "keep_out": "[keep.keep_out]\nposition = [0]\nradius = 0.5\n",
    "speed_limit": "[keep.speed_limit]\nposition = [0]\nvelocity = [0, 1]\nbase = 9.0\nslope = 0.5\n",
}
TABLE: dict[str, Any] = {
    "format": 1,
    "network": "0123456789abcdef" * 4,
    "problem": PROBLEM,
    "cells": [[[-1.0, -0.2], [0.0, 0.2]], [[0.0, -0.2], [1.0, 0.2]]],
    "margins": [0.5, 0.25],
}


def test_an_honest_certificate_is_read():
    claim = claim_of(json.dumps(TABLE).encode())
    assert claim.network == TABLE["network"]
    assert claim.cells[1] == [(0.0, 1.0), (-0.2, 0.2)]
    assert claim.problem["steps"] == 40


def instead(*limits: str) -> list[tuple[str, str]]:
    """Changes of the problem to these limits."""
    return [(LIMITS["avoid"], limit) for limit in limits]


READ = [
    *instead(
        "",  # there is an end
        LIMITS["within"],
        LIMITS["keep_out"],
        LIMITS["keep_out"].replace("keep_out", "stay_in"),
        LIMITS["speed_limit"],
        '[keep]\nevery = ["x0 + 2", "1 - x1"]\n',
        '[keep]\nsome = ["x0 + 2"]\n',
    ),
    ("steps = 40", "steps = 40\nbegins = 39"),
    ("steps = 40", 'steps = 40\ninputs = ["x1 - 3", "2", "x0 / 4 + x1"]'),
    ("[end]\n", "[end]\nearliest = 3\n"),
    ("0.1 * u0", " + ".join(2 * [f"({' + '.join(30 * ['u0'])})"])),  # no deeper than its brackets
]
"""Changes of the problem that leave one; what is refused is in refused.txt."""


@pytest.mark.parametrize(("old", "new"), READ)
def test_prover_and_checker_read_the_same_problems(old, new):
    assert old in PROBLEM
    text = PROBLEM.replace(old, new, 1)
    problem_of(text)
    problem_table(text)


FASTER = [
    ("", ""),
    ("9.0", "9.5"),
    ("0.5", "0.25"),
    ("[0, 1]", "[1, 0]"),
    ("position = [0]", "position = [1]"),
]
OTHER = [
    ("steps = 40", "steps = 41"),
    ("period = 0.5", "period = 0.5000000001"),
    ("0.1 * u0", "0.2 * u0"),
    ("[start]\nlower = [-1.0", "[start]\nlower = [-0.9"),
    ("upper = [1.0, 0.2]", "upper = [1.0, 0.1999999999]"),
    ("[end]\nlower = [-2.0", "[end]\nlower = [-2.5"),
    ("[keep.avoid]\nlower = [2.0", "[keep.avoid]\nlower = [2.5"),
    *instead(
        LIMITS["within"],
        LIMITS["keep_out"],
        LIMITS["keep_out"].replace("0.5", "0.25"),
        *(LIMITS["speed_limit"].replace(*change) for change in FASTER),
    ),
]


def test_other_problems_have_other_statements():
    """Whoever reads what is accepted reads every number of it."""
    tables = [problem_table(PROBLEM.replace(*change)) for change in [("", ""), *OTHER]]
    assert len({statement(table) for table in tables}) == len(tables)
    for table in tables[1:]:
        assert difference(tables[0], table)
    assert not difference(tables[0], problem_table("# the same\n" + PROBLEM.replace("40", "4_0")))
    # An entry that only one of them has.
    more = problem_table(PROBLEM.replace("steps = 40", "steps = 40\nbegins = 3"))
    assert difference(tables[0], more) == difference(more, tables[0]) == "begins"


def test_for_ever_is_said_of_flights_that_come_back_only():
    """The end's box reaches beyond the starts along x0, and along x1."""
    inside = PROBLEM.replace(
        "[end]\nlower = [-2.0, -0.3]\nupper = [0.5, 0.3]",
        "[end]\nlower = [-0.5, 0]\nupper = [0.5, 0.2]",
    )
    assert "later" in statement(problem_table(inside))
    for text in (
        PROBLEM,
        inside.replace("0.5, 0]", "1.5, 0]"),
        inside.replace("[0.5, 0.2]", "[0.5, 0.3]"),
        inside.replace("steps = 40", "steps = 40\nbegins = 3"),
        inside.replace("[end]\n", "[end]\nearliest = 39\n"),
    ):
        assert "later" not in statement(problem_table(text))


FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt")


def formulas() -> st.SearchStrategy[str]:
    leaves = st.sampled_from(
        ["x0", "x1", "u0", "2", "0.5", "1e-3", "x2", "u1", "y0", "True", "1j", "x", "1e999"]
    )
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(
                inner, st.sampled_from([" + ", " - ", " * ", " / ", " ** ", " @ ", ", "]), inner
            ).map("".join),
            st.tuples(st.sampled_from(["-", "+", "~", "not "]), inner).map("".join),
            inner.map(lambda text: f"({text})"),
            st.tuples(st.sampled_from([*FUNCTIONS, "log", "eval", "x0"]), inner).map(
                lambda pair: f"{pair[0]}({pair[1]})"
            ),
        ),
        max_leaves=6,
    )


@given(formulas())
@example("x0 / 2")
@example("+x0")
@example("x0 - +x1")
@example("sqrt(x1)")
@example("sin(x0, x1)")
@example("tan(x=x0)")
@example("x0 / (x0 - x0)")
@settings(max_examples=300, deadline=None)
def test_formulas_are_computed_as_python_does_or_refused_by_both(text):
    """Numbers are such that no rounding hides an exchange of operations."""
    names = {"x0": 0.75, "x1": -1.25, "u0": 3.5}
    try:
        of_prover = formula_value(text, names)
    except ConfigError:
        of_prover = None
    try:
        of_checker = formula(text, list(names))([arb(x) for x in names.values()])
    except Refused:
        of_checker = None
    if of_checker is not None and not of_checker.is_finite():
        of_checker = None
    assert (of_prover is None) == (of_checker is None), text
    if of_prover is not None:
        true = eval(text, {name: getattr(math, name) for name in FUNCTIONS}, names)
        assert of_prover == pytest.approx(true, rel=1e-12)
        assert float(of_checker) == pytest.approx(true, rel=1e-12)  # type: ignore[arg-type]


def test_a_theorem_prints_what_was_parsed():
    """A hexadecimal number is printed as its value, and a number that is rounded as its double."""
    text = PROBLEM.replace('"0.1 * u0"', '"(0x10 *\\n u0) / 1_0 + 0.30000000000000000001"')
    assert "x1' = 16 * u0 / 10 + 0.3\n" in statement(problem_table(text))


@pytest.mark.parametrize(
    ("text", "is_proved"),
    [
        ("u0 + 9007199254740993 - 9007199254740992", None),  # 2^53 + 1, which is no double
        ("u0 + (9007199254740992 + 1.0 - 9007199254740992)", False),
        ("u0 + 2e16 * (exp(1) - 2.718281828459045)", False),
        ("u0 + (9007199254740992 - 1 - 9007199254740991)", True),
    ],
)
def test_literals_are_what_is_printed_of_them_in_both_programs(text, is_proved):
    """Sums that are 1, 1, 2.9 and 0: a mass of the rate u0 = -x0 stays within 0.75 only without the one."""
    held = f'''
name = "held"
period = 0.1
steps = 20
commands = 1
derivative = ["{text}"]
start = {{lower = [-0.1], upper = [0.1]}}
keep.within = {{lower = [-0.75], upper = [0.75]}}
'''
    network = graph("y = Gemm(x, W)", shape=["N", 1], W=-np.ones((1, 1)))
    cell = np.array([[-0.1]]), np.array([[0.1]])
    margin = Loop(problem_table(held), network).margin([(-0.1, 0.1)])
    assert (margin > 0.0) == (is_proved is True)
    if is_proved is None:
        with pytest.raises(ConfigError, match="no double"):
            problem_of(held)
        return
    loop = ClosedLoop(problem_of(held), network_of(network, "it"), torch.device("cpu"))
    assert (loop.margins(*cell)[0] > 0.0) == is_proved
