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
    return {tile.label: tile.value for tile in page(shown).tiles}


def test_tiles_have_units() -> None:
    """Two of three episodes settle, after 1 and 2 s; thrust of 2, 1 and 0 N s."""
    found = values(comparison())
    assert found["settled"] == "66.7 %"
    assert found["settling time"] == "2 s"
    assert found["impulse of the episode"] == "1 N s"


def test_what_never_happens_has_no_unit() -> None:
    far = flight_of(np.full((11, 3), 9.0), 0.0, np.zeros((10, 3, 8)))
    entry = Entry(Contestant("agent", NOBODY, "observation", "none"), far, np.zeros(1))
    contest = Contest(far.craft, far.task, far.timing, 1, 3)
    shown = Comparison(contest, [entry])
    assert values(shown)["settling time"] == "never"
    assert "inf" not in page(shown).hero


def test_the_sentence_has_lqr_and_the_quickest_of_the_others() -> None:
    """Flights that are within the tolerances from 1 s, 2 s and 1.5 s on; two thrusters of 1 N for 1 s of LQR's."""
    entries = []
    for name, step in (("agent", 2), ("LQR", 4), ("slow", 8), ("fast", 3)):
        distance = np.full((11, 1), 0.01)
        distance[:step] = 1.0
        commands = np.zeros((10, 1, 8))
        commands[:2, 0, :2] = 1.0 if name == "LQR" else 0.0
        flown = flight_of(distance, 0.0, commands)
        entries.append(Entry(Contestant(name, NOBODY, "state", "none"), flown, np.zeros(1)))
    flight = entries[0].flight
    contest = Contest(flight.craft, flight.task, flight.timing, 1, 1)
    hero = page(Comparison(contest, entries)).hero
    assert (
        "; LQR takes 2 s with 2 N s; the quickest of the others, fast, takes 1.5 s with 0 N s"
        in hero
    )
    hero = page(Comparison(contest, entries[:3])).hero
    assert "; the quickest of the others, LQR, takes 2 s with 2 N s" in hero
    figures = hero[hero.index("agent settles") :]  # after who dominates whom, and who is quicker
    assert "slow" not in figures
