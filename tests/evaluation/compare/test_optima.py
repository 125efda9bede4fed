"""Optimal trajectories as they are reported: flown in Drake first, nothing dropped."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rans.evaluation.compare import optima
from rans.model.fields import map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.trajectory.objectives import MinimumFuel, MinimumTime
from rans.optimal.trajectory.transcription import Trajectory
from rans.reference.flight import replay
from rans.scenario import Scenario, scenarios
from rans.tasks import GoToPose

PLATFORM, TASK = load_spacecraft("floating-platform"), GoToPose().for_evaluation()
FUEL = MinimumFuel(10.0, 0.5)


def starts(count: int = 3) -> Scenario:
    return scenarios(TASK, PLATFORM, 5, count)


def test_every_trajectory_is_flown_in_drake() -> None:
    """Several at once in one plant, as one alone; and least times, each with its own control period."""
    ticks: list[int] = []
    for objective in (FUEL, MinimumTime(12)):
        answers = optima.optima(PLATFORM, TASK, objective, starts(), workers=1,
                                progress=lambda: ticks.append(1))
        assert [answer.start for answer in answers] == [0, 1, 2]
        for answer in answers:
            path = answer.trajectory
            first = map_leaves(lambda x: float(x[0]), path.states)
            flown = replay(PLATFORM, first, path.commands, Timing(path.control_period))
            away = float((flown.p - path.states.p).norm().max())
            assert answer.replay_error == pytest.approx(away, rel=1e-6, abs=1e-12)
            assert answer.good
            assert answer.errors["position"] < 1e-4
    assert len(ticks) == 6


def test_lost_starts_are_rows_with_a_sentence() -> None:
    batch = starts()
    batch.start.p.x[1], batch.start.p.x[2] = math.nan, 60.0
    answers = optima.optima(PLATFORM, TASK, FUEL, batch, workers=1)
    assert [answer.good for answer in answers] == [True, False, False]
    assert "NaN" in answers[1].sentence
    assert "out of reach" in answers[2].sentence
    assert [math.isnan(row["cost"]) for row in (a.to_json() for a in answers)] == [False, True, True]
    table = optima.table("title", FUEL, answers)
    assert table.row_count == 3
    assert str(table.caption).count("\n") == 1


def test_a_trajectory_that_drake_does_not_fly_is_lost() -> None:
    [answer] = optima.optima(PLATFORM, TASK, FUEL, starts(1), workers=1)
    heavier = replace(PLATFORM, mass=1.01 * PLATFORM.mass)
    [path] = optima._flown(heavier, [answer.trajectory])
    away = float((path.p - answer.trajectory.states.p).norm().max())
    assert away > optima.REPLAY_BOUND
    assert not replace(answer, replay_error=away).good
    assert "Drake" in replace(answer, replay_error=away).sentence
    unknown = replace(answer.trajectory, solved=False, status="Odd_End")
    assert "odd end" in replace(answer, trajectory=unknown).sentence


def test_files_hold_everything(tmp_path: Path) -> None:
    batch = starts()
    batch.start.p.x[1] = 60.0
    answers = optima.optima(PLATFORM, TASK, FUEL, batch, workers=1)
    optima.write(tmp_path, {"seed": 5}, answers)
    written = json.loads((tmp_path / "optimal.json").read_text())
    assert written["seed"] == 5
    assert [row["good"] for row in written["starts"]] == [True, False, True]
    with np.load(tmp_path / "optimal.npz") as arrays:
        assert arrays["states"].shape == (3, 21, 6)
        assert arrays["commands"].shape == (3, 20, 8)
        assert np.isnan(arrays["states"][1]).all()
        path: Trajectory = answers[2].trajectory
        column = list(arrays["leaves"]).index("heading")
        assert np.array_equal(arrays["states"][2, :, column], path.states.attitude.angle)
