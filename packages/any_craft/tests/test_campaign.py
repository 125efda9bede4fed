"""Tests of the campaign of any craft: contests are flown in parts, and a craft may be that of a file."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from campaigns import any_craft
from campaigns.any_craft import Contest, Flights, _Judge, _may_fly, _own, _parts
from rans.model.timing import Timing
from rans.policy.timing import timing_for
from rans.scenario import EVALUATION_SEED

FRESH = str(Path(__file__).parents[3] / "campaigns/fresh_craft/fresh-16.toml")


@pytest.mark.parametrize("by", ["any-craft", "switching", "MPC"])
@pytest.mark.parametrize("episodes", [1, 63, 64, 130])
def test_parts_are_every_flight_once(by: str, episodes: int) -> None:
    """Parts follow each other without a gap, up to the number of flights or the most of a slow contestant."""
    most = 64 if by != "any-craft" else episodes
    flown = [k for first, n in _parts(Contest("x", by), episodes) for k in range(first, first + n)]
    assert flown == list(range(min(most, episodes)))


def test_flights_are_the_same_in_parts() -> None:
    """Flights of a drawn fault and a value are those of the whole, whatever the division."""
    judge = _Judge(EVALUATION_SEED, None)
    contest = Contest("go-to-pose-2d", "any-craft", value=0.5, fault="dead", is_stated=False)
    whole = judge.flights(contest, 0, 5)
    parts = [judge.flights(contest, 0, 2), judge.flights(contest, 2, 3)]
    assert isinstance(whole, Flights)
    for k, expected in enumerate(whole):
        found = np.concatenate([part[k] for part in parts if part])
        np.testing.assert_array_equal(found, expected)


def test_figures_are_of_all_flights() -> None:
    """A flight that never settles counts in the median, and in the mean of impulses."""
    flights = Flights(
        np.array([True, True, False]), np.array([3.0, 5.0, np.inf]), np.array([1.0, 2.0, 6.0])
    )
    found = flights.figures()
    assert found.settled == pytest.approx(200.0 / 3.0)
    assert (found.time, found.impulse) == (5.0, 3.0)
    # Wilson's interval of 2 of 3 by hand: (2/3 + z²/6 - z sqrt(2/27 + z²/36)) / (1 + z²/3), z = 1.96.
    assert found.low == pytest.approx(20.8, abs=0.05)


def test_a_craft_of_a_file_flies_without_a_specialist() -> None:
    """It has the timing that rans evaluate FILE has, and no agent of its own."""
    assert not _may_fly("specialist", FRESH)
    own = _own(FRESH)
    assert own.craft.name == "fresh-16"
    assert own.timing == timing_for(own.craft, Timing(0.2, 1, 125))


def test_the_command_runs_the_module_that_other_processes_know(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Contests and flights of __main__ cannot be sent between processes."""
    called = []
    monkeypatch.setattr(any_craft, "main", lambda: called.append(True))
    with pytest.warns(RuntimeWarning, match=r"sys\.modules"):
        runpy.run_module("campaigns.any_craft", run_name="__main__")
    assert called
