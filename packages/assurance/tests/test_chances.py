"""Flights from given random numbers against those from drawn ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from rans_assurance.assure.chances import Chances, Chosen, scored, sized
from rans_assurance.assure.replay import drawing
from scipy.stats import norm

from rans.episode import Setup
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.episodes import fly_draws
from rans.evaluation.measure.metrics import worst_errors
from rans.fast.flights import Flights
from rans.fast.stepping.step import Backend
from rans.model.fields import leaves
from rans.model.random import Random
from rans.randomization.conditions import BodyConditions, Conditions, SensorsConditions
from rans.randomization.conditions_file import load_conditions

COUNT = 64


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
def test_scores_are_the_largest_errors_of_the_last_fifth(robust: LoadedRun, setup: Setup) -> None:
    chances = Chances.of(setup)
    agent = robust.controller
    random = np.random.default_rng(0)
    z = random.standard_normal((len(chances.places), COUNT))
    number = np.arange(COUNT, dtype=np.int32)
    assert isinstance(agent, Agent)
    network = agent.network
    score = chances.scores(network, torch.device("cpu"))(z, number)
    exact = worst_errors(fly_draws(agent, setup, chances.draws(norm.cdf(z), number)))[0]
    # After 4 s all are still on their way: float32 has moved none by a thousandth.
    np.testing.assert_allclose(score, exact, rtol=1e-3)
    backend = Backend(torch.device("cpu"), torch.float32)  # tensors, as on a GPU
    flights = Flights(network, setup, generated=False)
    flights.backend = backend
    tensors = scored(flights, chances.draws(norm.cdf(z), number, None, backend))
    np.testing.assert_allclose(tensors, exact, rtol=1e-3)


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
