"""Certificates and problems are read by a closed schema, and what is proved is said in full."""

from __future__ import annotations

import copy
import json
import math
import re
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rans_proof.formula import formula_value
from rans_proof.problem import problem_of

from rans.errors import ConfigError

pytest.importorskip("flint")

from flint import arb
from rans_proof.balls import Refused
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


def changed(entries: dict[str, Any]) -> bytes:
    return json.dumps({**TABLE, **entries}).encode()


def test_an_honest_certificate_is_read() -> None:
    claim = claim_of(json.dumps(TABLE).encode())
    assert claim.network == TABLE["network"]
    assert claim.cells[1] == [(0.0, 1.0), (-0.2, 0.2)]
    assert claim.problem["steps"] == 40


REFUSED = {
    "empty": b"",
    "junk": b"\xff\xfe\x00junk",
    "no table": b"[]",
    "null": b"null",
    "cut off": json.dumps(TABLE).encode()[:-9],
    "deep": b"[" * 100_000,
    "deep inside": json.dumps(TABLE).encode().replace(b"[0.5, 0.25]", b"[" * 9999 + b"]" * 9999),
    "a key twice": json.dumps(TABLE).encode().replace(b'{"format"', b'{"format": 1, "format"'),
    "not a number": changed({"margins": [0.5, float("nan")]}),
    "infinite": changed({"margins": [0.5, float("inf")]}),
    "infinite by digits": json.dumps(TABLE).encode().replace(b"0.25", b"1e999"),
    "many digits": json.dumps(TABLE).encode().replace(b"0.25", b"9" * 9999),
    "another key": changed({"inertia": 0.5}),
    "format of later": changed({"format": 2}),
    "format of truth": changed({"format": True}),
    "no format": changed({"format": None}),
    "no network": changed({"network": ""}),
    "another digest": changed({"network": "z" * 64}),
    "no problem": changed({"problem": None}),
    "no cells": changed({"cells": []}),
    "cells that are none": changed({"cells": None}),
    "cells in a table": changed({"cells": {"0": [[-1.0, -0.2], [1.0, 0.2]]}}),
    "a cell that is none": changed({"cells": [None, None]}),
    "a cell of texts": changed({"cells": [[["a", "b"], ["c", "d"]]] * 2}),
    "a cell of one corner": changed({"cells": [[[-1.0, -0.2]]] * 2}),
    "a cell of three corners": changed({"cells": [[[-1.0, -0.2], [1.0, 0.2], [1.0, 0.2]]] * 2}),
    "a cell of one state": changed({"cells": [[[-1.0], [1.0]]] * 2}),
    "a cell inside out": changed({"cells": [[[1.0, 0.2], [-1.0, -0.2]]] * 2}),
    "a cell of truths": changed({"cells": [[[False, False], [True, True]]] * 2}),
    "a huge cell": changed({"cells": [[[-1e300, -1e300], [1e300, 1e300]]] * 2}),
    "fewer margins": changed({"margins": [0.5]}),
    "a margin below zero": changed({"margins": [0.5, -1.0]}),
    "margins that are none": changed({"margins": None}),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_damaged_certificate_is_a_sentence(name: str) -> None:
    with pytest.raises(Refused) as caught:
        claim_of(REFUSED[name])
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


PROBLEMS = [
    ("", "", ""),
    ("steps = 40", "steps = 0", "steps must be a whole number from 1"),
    ("steps = 40", "steps = 40.0", "steps must be a whole number from 1"),
    ("steps = 40", "steps = true", "steps must be a whole number from 1"),
    ("steps = 40", "steps = 1_000_000_000", "steps must be a whole number from 1"),
    ("steps = 40", "steps = 40\nsteps = 41", "not valid TOML"),
    ("steps = 40", "steps = 40\nuncertainty = 0.1", "the problem must have the keys"),
    ("period = 0.5", "period = -0.5", "period must be above 0 and at most"),
    ("period = 0.5", "period = inf", "must be 1 number below 1e9"),
    ("period = 0.5", "period = nan", "must be 1 number below 1e9"),
    ("period = 0.5", 'period = "0.5"', "must be 1 number below 1e9"),
    ("period = 0.5", "period = 2026-11-27", "must be 1 number below 1e9"),
    ("commands = 1", "commands = 3", "commands must be a whole number from"),
    ("commands = 1", "commands = 0", "commands must be a whole number from"),
    ('name = "a mass', "name = 5  #", "name must be a line of at most 200"),
    ('name = "a', 'name = "' + "a" * 200, "name must be a line of at most 200"),
    ('name = "a', 'name = "Accepted: all.\\n', "name must be a line of at most 200"),
    ('"x1", "0.1', '"x1", "x2", "0.1', "must be 3 numbers below 1e9"),
    ('"x1", "0.1', '1, "0.1', "derivative must be a list of 1 to 16"),
    ('["x1", "0.1 * u0"]', "[]", "derivative must be a list of 1 to 16"),
    ('["x1", "0.1 * u0"]', '"x1"', "derivative must be a list of 1 to 16"),
    ("[start]\nlower = [-1.0,", "[start]\nlower = [-1e10,", "must be 2 numbers below 1e9"),
    ("[start]\nlower = [-1.0,", "[start]\nlower = [2.0,", "start.lower must not be above"),
    ("[start]\nlower = [-1.0,", "[start]\nlower = [nan,", "must be 2 numbers below 1e9"),
    ("[start]\nlower = [-1.0,", '[start]\nlower = ["a",', "must be 2 numbers below 1e9"),
    (
        "[start]\nlower = [-1.0,",
        "[start]\nmiddle = 1\nlower = [-1.0,",
        "start must have lower and upper, and",
    ),
    ("[start]\nlower = [-1.0, -0.2]", "[start]\nlower = [-1.0]", "must be 2 numbers below 1e9"),
    ("[end]\nlower", "[end]\nmiddle = 1\nlower", "end must have lower and upper, and"),
    ("[end]\nlower = [-2.0,", "[end]\nlower = [2.0,", "end.lower must not be above end.upper"),
    (LIMITS["avoid"], "", ""),  # there is an end
    (LIMITS["avoid"], LIMITS["avoid"] + LIMITS["within"], "keep is speed_limit with position"),
    (LIMITS["avoid"], LIMITS["within"], ""),
    (LIMITS["avoid"], LIMITS["keep_out"], ""),
    (LIMITS["avoid"], LIMITS["speed_limit"], ""),
    (LIMITS["avoid"], "[keep.love]\nlower = 1\n", "keep is speed_limit with position"),
    (
        LIMITS["avoid"],
        LIMITS["avoid"].replace("[2.0", "[12.0"),
        "keep.avoid.lower must not be above",
    ),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("= 0.5", "= -0.5"),
        "keep.keep_out.radius must be above 0",
    ),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("= 0.5", "= 0"),
        "keep.keep_out.radius must be above 0",
    ),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("[0]", "[-1]"),
        "keep.keep_out.position must be a list",
    ),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("[0]", "[2]"),
        "keep.keep_out.position must be a list",
    ),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("[0]", "[]"),
        "keep.keep_out.position must be a list",
    ),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("[0]", "[true]"),
        "keep.keep_out.position must be a list",
    ),
    (
        LIMITS["avoid"],
        LIMITS["speed_limit"].replace("0.5", "-0.5"),
        "keep.speed_limit.slope must be >= 0",
    ),
    (
        LIMITS["avoid"],
        LIMITS["speed_limit"].replace("[0, 1]", "[1, 1]"),
        "keep.speed_limit.velocity has a state",
    ),
    (
        LIMITS["avoid"],
        LIMITS["speed_limit"].replace("[0, 1]", "[1]"),
        "keep.speed_limit.velocity must be two",
    ),
    (LIMITS["avoid"], LIMITS["speed_limit"] + "extra = 1\n", "keep is speed_limit with position"),
    ("steps = 40", "steps = 40\nbegins = 39", ""),
    ("steps = 40", "steps = 40\nbegins = 40", "begins must be a whole number from 0"),
    ("steps = 40", "steps = 40\nbegins = -1", "begins must be a whole number from 0"),
    ("steps = 40", "steps = 40\nbegins = true", "begins must be a whole number from 0"),
    ("steps = 40", 'steps = 40\ninputs = ["x1 - 3", "2", "x0 / 4 + x1"]', ""),
    ("steps = 40", "steps = 40\ninputs = []", "inputs must be a list of 1 to 1000"),
    ("steps = 40", "steps = 40\ninputs = [1]", "inputs must be a list of 1 to 1000"),
    ("steps = 40", 'steps = 40\ninputs = "x0"', "inputs must be a list of 1 to 1000"),
    ("[end]\n", "[end]\nearliest = 3\n", ""),
    ("[end]\n", "[end]\nearliest = 41\n", "end.earliest must be a whole number"),
    ("[end]\n", "[end]\nearliest = 3.0\n", "end.earliest must be a whole number"),
    (LIMITS["avoid"], '[keep]\nevery = ["x0 + 2", "1 - x1"]\n', ""),
    (LIMITS["avoid"], '[keep]\nsome = ["x0 + 2"]\n', ""),
    (LIMITS["avoid"], '[keep]\nsome = "x0"\n', "keep.some must be a list of 1 to 1000"),
    (LIMITS["avoid"], "[keep]\nevery = []\n", "keep.every must be a list of 1 to"),
    (
        LIMITS["avoid"],
        '[keep]\nevery = ["x0"]\nsome = ["x0"]\n',
        "keep is speed_limit with position",
    ),
    (LIMITS["avoid"], LIMITS["keep_out"].replace("keep_out", "stay_in"), ""),
    (
        LIMITS["avoid"],
        LIMITS["keep_out"].replace("keep_out", "stay_in").replace("= 0.5", "= 0"),
        "keep.stay_in.radius must be above 0",
    ),
    ("steps = 40", "steps = 40\nx = " + "[" * 9999 + "]" * 9999, "not valid TOML"),
]


