from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from campaigns import agents
from campaigns.agents import time_optimal
from rans.errors import SolverFailed
from rans.evaluation.fly.contestants import contestant
from rans.scenario import EVALUATION_SEED


@pytest.mark.slow
def test_time_optimal_trajectories_are_at_their_goal_early() -> None:
    """CompiledProgram to the goal at full thrust, 2 sqrt(2) N one way and then the other, takes sqrt(4 d m / F)."""
    loaded = contestant("lqr:go-to-pose-2d", "paper")
    craft = loaded.craft
    found = time_optimal(
        craft, loaded.task.for_evaluation(), loaded.timing, EVALUATION_SEED, 2, workers=1
    )
    fastest = math.sqrt(4 * 3.0 * craft.mass / (2 * math.sqrt(2)))
    bound = 100.0 * (1 - fastest / 50.0) + 1.0  # 5 cm before the end it is within 5 cm already: 1 %
    assert found["PT5"].shape == (2,)
    assert (found["PT5"] < bound).all()
    assert (
        found["PT1"] > 85.0
    ).all()  # the prototype's agent is at 78.8 % of a supply eight times weaker
    assert (np.diff([found["PT1"], found["PT2"], found["PT5"]], axis=0) >= 0).all()
    assert (found["position error"] < 0.01).all()  # cm: it rests where the optimiser put it


def test_starts_without_a_trajectory_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them by number, and why the first of them was lost."""
    found = [
        SimpleNamespace(
            start=k,
            flight="flown" if k in (0, 3) else None,
            trajectory=SimpleNamespace(status=f"Status_{k}"),
        )
        for k in range(4)
    ]
    monkeypatch.setattr(agents, "optima", lambda *_, **__: found)
    loaded = contestant("lqr:go-to-pose-2d", "paper")
    with pytest.raises(
        SolverFailed, match=r"the starts \[1, 2\] of seed 9; the first ended with Status_1"
    ):
        time_optimal(loaded.craft, loaded.task, loaded.timing, 9, 4)
