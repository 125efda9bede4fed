"""CCSDS messages, read by a foreign library and against two-body motion in inertial axes."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ccsds_ndm.ndm_io import NdmIo
from scipy.spatial.transform import Rotation

import rans
from rans.ccsds import EARTH, OrbitState, read_opm, relative_state, write_ccsds
from rans.errors import ConfigError
from rans.flight import Flight, fly
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import scenarios

N = rans.Hold().mean_motion
RADIUS = (EARTH / N**2) ** (1.0 / 3.0)


def read(file: Path) -> Any:
    """Message as another library reads it."""
    return NdmIo().from_path(file)


class Coasting:
    """Fires nothing."""

    name = "coasting"

    def reset(self, count: int) -> None:
        pass

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        return np.zeros((len(observation), 6))


@pytest.fixture(scope="module")
def flight() -> Flight:
    """A coast of 300 s from 100 m above the target at rest, turned by 90 degrees about y."""
    craft, task = load_spacecraft("vbar-chaser"), rans.Hold()
    starts = scenarios(task, craft, 1, 2)
    zero = np.zeros(2)
    half = zero + np.sqrt(0.5)
    start = replace(
        starts.start,
        p=Vec3(zero + 100.0, zero, zero),
        v=Vec3(zero, zero + 0.1, zero),
        attitude=Quat(half, zero, half, zero),
    )
    timing = Timing(control_period=100.0, episode_steps=3)
    return fly(craft, task, Coasting(), replace(starts, start=start), timing)


def test_a_foreign_reader_reads_them(flight: Flight, tmp_path: Path) -> None:
    oem, target, aem = (
        read(file)
        for file in write_ccsds(flight, tmp_path, 1, "2026-02-03T04:05:06", 51.6, 30.0, 90.0)
    )
    segment = oem.body.segment[0]
    assert segment.metadata.object_name == "vbar-chaser"
    assert segment.metadata.ref_frame == "EME2000"
    assert segment.metadata.start_time == "2026-02-03T04:05:06.000000"
    assert segment.metadata.stop_time == "2026-02-03T04:10:06.000000"
    lines = segment.data.state_vector
    assert len(lines) == 4
    # At 90 degrees of argument of latitude the target is at its northernmost, at the latitude of the inclination.
    first = target.body.segment[0].data.state_vector[0]
    there = 1e3 * np.array([float(x.value) for x in (first.x, first.y, first.z)])
    assert there[2] == pytest.approx(RADIUS * np.sin(np.radians(51.6)), rel=1e-9)
    assert np.degrees(np.arctan2(there[1], there[0])) == pytest.approx(120.0, abs=1e-6)
    # The craft is 100 m above it, and faster by n times that and 0.1 m/s.
    p = 1e3 * np.array([float(x.value) for x in (lines[0].x, lines[0].y, lines[0].z)])
    v = 1e3 * np.array([float(x.value) for x in (lines[0].x_dot, lines[0].y_dot, lines[0].z_dot)])
    assert p == pytest.approx(there * (1.0 + 100.0 / RADIUS), abs=1e-5)
    assert np.linalg.norm(v) == pytest.approx(N * (RADIUS + 100.0) + 0.1, abs=1e-8)
    # Body x is Hill -z, against the orbit's momentum; CCSDS rotates frame A into frame B.
    states = aem.body.segment[0].data.attitude_state
    q = states[0].quaternion_state.quaternion
    to_body = Rotation.from_quat([float(x) for x in (q.q1, q.q2, q.q3, q.qc)]).inv()
    momentum = np.cross(p, v) / np.linalg.norm(np.cross(p, v))
    assert to_body.apply(momentum) == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)
    assert to_body.apply(p / np.linalg.norm(p)) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_opm_in_gives_the_state_that_oem_out_had(flight: Flight, tmp_path: Path) -> None:
    files = write_ccsds(flight, tmp_path, 0, inclination=63.4, node=200.0, latitude=17.0)
    states = []
    for file in files[:2]:
        line = read(file).body.segment[0].data.state_vector[2]
        numbers = [line.x, line.y, line.z, line.x_dot, line.y_dot, line.z_dot]
        names = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
        text = "".join(
            f"{k} = {x.value} [{'km/s' if 'DOT' in k else 'km'}]\n"
            for k, x in zip(names, numbers, strict=True)
        )
        opm = tmp_path / "state.opm"
        opm.write_text(
            "CCSDS_OPM_VERS = 3.0\nCREATION_DATE = 2026-01-01T00:00:00\nORIGINATOR = TEST\n"
            "COMMENT X = 5\nOBJECT_NAME = craft\nOBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\n"
            f"REF_FRAME = EME2000\nTIME_SYSTEM = UTC\nEPOCH = {line.epoch}\n{text}"
        )
        assert read(opm).body.segment.metadata.object_name == "craft"
        states.append(read_opm(opm))
    craft, target = states
    assert target.epoch == datetime(2026, 1, 1, 0, 3, 20, tzinfo=UTC)
    n, p, v = relative_state(target, craft)
    assert n == pytest.approx(N, rel=1e-9)
    # Of numbers to 1e-9 km and 1e-12 km/s.
    assert p == pytest.approx([x[2, 0] for x in flight.states.p.columns()], abs=2e-6)
    assert v == pytest.approx([x[2, 0] for x in flight.states.v.columns()], abs=1e-8)


def test_refusals(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="episodes 0 to 1, got 2"):
        write_ccsds(flight, tmp_path, 2)
    with pytest.raises(ConfigError, match=r"flight must be a .*Flight, got 'flight.npz'"):
        write_ccsds("flight.npz", tmp_path)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigError, match=r"target must be a .*OrbitState, got 'target.opm'"):
        relative_state("target.opm", "craft.opm")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ConfigError, match="epoch must be an instant"):
        write_ccsds(flight, tmp_path, 0, "tomorrow")
    other = tmp_path / "other.opm"
    other.write_text("CCSDS_OEM_VERS = 3.0\n")
    with pytest.raises(ConfigError, match="no Orbit Parameter Message"):
        read_opm(other)
    other.write_text("CCSDS_OPM_VERS = 3.0\nCENTER_NAME = EARTH\nTIME_SYSTEM = UTC\nX = 7\n")
    with pytest.raises(ConfigError, match="must have numbers for X, Y"):
        read_opm(other)
    now = datetime(2026, 1, 1, tzinfo=UTC)
    speed = 1.1 * np.sqrt(EARTH / RADIUS)
    eccentric = OrbitState("", "EME2000", now, np.array([RADIUS, 0, 0]), np.array([0, speed, 0]))
    with pytest.raises(ConfigError, match=r"eccentricity must be at most 0.01, got 0.21"):
        relative_state(eccentric, eccentric)
