"""CCSDS messages, read by a foreign library and against two-body motion in inertial axes."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_missions.ccsds import EARTH, OrbitState, read_opm, relative_state, write_ccsds
from rans_missions.script import Script

import rans
from rans import ConfigError, Timing
from rans.episode.flight import Flight, fly
from rans.episode.scenario import scenarios
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft

N = rans.Hold().mean_motion
RADIUS = (EARTH / N**2) ** (1.0 / 3.0)


def read(file: Path) -> Any:
    """Message as another library reads it."""
    return pytest.importorskip("ccsds_ndm.ndm_io").NdmIo().from_path(file)


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
    coasting = Script(np.zeros((3, 2, 6)))
    return fly(craft, task, coasting, replace(starts, start=start), timing)


def test_a_foreign_reader_reads_them(flight, tmp_path):
    oem, target = (
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


def test_opm_in_gives_the_state_that_oem_out_had(flight, tmp_path):
    files = write_ccsds(flight, tmp_path, 0, inclination=63.4, node=200.0, latitude=17.0)
    states = []
    for file in files:
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


def test_refusals(flight, tmp_path):
    with pytest.raises(ConfigError, match=r"flight must be a .*Flight, got 'flight.npz'"):
        write_ccsds("flight.npz", tmp_path)  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(ConfigError, match=r"target must be a .*OrbitState, got 'target.opm'"):
        relative_state("target.opm", "craft.opm")  # pyrefly: ignore[bad-argument-type]
    other = tmp_path / "other.opm"
    other.write_text("CCSDS_AEM_VERS = 1.0\n")
    with pytest.raises(ConfigError, match="no Orbit Parameter Message"):
        read_opm(other)
    other.write_text("CCSDS_OPM_VERS = 3.0\nCENTER_NAME = EARTH\nTIME_SYSTEM = UTC\nX = 7\n")
    with pytest.raises(ConfigError, match=r"REF_FRAME of .* must be an inertial frame.*got ''"):
        read_opm(other)
    now = datetime(2026, 1, 1, tzinfo=UTC)
    speed = 1.1 * np.sqrt(EARTH / RADIUS)
    eccentric = OrbitState("", "EME2000", now, np.array([RADIUS, 0, 0]), np.array([0, speed, 0]))
    with pytest.raises(ConfigError, match=r"eccentricity must be at most 0.01, got 0.21"):
        relative_state(eccentric, eccentric)


STATE = {
    "CCSDS_OPM_VERS": "3.0",
    "CREATION_DATE": "2026-01-01T00:00:00",
    "ORIGINATOR": "TEST",
    "OBJECT_NAME": "A",
    "OBJECT_ID": "2026-001A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME": "EME2000",
    "TIME_SYSTEM": "UTC",
    "EPOCH": "2026-01-01T00:00:00",
    "X": "7000.0",
    "Y": "0",
    "Z": "0",
    "X_DOT": "0",
    "Y_DOT": "7.546",
    "Z_DOT": "0",
}


def opm(folder: Path, more: str = "", **changed: str | None) -> Path:
    """A message with other values, or without a keyword (None)."""
    lines = [f"{key} = {value}" for key, value in (STATE | changed).items() if value is not None]
    file = folder / "a.opm"
    file.write_text("\n".join(lines) + f"\n{more}\n")
    return file


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"X": "23e6 [ft]"}, r"X of .*a\.opm is in '\[ft\]', and km and m are read"),
        ({"Y_DOT": "7.546 [km]"}, r"Y_DOT of .* is in '\[km\]', and km/s and m/s are read"),
        ({"X": "7000 [km"}, r"is in '\[km'"),
        ({"X": "7000000.0"}, r"6,350 to 1,500,000 km .* got 7e\+06 km: .*other units"),
        ({"X": "7_000"}, "X of .* must be a finite number, got '7_000'"),
        ({"Y_DOT": "7546.0"}, r"at most 12 km/s.* take \[m/s\]"),
        ({"X": None}, "got none for X"),
        ({"CCSDS_OPM_VERS": "99"}, "must be 1.0, 2.0 or 3.0, got '99'"),
        ({"CENTER_NAME": "MOON"}, "must be EARTH, got 'MOON'"),
        ({"TIME_SYSTEM": "GPS"}, "must be UTC, got 'GPS'"),
        ({"more": "X = 6900"}, "X stands twice in .* again in line 16"),
        ({"more": "X 6900"}, "line 16 of .* is no keyword of an OPM with a value, got 'X 6900'"),
        ({"REF_FRAME": "ITRF2000"}, "inertial frame, .*got 'ITRF2000'"),
        ({"REF_FRAME": "EME1950"}, "inertial frame, .*got 'EME1950'"),
        ({"EPOCH": "2026-366T00:00:00"}, "EPOCH of .* must be an instant"),
        ({"EPOCH": "2016-12-31T23:59:60"}, "EPOCH of .* must be an instant"),
        ({"EPOCH": "2026-01-01T00:00:00+01:00"}, "EPOCH of .* must be an instant"),
    ],
)
def test_what_a_message_says_otherwise_is_refused(tmp_path, changed, sentence):
    with pytest.raises(ConfigError, match=sentence):
        read_opm(opm(tmp_path, **changed))


OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-11-27T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = ISS
CENTER_NAME = EARTH
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 2026-01-01T00:00:00
STOP_TIME = 2026-01-01T00:04:00
META_STOP
COMMENT the station

2026-01-01T00:00:00.000 6800.0 1.0 2.0 0.5 4.7 6.0
2026-01-01T00:04:00.000 6700.0 3.0 4.0 0.6 4.6 6.1
"""


