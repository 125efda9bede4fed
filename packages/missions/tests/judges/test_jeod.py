"""Flights on orbits against NASA's JEOD (`rans_missions/judges/jeod.toml` has the figures and their source)."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_missions.judges import jeod
from rans_missions.judges.jeod import RUNS, Run, differences, rows
from rans_missions.judges.logs import COLUMNS, TIME, logged
from rans_missions.orbits.elliptic import EllipticOrbit

from rans.errors import ConfigError
from rans.model import dynamics
from rans.model.fields import Quat, Vec3

SHORT = {
    "6C": 1440,
    "6D": 1440,
    "8A": 14400,
    "8B": 14400,
    "9A": 2160,
    "9B": 2160,
    "9D": 2400,
    "10C": 480,
}
"""Times, s, at which the default tests end."""


@pytest.mark.parametrize("name", SHORT)
def test_the_start_of_a_run_is_that_of_jeod(name: str) -> None:
    (row,) = rows({name: (_cut(RUNS[name], SHORT[name]), "log")})
    assert row.passed, row.differences()
    # The fields that a run has: sixteen digits of 17 rad, and the log has as many.
    found = {check.name: check.value for check in row.checks}
    assert found["attitude"] < 1e-9
    assert found["spin"] < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_eight_hours_are_those_of_jeod(name: str) -> None:
    (row,) = rows({name: (RUNS[name], "log")})
    assert row.passed, row.differences()


def _cut(run: Run, until: int) -> Run:
    """A run without figures after a time, s."""
    return replace(
        run,
        motion={time: x for time, x in run.motion.items() if time <= until},
        turning={time: x for time, x in run.turning.items() if time <= until},
    )


def _no_turn(orbit: EllipticOrbit, t: float) -> Quat:
    return Quat(1.0, 0.0, 0.0, 0.0)


def _other_way(orbit: EllipticOrbit, t: float) -> Quat:
    return TRUE_TURN(orbit, t).inverse()


def _half(orbit: EllipticOrbit, t: float) -> Quat:
    return TRUE_TURN(orbit, 0.5 * t)


TRUE_TURN = EllipticOrbit.turn


@pytest.mark.parametrize("planted", [_no_turn, _other_way, _half])
@pytest.mark.parametrize("name", ["9A", "9B"])
def test_a_frame_that_turns_wrongly_is_far_from_jeod(
    monkeypatch: pytest.MonkeyPatch, planted: Any, name: str
) -> None:
    """The fault is in the engine alone: positions and axes of the orbit stay right."""
    run = _cut(RUNS[name], 1680)
    orbit = jeod.Orbit(run.motion[0])
    right = {time: orbit.axes(time) for time in (0, *run.motion)}
    monkeypatch.setattr(EllipticOrbit, "turn", planted)
    monkeypatch.setattr(jeod.Orbit, "axes", lambda orbit, time: right[time])
    assert differences(run).values["attitude"] > 10.0


@pytest.mark.parametrize("factor", [0.0, -1.0, 1.0 / 3.0, 1.001])
def test_a_wrong_gradient_of_gravity_is_far_from_jeod(
    monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    true = dynamics._gradient
    monkeypatch.setattr(
        dynamics, "_gradient", lambda drift, h: [x * factor for x in true(drift, h)]
    )
    # Even a thousandth of the torque is 1e6 times the bound.
    (row,) = rows({"10C": (_cut(RUNS["10C"], 480), "log")})
    assert not row.passed
    assert differences(_cut(RUNS["10C"], 480)).values["attitude"] > 1e-4


@pytest.mark.parametrize("speed", [0.7, 1.3, 1.41, 1.6])
def test_a_new_target_changes_no_motion(speed: float) -> None:
    """On ellipses, one too long for `EllipticOrbit`, and a hyperbola: place, velocity, attitude and spin are kept.

    Only the turn of the frame that is left out at the offset of a circle's target would be 3 km x n = 4 m/s.
    """
    p, v = (np.array(x) for x in RUNS["6D"].motion[0])
    first = jeod.Orbit((tuple(p), tuple(v)))
    spin, logged = RUNS["9B"].turning[0]
    state = jeod._at_target(first, jeod.body_to_inertial(logged), np.array(spin))
    push = first.axes(0.0).inv().apply((speed - 1.0) * v + 0.05 * p / 900.0)
    state = replace(state, v=Vec3(*map(float, push)))
    before = *first.inertial(state, 0.0, along_arc=False), *jeod._inertial_turn(state, first, 0.0)
    state, new, length = jeod._renewed(state, first, 0.0)
    after = *new.inertial(state, 0.0, along_arc=False), *jeod._inertial_turn(state, new, 0.0)
    assert math.isinf(length) == (speed < 1.35)
    assert length > 0.5
    assert np.linalg.norm(after[0] - before[0]) < 1e-6
    assert np.linalg.norm(after[1] - before[1]) < 1e-9
    assert (after[2].inv() * before[2]).magnitude() < 1e-14
    np.testing.assert_allclose(after[3], before[3], atol=1e-17)


def _log(folder: Path, name: str, run: Run, header: list[str] | None = None) -> Path:
    """A log with JEOD's columns among others, as its simulation writes them."""
    columns = [TIME, "vehicle.dyn_body.derivs.rot_accel[0] {rad/s2}"]
    columns += [column for names in COLUMNS.values() for column in names]
    lines = [",".join(header or columns)]
    for time in sorted({*run.motion} & {*run.turning}):
        values = (*run.motion[time][0], *run.motion[time][1])
        values += (*run.turning[time][0], *run.turning[time][1])
        lines.append(",".join([f"{time:>20}", "0", *(f"{x:>20.16g}" for x in values)]))
    file = folder / f"RUN_{name}" / "log_state_ASCII.csv"
    file.parent.mkdir(parents=True)
    file.write_text("\n".join(lines) + "\n", "utf-8")
    return file


