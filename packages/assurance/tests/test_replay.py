"""Failed flights again: kinds of failures, and every judge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_assurance.assure.replay import drawing, failure_kinds, replays

from rans.episode.verdict import Failure
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_draws
from rans.evaluation.measure.metrics import solved
from rans.randomization.conditions_file import load_conditions
from tests.support.policies import idle


@pytest.fixture(scope="module")
def run() -> LoadedRun:
    return contestant("pretrained:go-to-pose-2d").under(load_conditions("lab"))


def test_failures_of_a_flight_are_those_that_its_evaluation_does_not_find_solved(run):
    flight = fly_draws(run.controller, run.judged, drawing(2026, range(100, 228)))
    found = failure_kinds(flight)
    right = solved(flight)
    assert [one is None for one in found] == right.tolist()
    assert 0 < (~right).sum() < 128  # four in five fail


def test_an_idle_policy_fails_for_every_judge(run):
    class Idle:
        name = "idle"

        def reset(self, count: int) -> None:
            """Nothing to forget."""

        def act(self, state: object, goal: object, observation: np.ndarray) -> np.ndarray:
            return idle(observation)

    setup = run.judged._replace(timing=replace(run.judged.timing, episode_steps=20))
    found = replays(Idle(), setup, 0, {Failure.UNSETTLED: [5, 3, 8]}, most=1)
    assert (found.tried, found.failed) == (3, 3)
    assert all([*one.again] == ["numpy", "drake"] for one in found.found)
    assert all(one.again["drake"] is not None for one in found.found)
    assert found.found[0].excess == max(one.excess for one in found.found)
    assert found.found[0].ending == "drifts with shut valves"
