"""Flights from given random numbers against those from drawn ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_assurance.assure.chances import Chances, Chosen, sized
from rans_assurance.assure.replay import drawing

from rans.episode import Setup
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.episodes import fly_draws
from rans.model.fields import leaves
from rans.model.random import Random
from rans.randomization.conditions import BodyConditions, Conditions, SensorsConditions
from rans.randomization.conditions_file import load_conditions


def _hashed(chances: Chances, seed: int, numbers: np.ndarray) -> np.ndarray:
    """The uniform numbers that scenarios of a seed draw for themselves, (D, N): every place in order."""
    rows = []
    for block, place in chances.places:
        stream = Random(2, seed, 0, numbers, np.float64, block)
        rows.append([stream.unit() for _ in range(place + 1)][-1])
    return np.array(rows)


def test_given_the_numbers_that_a_scenario_draws_a_flight_is_that_scenario(
    robust: LoadedRun,
) -> None:
    # Every range varies, so that no number is drawn in vain; sensors draw by seed 0 and the same number.
    lab = Conditions(body=BodyConditions((0.9, 1.1), (0.9, 1.1)))
    timing = replace(robust.judged.timing, episode_steps=20)
    setup = robust.judged._replace(timing=timing, conditions=lab)
    numbers = np.arange(5, 9, dtype=np.int32)
    chances = Chances.of(setup)
    chosen = chances.draws(_hashed(chances, 0, numbers), numbers)
    ours, theirs = (
        fly_draws(robust.controller, setup, own) for own in (chosen, drawing(0, numbers.tolist()))
    )
    assert (
        len(chances.places) == 6
    )  # bearing, distance, attitude, goal's attitude; mass and inertia
    np.testing.assert_array_equal(np.stack(leaves(ours.states)), np.stack(leaves(theirs.states)))


@pytest.mark.slow
def test_conditions_of_no_size_are_a_perfect_world_and_of_size_one_themselves(
    robust: LoadedRun, setup: Setup
) -> None:
    delayed = replace(load_conditions("lab"), sensors=SensorsConditions(delay=(0.0, 2.0)))
    measured = setup._replace(conditions=sized(delayed))
    chances = Chances.of(measured)
    number = np.arange(8, dtype=np.int32)
    units = np.random.default_rng(1).random((len(chances.places), 8))

    def states(size: float | None, of: Setup) -> np.ndarray:
        own = chances.draws(units, number, None if size is None else np.full(8, size))
        return np.stack(leaves(fly_draws(robust.controller, of, own).states))

    perfect = setup._replace(conditions=None)
    usual = setup._replace(conditions=delayed)
    # 1e-9: nothing is switched off at size 0, so that sums with zeros round otherwise.
    np.testing.assert_allclose(states(0.0, measured), states(None, perfect), atol=1e-9)
    np.testing.assert_allclose(states(1.0, measured), states(None, usual), atol=1e-9)
    assert not np.allclose(states(2.0, measured), states(1.0, measured), atol=1e-3)


def test_a_missing_number_is_an_error_and_no_accident() -> None:
    with pytest.raises(KeyError):
        Chosen(0, 0, np.zeros(1, np.int32), 0, np.float64).random(2, np.zeros(1, np.int32)).unit()
