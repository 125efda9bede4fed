"""Flights on orbits against NASA's JEOD (`rans_missions/judges/jeod.toml` has the figures and their source)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from rans_missions.judges import jeod
from rans_missions.judges.jeod import RUNS, Run, differences, rows
from rans_missions.orbits.elliptic import EllipticOrbit

from rans.model import dynamics
from rans.model.fields import Quat

SHORT = {
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
    (row,) = rows({name: _cut(RUNS[name], SHORT[name])})
    assert row.passed, row.differences()
    # The fields that a run has: sixteen digits of 17 rad, and the log has as many.
    found = {check.name: check.value for check in row.checks}
    assert found["attitude"] < 1e-9
    assert found["spin"] < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_eight_hours_are_those_of_jeod(name: str) -> None:
    (row,) = rows({name: RUNS[name]})
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
    (row,) = rows({"10C": _cut(RUNS["10C"], 480)})
    assert not row.passed
    assert differences(_cut(RUNS["10C"], 480)).values["attitude"] > 1e-4
