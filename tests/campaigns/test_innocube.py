"""Telemetry in InnoCube's layout, of a craft whose momentum is known in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from campaigns.innocube import identified, read_manoeuvre
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


def fly(folder: Path, torque: float, swapped: bool = False) -> Path:
    """Write 160 s under wheels of three frequencies and a constant inertial torque about z.

    The momentum of the whole is known in closed form; only the attitude is integrated, by the midpoint rule.
    """
    random = np.random.default_rng(7)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    inverse = np.linalg.inv(INERTIA)
    start = INERTIA @ [0.02, -0.01, 0.05]
    rate = np.array([0.05, 0.07, 0.03])
    lines: dict[str, list[str]] = {"attitude": [], "rates": [], "wheel-speeds": []}

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
            lines["attitude"].append(",".join([stamp, *(f"{x:.4f}" for x in q)]))
            lines["rates"].append(",".join([stamp, *(f"{x:.3f} °/s" for x in rates)]))
            lines["wheel-speeds"].append(",".join([stamp, *(f"{x:.0f} rpm" for x in rpm)]))
        half = q + 0.25 * STEP * hamilton(q, np.array([0.0, *spin(q, t)]))
        half = half / np.linalg.norm(half)
        q = q + 0.5 * STEP * hamilton(half, np.array([0.0, *spin(half, t + 0.5 * STEP)]))
        q = q / np.linalg.norm(q)
    folder.mkdir()
    for name, rows in lines.items():
        head = '"Time","q0","q1","q2","q3"' if name == "attitude" else '"Time","X","Y","Z"'
        (folder / f"{name}.csv").write_text("\ufeff" + "\n".join([head, *rows]), "utf-8")
    return folder


def test_inertia_is_identified_under_an_external_torque(tmp_path: Path) -> None:
    """Speeds reach 160 rad/s, and the torque adds 80. Rounding leaves 0.1; without the torque its drift is left."""
    telemetry = read_manoeuvre(fly(tmp_path / "a", 0.5))
    found = identified(telemetry, constant=True, powers=0)
    assert found.moments == pytest.approx(np.diag(INERTIA), rel=0.01)
    assert found.residual < 0.5
    assert abs(found.correlation) < found.bound
    without = identified(telemetry, constant=False, powers=0)
    assert without.residual > 5.0 * found.residual
    assert without.correlation > without.bound


@pytest.mark.slow
def test_exchanged_wheels_are_seen_in_the_residual(tmp_path: Path) -> None:
    """A planted error."""
    found = identified(read_manoeuvre(fly(tmp_path / "a", 0.0, swapped=True)), True, 2)
    assert found.residual > 2.0
    assert abs(found.moments[0] / 700.0 - 1.0) > 0.05


@pytest.mark.parametrize("row", ["2025-12-13 11:28:46,1,2", "yesterday,1,2,3", "2025-12-13,a,2,3"])
def test_a_damaged_row_is_answered_by_a_sentence(tmp_path: Path, row: str) -> None:
    (tmp_path / "attitude.csv").write_text("Time,q0,q1,q2,q3\n", "utf-8")
    (tmp_path / "rates.csv").write_text(f"Time,X,Y,Z\n{row}\n", "utf-8")
    with pytest.raises(ConfigError, match=r"rates\.csv, line 2: "):
        read_manoeuvre(tmp_path)
