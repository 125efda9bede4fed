"""Flights that were computed elsewhere fly as they are written, and wrong files are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rans import ConfigError
from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.entrants import contest_of, enlist


def short(steps: int, count: int = 1) -> Contest:
    """The first starts of dock, for the first control periods only."""
    contest = contest_of("mission:dock-3d", count)
    return replace(contest, timing=replace(contest.timing, episode_steps=steps))


def written(folder: Path, text: str) -> Path:
    file = folder / "flights.csv"
    file.write_text(text)
    return file


def test_a_flight_that_is_too_fast_breaks_the_limit(tmp_path):
    contest = short(6)
    toward = -np.ravel(contest.start(0).start.p.columns())
    command = np.zeros(6)
    # Thrusters are along x, -x, y, -y, z, -z; full thrust for 50 s changes it by 4 m/s.
    command[2 * np.arange(3) + (toward < 0)] = 1.0
    rows = [f"0,{10 * k}," + ",".join(map(str, command)) for k in range(5)]
    header = "start,time," + ",".join(f"command.{k}" for k in range(6))
    file = written(tmp_path, "\n".join([header, *rows]))
    assert contest.fly(enlist(str(file), contest).controller).violated()[0]


def test_every_start_flies_its_own_flight_however_many_there_are(tmp_path):
    """Controllers that say that they are slow fly eight episodes at a time, numbered from 0 each time."""
    contest = short(1, 9)
    file = written(tmp_path, "\n".join([DV.strip(), *(f"{k},0,{0.01 * k},0,0" for k in range(9))]))
    controller = enlist(str(file), contest).controller
    controller.slow = True  # pyrefly: ignore[missing-attribute]
    flight = contest.fly(controller, workers=1)
    # A full command of 1 N changes the velocity of 12 kg by 1 / 1.2 m/s in 10 s.
    assert flight.commands[0, :, 0] == pytest.approx(0.012 * np.arange(9))


DV = "start,time,dv.x,dv.y,dv.z\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "is empty"),
        ("start,time,dv.x\n0,0,1\n", "no column command.0"),
        (DV + "0,0,much,0,0\n", "line 2: dv.x must be a finite number"),
        (DV + "0,7,0.1,0,0\n", "multiple of the control period of 10 s, got 7 s"),
        (DV + "0,2000,0.1,0,0\n", "time must be 0 to 1990 s"),
        (DV + "0,0,0.9,0,0\n", "at most 0.8333 m/s along an axis"),
        (DV + "1,0,0.1,0,0\n", "without a gap, got 1"),
        (DV + "0,0,0.1,0,0\n0,0,0.1,0,0\n", "line 3: start 0 has two rows for 0 s"),
        (DV, "without a gap, got none"),
    ],
)
def test_wrong_files_are_refused(tmp_path, text, problem):
    with pytest.raises(ConfigError, match=problem):
        enlist(str(written(tmp_path, text)), contest_of("mission:dock-3d", 1))
