"""Telemetry in InnoCube's layout, of a satellite whose momentum is known in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_robot.identify.log import FlightLog, checked_satellite_log, read_csv
from rans_robot.identify.telemetry import read_telemetry

import rans
from rans.cli import main
from rans.errors import ConfigError
from rans.model.spacecraft_file import load_spacecraft

INNOCUBE = load_spacecraft("innocube")
INERTIA = np.array([[700.0, 20.0, 0.0], [20.0, 800.0, -10.0], [0.0, -10.0, 150.0]])
"""Of body and locked wheels, over that of a wheel."""
STEP = 0.1
NAMES = ("Attitude quaternion", "Rates", "RW Speeds", "RW CMDs")


def hamilton(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    w, x, y, z = a.tolist()
    p, q, r, s = b.tolist()
    return np.array(
        [
            w * p - x * q - y * r - z * s,
            w * q + x * p + y * s - z * r,
            w * r - x * s + y * p + z * q,
            w * s + x * r - y * q + z * p,
        ]
    )


def fly(folder: Path, torque: float, swapped: bool = False) -> Path:
    """Write 160 s under wheels of three frequencies and a constant torque about z, which is that of both goals.

    The momentum of the whole is known in closed form; only the attitude is integrated, by the midpoint rule. After
    80 s the goal is another one, half a turn about z away, so that the attitude relative to it jumps.
    """
    random = np.random.default_rng(7)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    inverse = np.linalg.inv(INERTIA)
    start = INERTIA @ [0.02, -0.01, 0.05]
    rate = np.array([0.05, 0.07, 0.03])
    lines: dict[str, list[str]] = {name: [] for name in NAMES}

    def speeds(t: float) -> np.ndarray:
        return np.array([4.0, 3.0, 1.0]) / rate * (1.0 - np.cos(rate * t))

    def spin(q: np.ndarray, t: float) -> np.ndarray:
        whole = np.array([0.0, start[0], start[1], start[2] + torque * t])
        inside = hamilton(hamilton(q * [1.0, -1.0, -1.0, -1.0], whole), q)[1:]
        return inverse @ (inside + speeds(t))

    for k in range(round(160.0 / STEP)):
        t = k * STEP
        if k % round(2.0 / STEP) == 0:
            stamp = f"2025-12-13 11:{28 + int(t) // 60:02d}:{int(t) % 60:02d}"
            read = speeds(t)[[1, 0, 2]] if swapped else speeds(t)
            rpm = read * 60.0 / (2.0 * np.pi) + random.normal(0.0, 0.5, 3)
            rates = np.rad2deg(spin(q, t))
            seen = q if t < 80.0 else hamilton(np.array([0.0, 0.0, 0.0, -1.0]), q)
            rows = (
                [f"{x:.4f}" for x in seen],
                [f"{x:.3f} °/s" for x in rates],
                [f"{x:.0f} rpm" for x in rpm],
                ["0 RPM/s"] * 3,
            )
            for name, cells in zip(NAMES, rows, strict=True):
                lines[name].append(",".join([stamp, *cells]))
        half = q + 0.25 * STEP * hamilton(q, np.array([0.0, *spin(q, t)]))
        half = half / np.linalg.norm(half)
        q = q + 0.5 * STEP * hamilton(half, np.array([0.0, *spin(half, t + 0.5 * STEP)]))
        q = q / np.linalg.norm(q)
    folder.mkdir()
    for name, rows in lines.items():
        head = '"Time","q0","q1","q2","q3"' if name == NAMES[0] else '"Time","X","Y","Z"'
        text = "\ufeff" + "\n".join([head, *rows])
        (folder / f"{name}-data-as-joinbyfield.csv").write_text(text, "utf-8")
    return folder


def csv_of(log: FlightLog, file: Path) -> Path:
    """The same log as a CSV file, without positions and commands."""
    names = "time,qw,qx,qy,qz,wx,wy,wz,s0,s1,s2"
    assert log.wheel_speeds is not None
    rows = np.column_stack([log.times, log.attitude, log.spin, log.wheel_speeds])
    np.savetxt(file, rows, delimiter=",", header=names, comments="")
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(tmp_path_factory.mktemp("telemetry") / "day", 0.5)


def test_inertia_and_torque_are_identified_over_two_goals(folder: Path, tmp_path: Path) -> None:
    """The command, from a data sheet whose moments are 5 to 20 % off.

    Speeds reach 160 rad/s and the torque adds 80 (of a wheel's inertia); a reading is rounded to 0.1 rad/s.
    """
    log = checked_satellite_log(read_telemetry(folder, INNOCUBE), INNOCUBE)
    assert log.frames is not None
    assert log.frames.tolist() == [0] * 40 + [1] * 40
    out = tmp_path / "out"
    assert main(f"identify {folder} --spacecraft innocube --output {out}".split()) == 0
    found = rans.load_spacecraft(out / "spacecraft.toml")
    wheel = np.mean([one.inertia for one in found.wheels])
    rotors = np.diag([one.inertia for one in found.wheels])
    whole = (np.array(found.inertia) + rotors) / wheel
    assert np.diag(whole) == pytest.approx(np.diag(INERTIA), rel=0.02)
    assert whole[0, 1] == pytest.approx(20.0, abs=8.0)
    # The sum of the moments is the file's: nothing else says the scale.
    assert np.trace(np.array(found.inertia)) == pytest.approx(np.trace(np.array(INNOCUBE.inertia)))
    torque = json.loads((out / "identified.json").read_text("utf-8"))["external torque"][0]
    means = np.array(torque["N m in the axes of the first attitudes"]) / wheel
    # Rates over 2 s carry the axes of the first goal to those of the second, within about a degree.
    assert means == pytest.approx(np.tile([0.0, 0.0, 0.5], (len(means), 1)), abs=0.01)
    assert rans.load_conditions(out / "conditions.toml").disturbances.torque != (0.0, 0.0)


def test_a_csv_file_of_attitude_rates_and_speeds_is_the_same_log(
    folder: Path, tmp_path: Path
) -> None:
    log = read_telemetry(folder, INNOCUBE)
    again = read_csv(csv_of(log, tmp_path / "log.csv"), INNOCUBE)
    for name in ("times", "attitude", "spin", "wheel_speeds"):
        assert getattr(again, name) == pytest.approx(getattr(log, name))
    file = tmp_path / "less.csv"
    file.write_text("time,qw,qx,qy,qz,wx,wy,wz,s0,s1\n", "utf-8")
    with pytest.raises(ConfigError, match="has no s2 among its columns"):
        read_csv(file, INNOCUBE)


def test_other_orders_signs_and_units_are_named(folder: Path) -> None:
    """Planted errors: each is refused with what it is."""
    log = read_telemetry(folder, INNOCUBE)
    log = FlightLog(**{**vars(log), **{k: v[:40] for k, v in vars(log).items() if k in PARTS}})
    assert log.wheel_speeds is not None
    wrong: dict[str, dict[str, Any]] = {
        "from world to body": {"attitude": log.attitude * [1.0, -1.0, -1.0, -1.0]},
        "scalar of the quaternions the last": {"attitude": log.attitude[:, [1, 2, 3, 0]]},
        "rates in degrees/s": {"spin": np.rad2deg(log.spin)},
        "counted against the axis": {"wheel_speeds": -log.wheel_speeds},
        "speeds of 2 wheels": {"wheel_speeds": log.wheel_speeds[:, :2]},
        "0 rows with attitude, rates and speeds": {"spin": np.full_like(log.spin, np.nan)},
    }
    for sentence, change in wrong.items():
        with pytest.raises(ConfigError, match=sentence):
            rans.identify(FlightLog(**{**vars(log), **change}), INNOCUBE)


def test_speeds_in_revolutions_a_minute_are_named(folder: Path, tmp_path: Path) -> None:
    """Numbers of a CSV file have no units; wheels of a tenth of the inertia turn a satellite alike."""
    log = read_telemetry(folder, INNOCUBE)
    assert log.wheel_speeds is not None
    wrong = replace(log, wheel_speeds=log.wheel_speeds * 60.0 / (2.0 * np.pi))
    found = rans.identify(wrong, INNOCUBE)
    with pytest.raises(ConfigError, match="revolutions a minute"):
        found.write(tmp_path / "out")


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (0, "0 rows with attitude, rates and speeds"),
        (1, "1 row with attitude, rates and speeds"),
        (60, "speeds of its wheels never change"),
    ],
)
def test_a_satellite_at_rest_is_refused(rows: int, words: str, tmp_path: Path) -> None:
    """Wheels at a constant speed, and no rows at all, which was an error without a sentence."""
    lines = [
        "time,qw,qx,qy,qz,wx,wy,wz,s0,s1,s2",
        *[f"{2 * k},1{',0' * 6},9,9,9" for k in range(rows)],
    ]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(ConfigError, match=words):
        rans.identify(file, INNOCUBE)


def slow_turn(noise: float) -> FlightLog:
    """A turn about a tilted axis of the body at 0.012 rad/s, read every second with errors of the attitude, rad."""
    random = np.random.default_rng(3)
    times = np.arange(0.0, 400.0)
    axis = np.array([0.6, 0.64, 0.48])
    half = 0.5 * 0.012 * times[:, None]
    q = np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)
    q = q + 0.5 * random.normal(0.0, noise, q.shape)
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    rates = np.tile(0.012 * axis, (len(times), 1))
    nothing = np.full((len(times), 3), np.nan)
    commands = np.empty((0, 3))
    speeds = np.outer(np.sin(0.01 * times), np.ones(3))
    return FlightLog("slow", np.empty(0), commands, times, nothing, q, nothing, rates, speeds)


def test_a_slow_turn_is_compared_over_more_rows() -> None:
    """Errors between two rows, 0.02 rad, are larger than its turn; axes in another order are still refused."""
    log = slow_turn(0.015)
    assert checked_satellite_log(log, INNOCUBE) is log
    wrong = FlightLog(**(vars(log) | {"spin": log.spin[:, [2, 0, 1]] * [-1.0, 1.0, -1.0]}))
    with pytest.raises(ConfigError, match="do not turn as its rates say"):
        checked_satellite_log(wrong, INNOCUBE)


def test_wheels_in_another_order_are_refused(tmp_path: Path) -> None:
    """A planted error, which no sign of an inertia shows."""
    found = rans.identify(fly(tmp_path / "a", 0.0, swapped=True), INNOCUBE)
    with pytest.raises(ConfigError, match="wheels in another order"):
        found.write(tmp_path / "out")


PARTS = ("times", "attitude", "spin", "wheel_speeds", "position", "velocity")


@pytest.mark.parametrize("row", ["2025-12-13 11:28:46,1,2", "yesterday,1,2,3", "2025-12-13,a,2,3"])
def test_a_damaged_row_is_answered_by_a_sentence(tmp_path: Path, row: str) -> None:
    (tmp_path / "attitude.csv").write_text("Time,q0,q1,q2,q3\n", "utf-8")
    (tmp_path / "rates.csv").write_text(f"Time,X,Y,Z\n{row}\n", "utf-8")
    with pytest.raises(ConfigError, match=r"rates\.csv, line 2: "):
        read_telemetry(tmp_path, INNOCUBE)


def test_other_units_and_columns_are_refused(tmp_path: Path) -> None:
    (tmp_path / "attitude.csv").write_text("Time,q1,q2,q3,q0\n", "utf-8")
    with pytest.raises(ConfigError, match="must have the columns Time, q0, q1, q2, q3"):
        read_telemetry(tmp_path, INNOCUBE)
    (tmp_path / "attitude.csv").write_text("Time,q0,q1,q2,q3\n", "utf-8")
    row = "2025-12-13 11:28:46,1 rad/s,2 rad/s,3 rad/s"
    (tmp_path / "rates.csv").write_text(f"Time,X,Y,Z\n{row}\n", "utf-8")
    with pytest.raises(ConfigError, match="the unit of each number must be °/s"):
        read_telemetry(tmp_path, INNOCUBE)
    with pytest.raises(ConfigError, match="has 0 and 8 thrusters"):
        read_telemetry(tmp_path, load_spacecraft("floating-platform"))


def test_a_folder_without_rates_is_answered_by_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "attitude.csv").write_text("Time,q0,q1,q2,q3\n", "utf-8")
    with pytest.raises(ConfigError, match=r"must have one file Rates\*\.csv, got 0"):
        read_telemetry(tmp_path, INNOCUBE)