def test_logs_of_a_folder_are_read_with_their_start(tmp_path: Path) -> None:
    """The figures of 9B as a log of its own and as that of 9C, whose start and force are other ones."""
    run = RUNS["9B"]
    _log(tmp_path / "SET_test_val", "9B", run)
    _log(tmp_path / "SET_test_val", "9C", run)
    _log(tmp_path / "SET_test_val", "7A", run)
    runs, left = logged(tmp_path)
    assert set(runs) == {"9B", "9C"}
    assert "RUN_7A" in left[0]
    assert runs["9B"][0].turning[1680] == RUNS["9B"].turning[1680]
    assert differences(_cut(runs["9B"][0], 2040)).values["attitude"] < 1e-9
    assert (runs["9C"][0].force, runs["9C"][0].torque) == ((10.0, 0.0, 0.0), 10.0)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("{rad/s}", "{deg/s}"), r"ang_vel_this\[0\] \{rad/s\}"),
        (("                1680", "                1680.5"), "1680.5"),
        (("6.713", "nan #"), "line 3"),
        (("                   0", "                  10"), "no row at 0 s"),
    ],
)
def test_a_damaged_log_is_refused(tmp_path: Path, change: tuple[str, str], complaint: str) -> None:
    file = _log(tmp_path, "9A", RUNS["9A"])
    text = file.read_text("utf-8")
    assert change[0] in text
    file.write_text(text.replace(*change), "utf-8")
    with pytest.raises(ConfigError, match=complaint):
        logged(tmp_path)


def test_a_log_that_was_cut_short_is_refused(tmp_path: Path) -> None:
    """Between two rows, where all that is left agrees, and within a row."""
    file = _log(tmp_path, "9A", _cut(RUNS["9A"], 1680))
    with pytest.raises(ConfigError, match="ends at 1680 s, and the flight lasts 28800 s"):
        logged(tmp_path)
    text = file.read_text("utf-8")
    file.write_text(text[: text.rindex(",")], "utf-8")
    with pytest.raises(ConfigError, match="line 3, has 14 cells instead of 15"):
        logged(tmp_path)


def test_a_folder_without_logs_is_refused(tmp_path: Path, refused: Any) -> None:
    assert "RUN_X" in refused(f"validate --judges {tmp_path}")
    refused("validate --judges --layer thrusters")
