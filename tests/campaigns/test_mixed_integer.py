"""Certified least fuel agrees with a mixed-integer program, and a planted error of either is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from campaigns.mixed_integer import (
    Question,
    Row,
    compared,
    least_fuel_by_mixed_integers,
    report,
)
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate.goal_set import GoalSet

PERIOD = 0.4
STEPS = 5


def at(x: float, heading: float, v: float) -> PlanarState:
    return PlanarState(Vec2(x, 0.0), Heading(heading), Vec2(v, 0.0), 0.0)


@pytest.fixture(scope="module")
def row() -> Row:
    """A start 12 cm off, which moves to the goal and has to turn: a few pulses."""
    return compared(load_spacecraft("floating-platform"), at(-0.12, 0.2, 0.02), PERIOD, STEPS)


def test_both_prove_the_same_fuel(row: Row) -> None:
    assert row.lower == pytest.approx(row.answer.reached, abs=1e-6)
    assert row.answer.least == pytest.approx(row.answer.reached, abs=1e-6)
    assert row.contained
    assert report("platform", [row]).passed


@pytest.mark.parametrize("planted", [{"lower": 10.0}, {"upper": 0.1}, {"contained": False}])
def test_a_planted_error_is_found(row: Row, planted: dict[str, float]) -> None:
    assert not report("platform", [replace(row, **planted)]).passed


@pytest.mark.slow
def test_a_minimum_on_time_keeps_thrusters_open() -> None:
    craft = load_spacecraft("floating-platform")
    goal = at(0.0, 0.0, 0.0)
    question = Question(
        craft, at(-0.12, 0.0, -0.02), goal, GoalSet(0.1, 0.1), PERIOD, steps=4, least_on=2
    )
    answer = least_fuel_by_mixed_integers(question, most_fuel=4 * PERIOD)
    assert answer.commands is not None
    shut = np.zeros((1, len(craft.thrusters)), dtype=int)
    edges = np.diff(np.vstack([shut, answer.commands]), axis=0)
    opened, thrusters = np.nonzero(edges == 1)
    assert len(opened) > 0
    for k, thruster in zip(opened, thrusters, strict=True):
        if k + 1 < len(answer.commands):
            assert answer.commands[k + 1, thruster] == 1