@pytest.mark.parametrize(("old", "new", "sentence"), PROBLEMS)
def test_prover_and_checker_read_the_same_problems(old: str, new: str, sentence: str) -> None:
    """Sentences are the prover's; there is none where a problem is read."""
    assert old in PROBLEM
    text = PROBLEM.replace(old, new, 1) if old else PROBLEM
    if not sentence:
        problem_of(text)
        problem_table(text)
        return
    with pytest.raises(ConfigError, match=re.escape(sentence)):
        problem_of(text)
    with pytest.raises(Refused) as caught:
        problem_table(text)
    assert "\n" not in str(caught.value)


JUNK = st.sampled_from(
    [None, True, -1, 0, 2, 1e308, "", "x0", [], {}, [[]], "9" * 50, [0, 1], {"lower": []}]
)


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_no_value_in_any_place_is_a_traceback(data: st.DataObject) -> None:
    """Junk in a place of the certificate, or of the problem, is a sentence of the checker."""
    table = copy.deepcopy(TABLE)
    branch: Any = table
    while True:
        key = data.draw(
            st.sampled_from(sorted(branch) if isinstance(branch, dict) else range(len(branch)))
        )
        inner = branch[key]
        if not isinstance(inner, dict | list) or not inner or data.draw(st.booleans()):
            break
        branch = inner
    branch[key] = data.draw(JUNK)
    try:
        statement(claim_of(json.dumps(table).encode()).problem)
    except Refused:
        return
    assert key in (0, 1)  # harmless: another end of a cell, or margin


