"""Attacks on the filter: the search flies what it counts, and the gradient lowers the margin."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.attack import GradientAttack, Plan, by_search, flown
from rans.episode import Setup
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import load_task


def test_a_search_counts_every_flight_of_its_generations() -> None:
    free, filtered = by_search(0, "avoid-2d", None, Plan(periods=2, generations=2), 5, 1)
    assert free.least.shape == filtered.least.shape == (128,)
    assert filtered.safe.all()
    # From one start, and with other commands, of which a later generation has the worse ones.
    assert len(np.unique(free.least)) > 16
    assert free.least[64:].mean() <= free.least[:64].mean()


@pytest.mark.slow
def test_gradients_lower_the_margin_more_than_coasting_does() -> None:
    task = load_task("avoid").for_evaluation()
    setup = Setup(load_spacecraft("floating-platform"), task, task.timing)
    numbers = np.arange(2)
    plan = Plan(periods=2)
    coast = flown(
        setup, plan, numbers, False, lambda k, state, goal: (np.zeros(2, np.float32),) * 8
    )
    attacked = flown(setup, plan, numbers, False, GradientAttack(setup))
    assert (attacked.least < coast.least - 0.005).all()
