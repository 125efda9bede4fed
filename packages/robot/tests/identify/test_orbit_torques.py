"""Torques of a satellite in orbit by what they come from, of a motion that is known without the fit's equations."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_robot.identify.fit import fit
from rans_robot.identify.log import FlightLog, checked_satellite_log
from rans_robot.identify.orbit_torques import OrbitTorques
from scipy.integrate import simpson, solve_ivp
from scipy.spatial.transform import Rotation

import rans
from rans.cli import main
from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft

INNOCUBE = load_spacecraft("innocube")
AXES = np.array([wheel.axis for wheel in INNOCUBE.wheels]).T
ROTORS = np.array([wheel.inertia for wheel in INNOCUBE.wheels])
INERTIA = np.array(INNOCUBE.inertia) + AXES * ROTORS @ AXES.T
MU, RADIUS = 3.986004418e14, 6.9e6
RATE = np.sqrt(MU / RADIUS**3)
DIPOLE = np.array([0.02, -0.01, 0.005])
AIR = np.array([2e-7, -1e-7, 3e-7])
ORBIT = Rotation.from_euler("zxz", [0.4, 1.2, 0.3]).as_matrix()
POLE = np.array([0.2, 0.0, -0.98]) / np.hypot(0.2, 0.98)
SECONDS = 900.0
TIMES = np.arange(0.0, SECONDS, 2.0)


def around(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions away from the Earth and of the velocity, and the field, T, in inertial axes."""
    up = ORBIT @ [np.cos(RATE * t), np.sin(RATE * t), 0.0]
    along = ORBIT @ [-np.sin(RATE * t), np.cos(RATE * t), 0.0]
    return up, along, 2.4e-5 * (3.0 * (up @ POLE) * up - POLE)


def flown() -> FlightLog:
    """Euler's equation by SciPy in axes of the body, with wheels of three frequencies and small noise."""

    def speeds(t: float) -> tuple[np.ndarray, np.ndarray]:
        of = np.array([0.05, 0.07, 0.03])
        return 150.0 * (1.0 - np.cos(of * t)), 150.0 * of * np.sin(of * t)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        back = Rotation.from_quat(y[:4]).as_matrix().T
        w = y[4:]
        up, along, field = (back @ v for v in around(t))
        torque = 3.0 * RATE**2 * np.cross(up, INERTIA @ up)
        torque = torque + np.cross(DIPOLE, field) + np.cross(AIR, -along)
        s, change = speeds(t)
        momentum = INERTIA @ w + AXES @ (ROTORS * s)
        rate = np.linalg.solve(INERTIA, torque - AXES @ (ROTORS * change) - np.cross(w, momentum))
        x, y_, z, a = y[:4]
        q = [a * w[0] + y_ * w[2] - z * w[1], a * w[1] + z * w[0] - x * w[2]]
        q += [a * w[2] + x * w[1] - y_ * w[0], -x * w[0] - y_ * w[1] - z * w[2]]
        return np.concatenate([0.5 * np.array(q), rate])

    start = [0.0, 0.0, 0.0, 1.0, 0.01, -0.02, 0.015]
    found = solve_ivp(slope, (0.0, SECONDS), start, "DOP853", TIMES, rtol=1e-6, atol=1e-9)
    read = np.array([speeds(t)[0] for t in TIMES])
    return read_by(Rotation.from_quat(found.y[:4].T), found.y[4:].T, read)


def turning() -> FlightLog:
    """A constant spin, which no equation of motion needs to explain."""
    spin = np.array([0.01, -0.02, 0.015])
    turns = Rotation.from_rotvec(np.outer(TIMES, spin))
    return read_by(turns, np.tile(spin, (len(TIMES), 1)), np.zeros((len(TIMES), 3)))


