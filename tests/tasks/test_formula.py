"""Formulas of rewards."""

from __future__ import annotations

import re

import numpy as np
import pytest

import rans
from rans.model.fields import map_leaves
from rans.scenario import scenarios
from rans.show.tables.listing import task_listings
from rans.tasks import Task
from rans.tasks.formula import OF_STATE, reward_formulas
from rans.tasks.rewards import Transition
from tests.support.switching import SwitchingGoToPose

TASKS: list[Task] = [
    SwitchingGoToPose(
        fine_weight=0.7, misaligned_weight=20.0, rest_position=0.4, switching_weight=0.3
    ),
    rans.GoToPosition(rest_spin=0.2, fine_weight=2.0),
    rans.TrackVelocity(),
    rans.TrackTwist(),
    rans.TrackVelocityHeading(thrust_weight=0.0),
]


@pytest.mark.parametrize("task", TASKS, ids=lambda one: type(one).__name__)
def test_formulas_give_the_reward(task: Task) -> None:
    """Read as Python reads them, for 32 starts metres away, and 32 some centimetres."""
    starts = scenarios(task, rans.load_spacecraft("floating-platform"), 3, 32)
    near = map_leaves(lambda x: 0.03 * x, starts.start)
    rng = np.random.default_rng(0)
    for state in (starts.start, near):
        command, before = rng.integers(0, 2, (2, 8, 32)).astype(float)
        found = task.reward(Transition(state, starts.goal, tuple(command), tuple(before)))
        names = {name: np.asarray(value) for name, value in task.errors(state, starts.goal).items()}
        names |= {"open": command.sum(axis=0), "exp": np.exp, "max": np.maximum}
        formulas = reward_formulas(task)
        assert formulas.keys() == found.keys()
        for term, formula in formulas.items():
            if term == "switching":  # a sum over thrusters, written for one
                assert formula == "-0.3 |open - open_before|"
                continue
            said = eval(re.sub(r"(?<=[\d)]) (?=[a-z(])", " * ", formula), {}, names)
            # Formulas are printed with four digits.
            np.testing.assert_allclose(
                said, found[term], rtol=2e-3, atol=1e-12, err_msg=f"{term}: {formula}"
            )


def test_a_task_that_symbols_cannot_follow_has_no_formula() -> None:
    class Own(rans.GoToPose):
        def reward(self, transition: Transition) -> dict[str, object]:
            return {"x": float(transition.state.p.x)}

    assert reward_formulas(Own()) == {}
    (row,) = next(iter(task_listings(Own()))).rows
    assert row[1] == "does more than arithmetic on fields: no formula, and no generated kernel"


def test_a_formula_that_would_fill_the_memory_is_not_written() -> None:
    """Guidance shares its terms so often that as a text the landing's reward would have no end."""
    formulas = reward_formulas(rans.Land(), 3)
    assert OF_STATE in formulas.values()
    assert max(map(len, formulas.values())) < 10_000
