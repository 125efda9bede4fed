"""Files and sentences of an identification."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_robot.identify.log import FlightLog, read_csv
from rans_robot.identify.result import Identification

import rans
from campaigns.identification import hidden_flights
from rans import LQR, ConfigError, GoToPose, Timing
from rans.cli import main
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
RATES = "velocity", "spin"


@pytest.fixture(scope="module")
def flight() -> FlightLog:
    return hidden_flights(PLATFORM, 1, 12.0, 0.2, seed=5)[0][0]


@pytest.fixture(scope="module")
def found(flight) -> Identification:
    return rans.identify(flight, PLATFORM)


def written(log: FlightLog, file: Path, rates: bool = True) -> Path:
    columns = [log.times, *log.position.T, log.attitude]
    names = ["time", "x", "y", "heading"]
    if rates:
        columns += [*log.velocity.T, log.spin]
        names += ["vx", "vy", "spin"]
    names += [f"u{k}" for k in range(log.commands.shape[1])]
    rows = np.column_stack([*columns, *log.commands.T])
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="")
    return file


def test_the_command_writes_what_training_reads(flight, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    file = written(flight, tmp_path / "flight.csv")
    folder = tmp_path / "identified"
    line = f"identify {file} --spacecraft floating-platform --output {folder}"
    assert main(line.split()) == 0
    craft = rans.load_spacecraft(folder / "spacecraft.toml")
    conditions = rans.load_conditions(folder / "conditions.toml")
    assert craft.mass == PLATFORM.mass
    assert [t.force for t in craft.thrusters] != [t.force for t in PLATFORM.thrusters]
    assert conditions.sensors.position.noise == pytest.approx(0.005, rel=0.3)
    # One table, whose units are not in a second one below.
    assert capsys.readouterr().out.count("force of thruster 0") == 1


@pytest.mark.parametrize(("origin", "unit"), [(1.7e9, "s"), (-1e4, "ms"), (0.0, "ns")])
def test_an_answer_depends_on_neither_origin_nor_unit_of_time_nor_order_of_columns(
    origin, unit, flight, found, tmp_path
):
    """Times since 1970 once gave intervals 25 times as wide, without a word."""
    file = written(flight, tmp_path / "flight.csv")
    header, *lines = file.read_text().splitlines()
    rows = [line.split(",") for line in (header.replace("time", f"time ({unit})"), *lines)]
    per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
    for row in rows[1:]:
        row[0] = repr((float(row[0]) + origin) * per_second)
    file.write_text("\n".join(",".join(row[::-1]) for row in rows) + "\n")
    again = rans.identify(file, PLATFORM)
    assert again.fit.window == found.fit.window
    # Times have 2.4e-7 s of rounding, which the strongest thruster's 0.1 m/s^2 makes less than a reading's noise.
    off = (again.fit.values - found.fit.values) / found.fit.deviations
    assert np.abs(off).max() < 0.01
    assert again.fit.deviations == pytest.approx(found.fit.deviations, rel=0.01)


def test_poses_alone_are_enough(flight, found, tmp_path):
    poses = rans.identify(written(flight, tmp_path / "poses.csv", rates=False), PLATFORM)
    assert {one.name for one in poses.channels()} == {"position", "attitude"}
    assert poses.fit.deviations[0] > found.fit.deviations[0]


def test_an_interval_of_95_percent_is_of_two_deviations(found):
    """By the normal distribution: 1.96 of them, to either side, of a covariance whose root is 0.01 to 0.16."""
    deviations = 0.01 * np.arange(1, 1 + len(found.fit.values))
    row = Identification(replace(found.fit, covariance=np.diag(deviations**2))).rows()[2]
    assert (row.high - row.value, row.value - row.low) == pytest.approx((0.0588,) * 2, rel=1e-3)


def test_a_planar_moment_above_twice_the_sheet_s_is_written(found, tmp_path):
    """As after a ring of batteries was mounted; with the sheet's other moments no rigid body has it."""
    values = found.fit.values.copy()
    values[PLATFORM.thruster_count] = 2.5 * PLATFORM.inertia[2][2]
    folder = Identification(replace(found.fit, values=values)).write(tmp_path / "identified")
    craft = rans.load_spacecraft(folder / "spacecraft.toml")
    assert craft.inertia[2][2] == pytest.approx(2.5 * PLATFORM.inertia[2][2])


def test_a_thruster_that_never_fired_is_said_not_to_be_identifiable(flight):
    random = np.random.default_rng(0)
    still = replace(
        flight,
        commands=np.zeros_like(flight.commands),
        position=random.normal(0.0, 0.005, flight.position.shape),
        attitude=random.normal(0.0, 0.008, flight.attitude.shape),
        velocity=random.normal(0.0, 0.01, flight.velocity.shape),
        spin=random.normal(0.0, 0.008, flight.spin.shape),
    )
    found = rans.identify(still, PLATFORM)
    assert not any(row.is_identifiable for row in found.rows()[:8])
    assert "force of thruster 7" in " ".join(found.notes())