def test_an_ephemeris_begins_with_its_first_state(tmp_path):
    file = tmp_path / "iss.oem"
    file.write_text(OEM, "utf-8")
    state = read_opm(file)
    assert state.p.tolist() == [6.8e6, 1e3, 2e3]
    assert state.v.tolist() == [500.0, 4700.0, 6000.0]
    assert state.epoch.isoformat().startswith("2026-01-01T00:00:00")
    assert state.name == "ISS"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (" 6.0\n2026", "\n2026", "line 14 .* six numbers"),
        (OEM[OEM.index("\n2026-01") :], "", "an OEM without a state"),
        ("COMMENT the", "OBJECT_NAME = OTHER\nCOMMENT the", "of 2 objects"),
        ("NAME = ISS", "NAME = I\x1b[2JSS", "OBJECT_NAME of .* must be one line"),
        ("TIME_SYSTEM", "REF_FRAME = ITRF2000\nTIME_SYSTEM", "REF_FRAME stands twice .* line 8"),
    ],
)
def test_an_ephemeris_that_means_something_else_is_refused(tmp_path, old, new, message):
    file = tmp_path / "iss.oem"
    assert old in OEM
    file.write_text(OEM.replace(old, new), "utf-8")
    with pytest.raises(ConfigError, match=message):
        read_opm(file)


@pytest.mark.parametrize(
    ("changed", "p", "v"),
    [
        ({"X": "7000000.0 [m]", "Y_DOT": "7546.0 [m/s]"}, 7e6, 7546.0),
        ({"X": "7.0D3", "Y_DOT": "75.46d-1"}, 7e6, 7546.0),
        ({"X": "+.7e4", "Y_DOT": "7546.E-3"}, 7e6, 7546.0),
    ],
)
def test_units_and_numbers(tmp_path, changed, p, v):
    state = read_opm(opm(tmp_path, **changed))
    assert (state.p[0], state.v[1]) == pytest.approx((p, v), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "micro"),
    [
        ("2024-12-31T12:30:05.123456789", 5_123_456),
        ("2024-12-31T12:30", 0),
        ("2024-366T12:30:05Z", 5_000_000),
    ],
)
def test_epochs_as_other_programs_write_them(tmp_path, text, micro):
    state = read_opm(opm(tmp_path, EPOCH=text))
    whole = datetime(2024, 12, 31, 12, 30, tzinfo=UTC)
    assert (state.epoch - whole).total_seconds() == micro * 1e-6
