"""Manoeuvres of InnoCube's telemetry flown again: the law of its PD controller, and whose signs mean what."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_robot.identify.log import FlightLog
from scipy.spatial.transform import Rotation

import rans
from campaigns.innocube_flights import (
    InnoCubePD,
    Manoeuvre,
    apart,
    figures,
    manoeuvres_of,
    simulated,
)
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft

INNOCUBE = load_spacecraft("innocube")
ORIGIN = Vec3(0.0, 0.0, 0.0)
RPM = 2.0 * np.pi / 60.0


def test_the_law_by_hand() -> None:
    """A quarter turn about x, at 0.01 rad/s about z: -670 sin 45 and -500 (1 + sin^2 45) 0.01 rpm/s of 100."""
    half = np.array([np.sqrt(0.5)])
    zero = np.zeros(1)
    spin = Vec3(zero, zero, zero + 0.01)
    goal = SpatialState(ORIGIN, Quat(1.0, 0.0, 0.0, 0.0), ORIGIN, ORIGIN)
    for sign in (1.0, -1.0):  # both quaternions are the same attitude
        attitude = Quat(sign * half, sign * half, zero, zero)
        state = SpatialState(ORIGIN, attitude, ORIGIN, spin)
        command = InnoCubePD().act(state, goal, zero)
        assert command == pytest.approx(np.array([[1.0, 0.0, 0.075]]))
    slight = SpatialState(ORIGIN, Quat(zero + 1.0, zero, zero + 0.01, zero), ORIGIN, spin)
    assert InnoCubePD().act(slight, goal, zero)[0, 1] == pytest.approx(0.067)


def manoeuvre(turn: float) -> Manoeuvre:
    """A start a turn (rad) about a skew axis away, with spin and moving wheels; readings every 2 s for 60 s."""
    times = np.arange(0.0, 61.0, 2.0)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = Rotation.from_rotvec(turn * axis).as_quat(scalar_first=True)
    same = np.ones((len(times), 1))
    return Manoeuvre("PD", times, same * q, same * [0.01, -0.02, 0.03], same * [3.0, -5.0, 9.0])


def log_of(one: Manoeuvre, **parts: np.ndarray) -> FlightLog:
    """A manoeuvre as its reader gives it: speeds about the axes, which the satellite counts against them."""
    none = np.full_like(one.rates, np.nan)
    still = np.zeros_like(one.rates)
    log = FlightLog(
        "log", one.times, still, one.times, none, one.attitude, none, one.rates, -one.speeds
    )
    return replace(log, **parts)


def test_the_fit_finds_the_inertia_of_the_simulated_craft() -> None:
    """Attitude, rates and speeds of a simulation keep the momentum, as the telemetry does: all signs are its."""
    flown = simulated(INNOCUBE, [manoeuvre(1.8)], InnoCubePD())[0]
    wrong = replace(
        INNOCUBE,
        inertia=tuple(
            tuple(x * factor for x in row)
            for row, factor in zip(INNOCUBE.inertia, (1.1, 0.95, 1.2), strict=True)
        ),
    )
    found = rans.identify(log_of(flown), wrong).spacecraft
    scale = found.wheels[0].inertia / INNOCUBE.wheels[0].inertia
    assert np.diag(np.array(found.inertia)) / scale == pytest.approx(
        np.diag(np.array(INNOCUBE.inertia)), rel=1e-3
    )


def test_a_manoeuvre_is_flown_to_its_end_and_measured() -> None:
    start = manoeuvre(1.8)
    flown = simulated(INNOCUBE, [start], InnoCubePD())
    of = figures(flown)
    assert flown[0].errors[0] == pytest.approx(1.8)
    assert of["settled"] == 1
    assert 10.0 < of["time"] < 60.0
    assert of["rest"] < 0.1
    # Two flights of the same start are the same; a degree about z apart is a degree.
    assert apart(flown, flown, 20.0) == [0.0]
    degree = Rotation.from_euler("z", 1.0, degrees=True)
    turned = Rotation.from_quat(flown[0].attitude, scalar_first=True) * degree
    other = replace(flown[0], attitude=turned.as_quat(scalar_first=True))
    assert np.rad2deg(apart(flown, [other], 20.0)) == pytest.approx([1.0])


def test_figures_by_hand() -> None:
    """Ten readings from 20 degrees to 0: the error is below 1 degree from the eighth on, at 14 s."""
    angles = np.deg2rad([20.0, 18.0, 9.0, 5.0, 0.5, 2.0, 1.2, 0.9, 0.4, 0.2])
    q = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_quat(scalar_first=True)
    speeds = np.outer([0.0, 1.0, 3.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [RPM, 0.0, -2.0 * RPM])
    one = Manoeuvre("PD", np.arange(0.0, 20.0, 2.0), q, np.zeros((10, 3)), speeds)
    assert figures([one]) == pytest.approx(
        {
            "count": 1,
            "settled": 1,
            "time": 14.0,
            "rest": 1.6,  # the median of all ten, between 1.2 and 2.0
            "travel": 18.0,  # up by three and down by three revolutions a minute, and twice that
            "fastest": 6.0,
        }
    )
    never = replace(one, attitude=q[::-1])
    assert figures([never])["settled"] == 0


def test_manoeuvres_begin_where_wheels_are_commanded() -> None:
    """Two goals: one that the satellite has, and one far away, commanded from its second row on for 60 s."""
    count = 40
    goals = np.repeat([0, 1], [8, count - 8])
    far = [np.cos(0.5), np.sin(0.5), 0.0, 0.0]
    attitude = np.where((goals == 1)[:, None], far, [1.0, 0.0, 0.0, 0.0])
    commands = np.ones((count, 3)) * (np.arange(count) != 8)[:, None]
    still = np.zeros((count, 3))
    one = Manoeuvre("PD", 2.0 * np.arange(count), attitude, still, still)
    telemetry = log_of(one, commands=commands, frames=goals)
    (only,) = manoeuvres_of(Path("pd/day"), telemetry)
    assert (only.flown_by, only.times[0], only.times[-1]) == ("PD", 0.0, 60.0)
    assert only.errors == pytest.approx(np.ones(31))
