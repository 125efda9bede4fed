"""Guidance with safe coasts: which plan is chosen, how many are predicted, and what coasts keep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_missions.control.passive_approach import PassiveApproach
from rans_missions.tasks import Hold

TASK = Hold()
N = TASK.mean_motion


@pytest.mark.parametrize(
    ("impulses", "flights", "row"),
    [
        # The second plan is the first that is safe as it is flown; the cheapest is safe with impulses alone.
        ([60.0, 60.0, 60.0], [49.0, 55.0, 60.0], 1),
        # None is safe as it is flown: the farthest.
        ([60.0, 60.0, 60.0], [40.0, 45.0, 41.0], 1),
        # Only the last is worth a prediction.
        ([10.0, 20.0, 60.0], [90.0, 90.0, 51.0], 2),
        # No plan is safe even with impulses.
        ([10.0, 20.0, 30.0], [90.0, 90.0, 90.0], None),
    ],
)
@pytest.mark.parametrize("batch", [1, 2, 3])
def test_the_cheapest_safe_plan_is_chosen(
    impulses: list[float], flights: list[float], row: int | None, batch: int
) -> None:
    assert TASK.keep_out == 50.0
    plan = PassiveApproach("vbar-chaser", TASK)._cheapest_safe(
        np.arange(3),
        batch,
        lambda rows: np.array(impulses)[rows] > 50.0,
        lambda rows: np.array(flights)[rows],
    )
    assert (None if plan is None else plan.row) == row
    if plan is not None:
        assert plan.distance == flights[plan.row]


def test_a_flight_without_burns_keeps_what_its_coast_keeps() -> None:
    """At rest 100 m ahead of the target a craft stays there; a burn towards it leads into the ball."""
    guidance = PassiveApproach("vbar-chaser", TASK)
    start = np.array([[0.0, 100.0, 0.0, 0.0, 0.0, 0.0]])
    orbit = 2.0 * math.pi / N

    def distance(change: np.ndarray) -> float:
        result = guidance._predicted_distance(
            start, lambda states, now: change * (now == 0.0), 5, orbit + 50.0, False
        )
        return float(result[0])

    # The certified bound is at most a centimetre below.
    assert distance(np.zeros((1, 3))) == pytest.approx(100.0, abs=0.02)
    assert distance(np.array([[0.0, -0.5, 0.0]])) < 50.0


def test_a_predicted_coast_keeps_a_reserve_for_pulses() -> None:
    """The ball has 50 m: 50.09 m are not enough, and 50.11 m are."""
    assert not PassiveApproach("vbar-chaser", TASK)._is_safe(50.09)
    assert PassiveApproach("vbar-chaser", TASK)._is_safe(50.11)


def test_of_each_batch_the_eight_cheapest_are_predicted() -> None:
    predicted: list[list[int]] = []

    def unsafe(rows: np.ndarray) -> np.ndarray:
        predicted.append(rows.tolist())
        return np.zeros(len(rows))

    PassiveApproach("vbar-chaser", TASK)._cheapest_safe(
        np.arange(20), 10, lambda rows: rows != 0, unsafe
    )
    assert predicted == [[*range(1, 9)], [*range(10, 18)]]
