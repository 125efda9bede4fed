"""Any craft: six random ones against DOP853, and that the comparison finds what it looks for."""

from __future__ import annotations

import pytest

from rans.flight import fly
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.support.stiff_crafts import BOUND, integrated, random_craft, row
from validation.study.sampling import Restless, gap


@pytest.mark.parametrize(
    "number", [2, 5, *(pytest.param(k, marks=pytest.mark.slow) for k in (11, 13, 71, 98))]
)
def test_a_random_stiff_craft_is_accurate(number: int) -> None:
    found = row(number)
    assert found.error < BOUND / 3, str(found)


def test_one_step_would_not_do() -> None:
    """So the comparison sees what it looks for: craft 11 under bang-bang control takes four."""
    craft, period = random_craft(11)
    starts = scenarios(GoToPose(), craft, 11, 1)
    pilot = Restless(craft, 11, share=0.0)
    with pytest.warns(UserWarning, match="set timing.substeps to 2 or more"):
        flight = fly(craft, GoToPose(), pilot, starts, Timing(period, 1, 78))
    assert gap(flight.states, integrated(flight))["attitude"] > BOUND
