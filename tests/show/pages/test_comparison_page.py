"""The head of a comparison's page."""

from __future__ import annotations

import numpy as np
import pytest

from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.run import Comparison
from rans.show.pages.comparison_page import page
from tests.support.comparisons import NOBODY, comparison
from tests.support.evaluation_flights import flight_of

# These tests read words and numbers; what figures show has tests of its own.
pytestmark = pytest.mark.usefixtures("undrawn")


def values(shown: Comparison) -> dict[str, str]:
    return {tile.what: tile.value for tile in page(shown).tiles}


def test_tiles_have_units():
    """Two of three episodes settle, after 1 and 2 s; thrust of 2, 1 and 0 N s."""
    found = values(comparison())
    assert found["solved"] == "66.7 %"
    assert found["settling time"] == "2 s"
    assert found["impulse of the episode"] == "1 N s"


def test_what_never_happens_has_no_unit():
    far = flight_of(np.full((11, 3), 9.0), 0.0, np.zeros((10, 3, 8)))
    entry = Entry(Contestant("agent", NOBODY, "observation", "none"), far)
    contest = Contest(far.craft, far.task, far.timing, 1, 3)
    shown = Comparison(contest, [entry])
    assert values(shown)["settling time"] == "never"
    assert "inf" not in page(shown).hero


def test_the_quickest_rival_stands_beside_the_first_contestant():
    """The others are at the goal from 4 s and from 1 s on."""
    shown = comparison()
    for name, late in (("slow", 8), ("quick", 2)):
        distance = np.full((11, 3), 0.01)
        distance[:late] = 1.0
        flight = flight_of(distance, 0.0, np.zeros((10, 3, 8)))
        shown.entries.append(Entry(Contestant(name, NOBODY, "observation", "none"), flight))
    (settling,) = (tile for tile in page(shown).tiles if tile.what == "settling time")
    assert {"agent", "quick 1 s"} <= {*settling.note.splitlines()}
