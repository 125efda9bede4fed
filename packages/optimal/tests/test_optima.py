"""Optimal trajectories as they are reported: flown in Drake first, nothing dropped."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from rans_optimal import optima
from rans_optimal.objectives import MinimumFuel, MinimumTime
from rans_optimal.transcription import Trajectory

from rans import GoToPose, Timing
from rans.episode.scenario import Scenario, each, scenarios
from rans.evaluation.measure.metrics import settling_times
from rans.model.actuators import Pulsed, Throttle
from rans.model.fields import map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import replay
from tests.support.missions import Pass

PLATFORM = load_spacecraft("floating-platform")
TASK = GoToPose().for_evaluation()
FUEL = MinimumFuel(10.0, 0.5)


def starts(count: int = 3) -> Scenario:
    return scenarios(TASK, PLATFORM, 5, count)


def test_every_trajectory_is_flown_in_drake():
    """Also least times, each with its own control period."""
    ticks = []
    for objective in (FUEL, MinimumTime(12)):
        answers = optima.optima(
            PLATFORM, TASK, objective, starts(2), workers=1, progress=ticks.append
        )
        assert [answer.start for answer in answers] == [0, 1]
        for answer in answers:
            path = answer.trajectory
            first = map_leaves(lambda x: float(x[0]), path.states)
            flown = replay(PLATFORM, first, path.commands, Timing(path.control_period))
            away = float((flown.p - path.states.p).norm().max())
            assert answer.replay_error == pytest.approx(away, rel=1e-6, abs=1e-12)
            assert answer.good
            assert answer.errors["position"] < 1e-4
    assert len(ticks) == 4


def test_lost_starts_are_rows_with_a_sentence_and_files_hold_everything(tmp_path):
    batch = starts()
    batch.start.p.x[1] = math.nan
    batch.start.p.x[2] = 60.0
    answers = optima.optima(PLATFORM, TASK, FUEL, batch, workers=1)
    assert [answer.good for answer in answers] == [True, False, False]
    assert "NaN" in answers[1].sentence
    assert "found no trajectory that arrives" in answers[2].sentence  # no proof that none does
    assert [math.isnan(row["cost"]) for row in (a.to_json() for a in answers)] == [
        False,
        True,
        True,
    ]
    table = optima.optima_table("title", FUEL, answers)
    assert len(table.rows) == 3
    assert table.note.count("Start ") == 2
    optima.write(tmp_path, {"seed": 5}, answers, PLATFORM)
    written = json.loads((tmp_path / "optimal.json").read_text())
    assert written["seed"] == 5
    assert [row["good"] for row in written["starts"]] == [True, False, False]


def test_a_trajectory_that_drake_does_not_fly_is_lost():
    [answer] = optima.optima(PLATFORM, TASK, FUEL, starts(1), workers=1)
    heavier = replace(PLATFORM, mass=1.01 * PLATFORM.mass)
    [scenario] = each(starts(1))
    flight = optima.episode(
        heavier, TASK, Timing(0.5, episode_steps=1), scenario, answer.trajectory
    )
    away = optima._judged(0, answer.trajectory, flight).replay_error
    assert away > optima.REPLAY_BOUND
    assert not replace(answer, replay_error=away).good
    assert "Drake" in replace(answer, replay_error=away).sentence
    unknown = replace(answer.trajectory, solved=False, status="Odd_End")
    assert "odd end" in replace(answer, trajectory=unknown).sentence


def test_thrust_of_pulsed_valves_is_flown_throttled():
    """It is what was optimised; the pulses of the same duties would lead elsewhere, as each thruster pushes
    at the beginning of a period: by up to (1 - d) d F h^2 / 2 m = 6 mm in the first."""
    pulsed = replace(PLATFORM, actuators=Pulsed(20))
    [answer] = optima.optima(pulsed, TASK, FUEL, starts(1), workers=1)
    assert answer.good
    assert answer.flight is not None
    assert answer.flight.craft == replace(PLATFORM, actuators=Throttle())
    path = answer.trajectory
    first = map_leaves(lambda x: float(x[0]), path.states)
    flown = replay(pulsed, first, path.commands, Timing(path.control_period))
    assert float((flown.p - path.states.p).norm().max()) > optima.REPLAY_BOUND


def made_up(count: int, period: float, solved: bool = True) -> Trajectory:
    """Rest at the start's place, T periods of nothing."""
    [first, *_] = each(starts(1))
    states = map_leaves(lambda x: np.full(count + 1, x), first.start)
    shut = np.zeros((count, 8))
    return Trajectory("nothing", "Solve_Succeeded", solved, 1.5, states, shut, period, 7, 0.25)


@pytest.mark.parametrize(
    ("count", "period", "steps"),
    [(10, 0.2, 25), (30, 0.2, 30), (4, 0.3, 17), (5, 5 / 3, 5), (25, 0.2, 25)],
)
def test_a_flight_lasts_an_episode(count, period, steps):
    """5 s in whole periods of its own, and longer only if the trajectory is."""
    [scenario] = each(starts(1))
    flight = optima.episode(
        PLATFORM, TASK, Timing(0.2, episode_steps=25), scenario, made_up(count, period)
    )
    assert flight.timing == Timing(control_period=period, episode_steps=steps)
    assert flight.commands.shape == (steps, 1, 8)
    assert len(flight.states.p.x) == steps + 1
    assert flight.engine == "drake"


def test_a_mission_is_won_by_a_trajectory():
    """From x = -1 m at 0.8 m/s it is within 0.1 m of the origin after 6 periods, and beyond the wall later."""
    task = Pass()
    [scenario] = each(scenarios(task, PLATFORM, 5, 1))
    flight = optima.episode(
        PLATFORM, task, Timing(0.2, episode_steps=25), scenario, made_up(25, 0.2)
    )
    assert settling_times(flight) == pytest.approx([1.2])
    assert not flight.violated().any()
    far = optima.episode(PLATFORM, task, Timing(0.2, episode_steps=5), scenario, made_up(5, 0.2))
    assert settling_times(far) == [math.inf]
