"""The seam of machine code: a core without it trains and flies the same."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from rans.base.registry import Registry
from rans.episode.flight_statistics import FlightStatistics
from rans.episode.step import Setup
from rans.fast import machine_code as seam
from rans.fast.flights import Flights
from tests.support.engines import PLATFORM
from tests.support.kernel_flights import policy, setup
from tests.support.training import tiny_learner, weights


def trained_and_flown() -> tuple[torch.Tensor, FlightStatistics, tuple[Any, ...]]:
    """Weights after an iteration, statistics of flights, and what computed them."""
    learner = tiny_learner(layers=(16, 16))
    learner.learn()
    flights = Flights(policy(PLATFORM), Setup(*setup(PLATFORM)))
    step: Any = learner.engine._step
    kinds = (learner.backend, step._generated, flights._whole)
    return weights(learner.network), flights.fly(0, 100, 3), kinds


def test_a_bare_core_trains_and_flies_the_same(monkeypatch):
    ours, flown, compiled = trained_and_flown()
    assert None not in compiled
    nobody = Registry("machine code", "rans.machine_code.none", {}, lambda make: make)
    monkeypatch.setattr(seam, "PACKAGES", nobody)
    seam.machine_code.cache_clear()
    try:
        theirs, stepped, kinds = trained_and_flown()
    finally:
        seam.machine_code.cache_clear()
    assert kinds == (None, None, None)
    # 128 transitions, in four steps of Adam that divide by roots of small numbers.
    torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-4)
    assert len(flown.numbers) == len(stepped.numbers)
    assert flown.sums["return"].mean == pytest.approx(stepped.sums["return"].mean, rel=1e-3)