@pytest.mark.parametrize("name", ["floating-platform", "free-flyer"])
def test_the_table_of_a_flight_is_a_log(name, tmp_path):
    craft = load_spacecraft(name)
    task = GoToPose()
    starts = scenarios(task, craft, 3, 1)
    flight = fly(craft, task, LQR(craft, task), starts, Timing(episode_steps=4))
    log = read_csv(flight.to_csv(tmp_path / "flight.csv"), craft)
    states = flight.states
    assert log.times == pytest.approx(flight.times)
    assert log.commands[:-1] == pytest.approx(flight.commands[:, 0])
    assert log.velocity[:, 1] == pytest.approx(states.v.y[:, 0], rel=1e-6, abs=1e-8)
    spin = log.spin if craft.dimension == 2 else log.spin[:, 2]
    assert spin == pytest.approx(states.spin()[-1][:, 0], rel=1e-6, abs=1e-8)


def test_the_log_of_another_craft_is_refused(flight):
    with pytest.raises(ConfigError, match="another spacecraft"):
        rans.identify(flight, "free-flyer")


@pytest.mark.parametrize("fault", ["frozen", "zero"])
def test_readings_that_cannot_be_are_left_out_and_named(fault, flight, found):
    """A second of repeated readings moved forces by 8 deviations, a row of zeros by 3, without a word."""
    parts = {name: getattr(flight, name).copy() for name in ("position", "attitude", *RATES)}
    for values in parts.values():
        values[20:25] = values[20] if fault == "frozen" else values[20:25]
        values[22] *= fault == "frozen"
    again = rans.identify(replace(flight, **parts), PLATFORM)
    assert any("readings left out, the first at" in note for note in again.notes())
    # A sixth of the readings is gone; what is left says the same within what 1 of 1,000 numbers exceeds.
    off = (again.fit.values - found.fit.values) / again.fit.deviations
    assert np.abs(off).max() < 3.3
    # Velocities of no sensor are more than a moment's fault.
    with pytest.raises(ConfigError, match="of 60 that cannot be"):
        rans.identify(replace(flight, **{name: 0.0 * parts[name] for name in RATES}), PLATFORM)


@pytest.mark.parametrize("column", ["heading", "x and y", "spin", "feet"])
def test_a_channel_that_the_commands_do_not_explain_is_named_and_nothing_is_written(
    column, flight, tmp_path, monkeypatch, capsys
):
    """A heading or spin in degrees, columns of the wrong order, and positions in feet beside velocities in m/s."""
    wrong = replace(flight, attitude=np.degrees(flight.attitude))
    if column == "x and y":
        wrong = replace(flight, position=flight.position[:, ::-1])
    elif column == "spin":
        wrong = replace(flight, spin=np.degrees(flight.spin))
    elif column == "feet":
        wrong = replace(flight, position=flight.position / 0.3048)
    file = written(wrong, tmp_path / "log.csv", rates=column in ("spin", "feet"))
    monkeypatch.chdir(tmp_path)
    assert main(f"identify {file} --spacecraft floating-platform".split()) == 2
    said = capsys.readouterr().err
    said_of = {"heading": "attitude (error", "x and y": "position (error"}
    assert said_of.get(column, "of 60 that cannot be") in said
    assert not (tmp_path / "identified").exists()
    if column == "x and y":  # nor has Python numbers of it
        with pytest.raises(ConfigError, match="do not explain"):
            rans.identify(file, PLATFORM)


@pytest.mark.parametrize("exchanged", [(0, 6), (3, 7), (1, 2)])
def test_two_exchanged_thrusters_are_no_fit(exchanged, flight, found):
    """Wires or columns: part of the motion is still explained, and forces were up to 80 deviations off."""
    order = np.arange(8)
    order[list(exchanged)] = exchanged[::-1]
    with pytest.raises(ConfigError, match=r"do not explain .*two thrusters exchanged"):
        rans.identify(replace(flight, commands=flight.commands[:, order]), PLATFORM)
    # Nor is one that never pushed, though the rest may be explained.
    values = found.fit.values.copy()
    values[2] = found.fit.parameters[2].least
    with pytest.raises(ConfigError, match="best without force of thruster 2"):
        Identification(replace(found.fit, values=values))


def test_commands_that_were_applied_before_they_are_named(flight, found):
    """A column that says what was just applied: forces were 5 to 11 % too small, and training was advised."""
    assert found.fit.values[0] == pytest.approx(PLATFORM.thrusters[0].force, rel=0.5)
    late = replace(flight, command_times=flight.command_times + flight.period)
    with pytest.raises(ConfigError, match=r"one control period, 0\.2 s, before"):
        rans.identify(late, PLATFORM)


def test_what_flights_of_the_craft_leave_is_noise(found):
    # Nor is there anything to explain where nothing acts and no sensor errs.
    times = 0.2 * np.arange(60)
    still = np.zeros((60, 2))
    drifting = np.column_stack([0.01 * np.arange(60), np.zeros(60)])
    log = FlightLog(
        "still", times, np.zeros((60, 8)), times, drifting, times * 0.0, still, times * 0.0
    )
    rans.identify(replace(log, velocity=np.tile([0.05, 0.0], (60, 1))), PLATFORM)
    assert all(channel.is_explained for channel in found.channels())


@pytest.mark.slow
@pytest.mark.parametrize("order", [[1, 2, 3, 0], [0, -1, -2, -3]])
def test_quaternions_of_another_order_are_not_explained(order):
    """With the scalar last, or from world to body."""
    craft = load_spacecraft("free-flyer")
    (log,), _ = hidden_flights(craft, 1, 8.0, 0.2, seed=5)
    wrong = log.attitude[:, np.abs(order)] * np.where(np.array(order) < 0, -1.0, 1.0)
    with pytest.raises(ConfigError, match=r"cannot be, .* order"):
        rans.identify(replace(log, attitude=wrong), craft)