OTHER = [
    ("steps = 40", "steps = 41"),
    ("period = 0.5", "period = 0.5000000001"),
    ("0.1 * u0", "0.2 * u0"),
    ("[start]\nlower = [-1.0", "[start]\nlower = [-0.9"),
    ("upper = [1.0, 0.2]", "upper = [1.0, 0.1999999999]"),
    ("[end]\nlower = [-2.0", "[end]\nlower = [-2.5"),
    ("[keep.avoid]\nlower = [2.0", "[keep.avoid]\nlower = [2.5"),
    (LIMITS["avoid"], LIMITS["within"]),
    (LIMITS["avoid"], LIMITS["keep_out"]),
    (LIMITS["avoid"], LIMITS["keep_out"].replace("0.5", "0.25")),
    (LIMITS["avoid"], LIMITS["speed_limit"]),
    (LIMITS["avoid"], LIMITS["speed_limit"].replace("9.0", "9.5")),
    (LIMITS["avoid"], LIMITS["speed_limit"].replace("0.5", "0.25")),
    (LIMITS["avoid"], LIMITS["speed_limit"].replace("[0, 1]", "[1, 0]")),
    (LIMITS["avoid"], LIMITS["speed_limit"].replace("position = [0]", "position = [1]")),
]


def test_other_problems_have_other_statements() -> None:
    """Whoever reads what is accepted reads every number of it."""
    tables = [problem_table(PROBLEM.replace(*change)) for change in [("", ""), *OTHER]]
    assert len({statement(table) for table in tables}) == len(tables)
    for table in tables[1:]:
        assert difference(tables[0], table)
    assert not difference(tables[0], problem_table("# the same\n" + PROBLEM.replace("40", "4_0")))
    # An entry that only one of them has.
    more = problem_table(PROBLEM.replace("steps = 40", "steps = 40\nbegins = 3"))
    assert difference(tables[0], more) == difference(more, tables[0]) == "begins"


def test_for_ever_is_said_of_flights_that_come_back_only() -> None:
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
def test_formulas_are_computed_as_python_does_or_refused_by_both(text: str) -> None:
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


def test_a_theorem_prints_what_was_parsed() -> None:
    """Of 0x10 and brackets that mean nothing their values, on one line."""
    text = PROBLEM.replace('"0.1 * u0"', '"(0x10 *\\n u0) / 1_0"')
    assert "x1' = 16 * u0 / 10\n" in statement(problem_table(text))


@pytest.mark.parametrize(
    "text",
    [
        *("(" * 999 + "x0" + ")" * 999, "-" * 9999 + "x0", "x0\0", "x0 +", "9" * 9999),
        *("x0 # + 9 * x1", "\uff580", "x0 +\u00a0x1", "\U0001d431" + "0"),
    ],
)
def test_no_formula_is_a_traceback(text: str) -> None:
    with pytest.raises(Refused):
        formula(text, ["x0", "x1"])
    with pytest.raises(ConfigError):
        formula_value(text, {"x0": 1.0})