def read_by(turns: Rotation, spin: np.ndarray, speeds: np.ndarray) -> FlightLog:
    """Readings with noise of good sensors."""
    random = np.random.default_rng(3)
    up, _, field = (np.array(x) for x in zip(*map(around, TIMES), strict=True))
    position = RADIUS * up + random.normal(0.0, 10.0, up.shape)
    nothing = np.full_like(spin, np.nan)
    return FlightLog(
        "flown",
        np.empty(0),
        np.empty((0, 3)),
        TIMES,
        position,
        turns.as_quat()[:, [3, 0, 1, 2]],
        nothing,
        spin + random.normal(0.0, 1e-5, spin.shape),
        speeds + random.normal(0.0, 0.01, speeds.shape),
        field=turns.inv().apply(field) + random.normal(0.0, 1e-7, up.shape),
    )


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return flown()


@pytest.mark.slow
def test_each_torque_is_separated_from_the_others(log: FlightLog) -> None:
    """Dipole and air within four standard deviations, which are a tenth of them, and the gradient within 1 %."""
    found = fit(INNOCUBE, [log]).momentum
    assert found is not None
    gradient, dipole, air = found.sources
    for part, truth in ((dipole, DIPOLE), (air, AIR)):
        deviation = np.sqrt(np.diag(part.covariance))
        assert np.all(np.abs(part.values - truth) < 4.0 * deviation)
        assert np.all(deviation < 0.15 * np.linalg.norm(truth))
    # The mean over a stretch by hand, from the path that was read.
    turn = Rotation.from_quat(log.attitude[:, [1, 2, 3, 0]])
    up = np.array([around(t)[0] for t in log.times])
    own = turn.inv().apply(up)
    truth = turn.apply(3.0 * RATE**2 * np.cross(own, own @ INERTIA))
    ends = gradient.torque.times
    means = [
        truth[(log.times >= a) & (log.times < b)].mean(axis=0) for a, b in itertools.pairwise(ends)
    ]
    largest = np.abs(means).max()
    np.testing.assert_allclose(gradient.torque.torque, means, rtol=0.0, atol=0.06 * largest)


AXIS = np.array([0.48, -0.6, 0.64])
KNOTS = np.linspace(0.0, SECONDS - 6.0, 21)


