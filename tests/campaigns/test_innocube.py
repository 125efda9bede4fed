"""Telemetry in InnoCube's layout, of a craft whose momentum is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from campaigns.innocube import identified
from campaigns.innocube_telemetry import Telemetry, manoeuvre_folders, read_manoeuvre
from rans.errors import ConfigError

INERTIA = np.array([[700.0, 20.0, 0.0], [20.0, 800.0, -10.0], [0.0, -10.0, 150.0]])
"""Over a wheel's."""
STEP = 0.1


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


NAMES = ("Attitude quaternion", "Rates", "RW Speeds", "RW CMDs")


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


def test_inertia_is_identified_under_an_external_torque_and_two_goals(tmp_path: Path) -> None:
    """Speeds reach 160 rad/s, and the torque adds 80. Rounding leaves 0.1; without the torque its drift is left."""
    fly(tmp_path / "a", 0.5)
    (folder,) = manoeuvre_folders(tmp_path)
    telemetry = read_manoeuvre(folder)
    assert telemetry.goals.tolist() == [0] * 40 + [1] * 40
    result = identified(telemetry, torque=True)
    assert result.moments == pytest.approx(np.diag(INERTIA), rel=0.01)
    assert result.residual < 0.5
    assert abs(result.correlation) < result.bound
    without = identified(telemetry, torque=False)
    assert without.residual > 5.0 * result.residual
    assert without.correlation > without.bound

    # A planted error: a reader that takes both goals for one.
    t = telemetry
    mixed = Telemetry(t.times, t.attitude, t.rates, t.speeds, t.commands, 0 * t.goals)
    assert identified(mixed, torque=True).residual > 20.0 * result.residual


@pytest.mark.slow
def test_exchanged_wheels_are_seen_in_the_residual(tmp_path: Path) -> None:
    """A planted error."""
    result = identified(read_manoeuvre(fly(tmp_path / "a", 0.0, swapped=True)), torque=True)
    assert result.residual > 2.0
    assert abs(result.moments[0] / 700.0 - 1.0) > 0.05


@pytest.mark.parametrize("row", ["2025-12-13 11:28:46,1,2", "yesterday,1,2,3", "2025-12-13,a,2,3"])
def test_a_damaged_row_is_answered_by_a_sentence(tmp_path: Path, row: str) -> None:
    (tmp_path / "Attitude quaternion.csv").write_text("Time,q0,q1,q2,q3\n", "utf-8")
    (tmp_path / "Rates.csv").write_text(f"Time,X,Y,Z\n{row}\n", "utf-8")
    with pytest.raises(ConfigError, match=r"Rates\.csv, line 2: "):
        read_manoeuvre(tmp_path)


def test_a_folder_without_telemetry_is_answered_by_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="give a clone of kdjebko/lelar-in-orbit-data"):
        manoeuvre_folders(tmp_path)
    (tmp_path / "Attitude quaternion.csv").write_text("Time,q0,q1,q2,q3\n", "utf-8")
    with pytest.raises(ConfigError, match=r"must have one file Rates\*\.csv, got 0"):
        read_manoeuvre(tmp_path)
