"""A trade-off that is held: the agent flies the plain task as it flies its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans import GoToPose, GoToPosePriced
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.compare.entrants import contest_of, enlist
from rans.evaluation.fly.contestants import contestant
from rans.model.fields import leaves
from tests.support.training import CONFIG, tiny_trainer


@pytest.fixture(scope="module", params=["floating-platform", "free-flyer"])
def agent(request, tmp_path_factory) -> str:
    """A run folder of an agent with a trade-off, briefly trained."""
    path = tmp_path_factory.mktemp("runs") / "turned"
    tiny_trainer(
        path,
        replace(
            CONFIG, task="go-to-pose-priced", settings=GoToPosePriced(), spacecraft=request.param
        ),
    ).train(lambda _: None)
    return str(path)


@pytest.mark.slow
def test_it_flies_as_in_its_own_task(agent):
    """The same starts, and there the same commands, though the plain task shows no trade-off."""
    flights = []
    for trade_off in ("0", "0.3", "1"):
        own = contestant(f"{agent}#{trade_off}")
        contest = contest_of(f"{agent}#{trade_off}", 40)
        one = enlist(f"{agent}#{trade_off}", contest)
        assert (one.name, type(contest.task)) == (f"turned#{trade_off}", GoToPose)
        plain = contest.fly(one.controller)
        craft, task, timing, _, _ = own.judged
        starts = scenarios(task, craft, contest.seed, 40)
        priced = fly(craft, task, own.controller, starts, timing)
        np.testing.assert_array_equal(plain.commands, priced.commands)
        np.testing.assert_array_equal(leaves(plain.states), leaves(priced.states))
        flights.append(plain.commands)
    assert not np.array_equal(flights[0], flights[2])  # the trade-off is seen


def test_who_needs_no_training_sees_no_trade_off():
    contest = contest_of("lqr:go-to-pose-priced-2d#0.3", 2)
    one = enlist("lqr:go-to-pose-priced-2d#0.3", contest)
    assert one.name == "LQR"
    assert contest.fly(one.controller).task == contest.task
    assert contest.task == GoToPosePriced(trade_off=(0.3, 0.3)).plain().for_evaluation()