def swinging(times: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Attitudes, and rates in the body, of a turn about one axis whose speed changes, up to 4 degrees/s."""
    angle = 0.03 * times - 0.8 * (np.cos(0.05 * times) - 1.0)
    rate = 0.03 + 0.04 * np.sin(0.05 * times)
    return Rotation.from_rotvec(np.outer(angle, AXIS)), np.outer(rate, AXIS)


def swung(instants: np.ndarray, stamps: np.ndarray) -> OrbitTorques:
    """Torques of a log whose rows were read at instants and have these stamps."""
    turns, spin = swinging(instants)
    rows = len(instants)
    up, _, field = (np.array(x) for x in zip(*map(around, instants), strict=True))
    attitude = turns.as_quat()[:, [3, 0, 1, 2]]
    log = FlightLog(
        "swung",
        np.empty(0),
        np.empty((0, 3)),
        stamps,
        RADIUS * up,
        attitude,
        np.full((rows, 3), np.nan),
        spin,
        np.zeros((rows, 3)),
        field=turns.inv().apply(field),
    )
    return OrbitTorques(log, np.arange(rows), turns.as_matrix())


def mean_gradient() -> np.ndarray:
    """Means between `KNOTS` by SciPy's Simpson rule in steps of a twentieth of a second."""
    means = []
    for a, b in itertools.pairwise(KNOTS):
        fine = np.linspace(a, b, 901)
        turns, _ = swinging(fine)
        up = np.array([around(t)[0] for t in fine])
        own = turns.inv().apply(up)
        torque = turns.apply(3.0 * MU / RADIUS**3 * np.cross(own, own @ INERTIA))
        means.append(simpson(torque, x=fine, axis=0) / (b - a))
    return np.array(means)


def means_of(torques: OrbitTorques) -> np.ndarray:
    """Means between `KNOTS` of what was integrated."""
    momentum = torques.gradient(INERTIA)
    at = np.stack([np.interp(KNOTS, torques.times, column) for column in momentum.T], axis=1)
    return np.diff(at, axis=0) / np.diff(KNOTS)[:, None]


def test_rows_far_apart_give_the_integral_of_the_turn_between_them() -> None:
    """At 12 degrees from row to row sums over the rows alone are 0.35 % off."""
    times = np.arange(0.0, SECONDS + 3.0, 3.0)
    truth = mean_gradient()
    off = np.abs(means_of(swung(times, times)) - truth).max()
    assert off < 1e-3 * np.abs(truth).max()


def test_the_interval_of_a_gradient_holds_it_under_stamps_of_whole_seconds() -> None:
    """Rows are read at any part of the second that their stamp names, and attitudes alone are exact."""
    random = np.random.default_rng(5)
    stamps = np.arange(0.0, SECONDS + 1.0, 2.0)
    instants = stamps + random.random(len(stamps))
    torques = swung(instants, stamps)
    _, spin = swinging(instants)
    apart = 0.29 * np.linalg.norm(spin, axis=1)
    off = means_of(torques) - mean_gradient()
    ratio = off / torques.gradient_error(INERTIA, KNOTS, 0.41, apart)
    # The common error, which is half a second here and 0.41 s in the interval, makes it 1.2.
    assert 0.8 < np.sqrt(np.mean(ratio**2)) < 1.5
    assert np.mean(np.abs(ratio) < 1.96) > 0.85


@pytest.mark.slow
def test_the_command_says_the_parts(
    log: FlightLog, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = "time,qw,qx,qy,qz,wx,wy,wz,s0,s1,s2,x,y,z,bx,by,bz"
    assert log.wheel_speeds is not None
    assert log.field is not None
    table = [log.times, log.attitude, log.spin, log.wheel_speeds, log.position, log.field]
    file = tmp_path / "log.csv"
    np.savetxt(file, np.column_stack(table), delimiter=",", header=names, comments="")
    out = tmp_path / "out"
    assert main(f"identify {file} --spacecraft innocube --output {out}".split()) == 0
    assert "gravity gradient" in capsys.readouterr().out
    table = json.loads((out / "identified.json").read_text("utf-8"))
    rows = {row["name"]: row for row in table["quantities"]}
    assert rows["dipole x"]["low"] < DIPOLE[0] < rows["dipole x"]["high"]
    assert {one["part"] for one in table["parts of the external torque"]} == {
        "gravity gradient",
        "magnetic dipole",
        "air",
    }
    found = rans.identify(without_field(file), "innocube")
    assert "bx, by, bz" in " ".join(found.notes())


def without_field(file: Path) -> Path:
    """Write the log of a file without its magnetic field into another one."""
    lines = [line.rsplit(",", 3)[0] for line in file.read_text("utf-8").splitlines()]
    other = file.with_name("other.csv")
    other.write_text("\n".join(lines), "utf-8")
    return other


def _with_earth(log: FlightLog) -> FlightLog:
    turn = Rotation.from_rotvec(np.outer(log.times, [0.0, 0.0, -7.292115e-5]))
    return replace(log, position=turn.apply(log.position))


def _inertial_field(log: FlightLog) -> FlightLog:
    return replace(log, field=np.array([around(t)[2] for t in log.times]))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (_with_earth, "turn with the Earth"),
        (_inertial_field, "inertial axes, or in those of the sensor"),
        (lambda log: replace(log, position=log.position / 1e3), "in km"),
        (lambda log: replace(log, field=log.field * 1e9), "in nT"),
        (
            lambda log: replace(
                log, position=np.where(log.times[:, None] < 300, log.position, np.nan)
            ),
            "gaps",
        ),
    ],
)
def test_other_axes_and_units_are_refused(change: object, complaint: str) -> None:
    log = turning()
    wrong = change(log)  # type: ignore[operator]
    rotation = Rotation.from_quat(log.attitude[:, [1, 2, 3, 0]]).as_matrix()
    index = np.arange(len(log.times))
    OrbitTorques(log, index, rotation)
    with pytest.raises(ConfigError, match=complaint):
        OrbitTorques(wrong, index, rotation)


def test_an_attitude_relative_to_goals_has_no_orbit() -> None:
    log = turning()
    attitude = log.attitude.copy()
    attitude[200:] = attitude[200:, [3, 2, 1, 0]] * [-1.0, -1.0, 1.0, 1.0]
    with pytest.raises(ConfigError, match="relative to a goal"):
        checked_satellite_log(replace(log, attitude=attitude), INNOCUBE)
