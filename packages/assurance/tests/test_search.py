"""Searches for the smallest disturbance that makes an agent fail, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from rans_assurance.assure import search
from rans_assurance.assure.chances import Chances, Sized, sized
from rans_assurance.assure.search import drew, room, smallest
from scipy.special import ndtri

from rans.episode import Setup
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.episodes import fly_draws
from rans.model.fields import leaves
from rans.randomization.conditions_file import load_conditions
from rans.verdict import Failure


def test_a_flight_tells_what_it_drew(setup: Setup) -> None:
    chances = Chances.of(setup._replace(conditions=sized(load_conditions("harsh"))))
    own = chances.draws(
        np.full((len(chances.places), 1), 0.5), np.zeros(1, np.int32), np.full(1, 1.5)
    )
    said = drew(chances, own)
    # The middle of every range of harsh: mass 1.35, thrust 1, force 0.15 N and so on; 1.5 times that.
    assert said["start"] == "3.5 m from the goal"
    assert said["factor on the mass"] == "1.53"
    assert {"0.15 s", "0.075 s", "0.225 N", "0.075 N m"} < {*said.values()}
    assert said["age of the readings"] == "1 control periods"  # of 1.5
    assert said["factor on the force of each thruster"] == ", ".join(["1"] * 8)


def test_size_grows_from_where_there_is_no_trouble() -> None:
    assert Sized.of((0.75, 1.25), 1.0) == (0.75, 1.25)
    assert Sized.of(0.3, None).nominal == 0.3
    lab = sized(load_conditions("lab"))
    assert (lab.body.mass.nominal, lab.disturbances.force.nominal) == (1.0, 0.0)
    assert not isinstance(lab.thrusters.pressure, Sized)
    # At 3.6 times (0.75, 1.25) a mass is down to 0.1.
    assert room(load_conditions("lab")) == pytest.approx(3.6)


def test_a_search_finds_the_nearest_place_of_failure() -> None:
    # What fails: the first uniform number above 0.9 and the size above 0.4, whatever the rest.
    def score(z: np.ndarray, _: np.ndarray, size: np.ndarray) -> np.ndarray:
        return np.minimum(z[0] / ndtri(0.9), size / 0.4)

    counts: list[int] = []
    found = smallest(score, 6, 2.0, np.random.default_rng(0), counts.append)
    assert 0.4 <= found[0].size < 0.41
    assert found[0].z[0] >= ndtri(0.9)
    assert sum(counts) == 20 * 2048


@pytest.mark.slow
def test_the_smallest_failure_is_flown_again_before_it_is_printed(
    robust: LoadedRun, setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    # After 4 s everybody is still on the way, which is a failure at any size: the first is as good as any.
    monkeypatch.setattr(search, "_ROUNDS", 2)
    monkeypatch.setattr(search, "_COUNT", 64)
    monkeypatch.setattr(search, "FLIGHTS", 128)
    lab = load_conditions("lab")
    found = search.searched("lab", lab, robust.controller, setup, 0)
    breaking = found.breaking
    assert breaking is not None
    assert breaking.again == dict.fromkeys(("numpy", "drake"), Failure.UNSETTLED)
    assert found.failed == found.flights == 128
    measured = Chances.of(setup._replace(conditions=sized(lab)))
    own = measured.draws(
        np.array(breaking.units)[:, None],
        np.array([breaking.number], np.int32),
        np.array([breaking.size]),
    )
    again = fly_draws(robust.controller, measured.setup, own)
    np.testing.assert_array_equal(
        np.stack(leaves(again.states)), np.stack(leaves(breaking.flight.states))
    )
