"""Relaxed optima in the contest's terms: what is asked, and what a flown trajectory is scored by."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_optimal import relaxed
from rans_optimal.objectives import MinimumFuel, MinimumTime
from rans_optimal.optima import episode, optima

from rans import GoToPose, Timing
from rans.episode.scenario import each
from rans.evaluation.compare.contest import Contest
from rans.model.spacecraft_file import load_spacecraft

NEAR = GoToPose(evaluation_distance=(0.8, 0.9)).for_evaluation()
CONTEST = Contest(load_spacecraft("floating-platform"), NEAR, Timing(episode_steps=40), 4, 2)


def test_scores_of_what_was_flown():
    """Fuel is the optimiser's own cost; 6 s of thrust at 0.2 s, then 2 s of coasting at the goal."""
    objective = MinimumFuel(6.0, 0.2)
    [one, _] = relaxed.solve(CONTEST, objective, 1)
    [answer, _] = optima(CONTEST.craft, CONTEST.task, objective, CONTEST.starts, workers=1)
    assert (one.start, one.solved, one.status, one.objective) == (0, True, "solved", "fuel")
    assert one.arrival == pytest.approx(6.0)
    assert one.thrust == pytest.approx(answer.trajectory.cost, rel=1e-6)
    assert one.seconds > 0
    assert one.replay_error == pytest.approx(answer.replay_error, abs=1e-12)
    first = next(each(CONTEST.starts))
    flight = episode(CONTEST.craft, CONTEST.task, CONTEST.timing, first, answer.trajectory)
    inside = np.asarray(flight.task.reached(flight.states, flight.goals))[:, 0]
    assert one.settling == pytest.approx(0.2 * (np.flatnonzero(~inside)[-1] + 1))
    assert one.total == pytest.approx(sum(float(term.sum()) for term in flight.rewards().values()))


def test_who_acts_at_a_rate_of_his_own_has_no_return():
    [one, _] = relaxed.solve(CONTEST, MinimumTime(20), 1)
    assert one.solved
    assert one.arrival < 5.0
    assert math.isnan(one.total)


def test_what_was_lost_has_no_scores():
    objective = MinimumFuel(6.0, 0.2)
    [answer, _] = optima(CONTEST.craft, CONTEST.task, objective, CONTEST.starts, workers=1)
    assert answer.flight is not None
    strict = replace(answer.flight, task=replace(NEAR, position_tolerance=1e-12))
    assert relaxed._scored(CONTEST, objective, replace(answer, flight=strict)).settling == math.inf
    strayed = replace(answer, replay_error=0.1)
    row = relaxed._scored(CONTEST, objective, strayed)
    assert not row.solved
    assert row.status == "solved, but Drake flies elsewhere"
    assert all(
        math.isnan(x) for x in (row.arrival, row.settling, row.thrust, row.total, row.replay_error)
    )
