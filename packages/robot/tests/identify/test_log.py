"""Logs as other programs write them: times, units and lines, read rightly or refused in a sentence and at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_robot.identify.log import FlightLog, checked_log, read_csv
from rans_robot.identify.motion import windows_of

import rans
from rans import ConfigError
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
HEADER = "time,x,y,heading," + ",".join(f"u{k}" for k in range(8))


def csv_file(folder: Path, rows: list[str], header: str = HEADER) -> Path:
    file = folder / "log.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def still(time: Callable[[int], float], count: int = 60) -> list[str]:
    """Lines of a craft that drifts by 1 cm a reading, with all valves shut."""
    return [f"{time(k)!r},{0.01 * k},0,0{',0' * 8}" for k in range(count)]


@pytest.mark.parametrize(
    ("zeros", "sentence"),
    [(1, "without a time stamp"), (3, "ascend, and 0 s follows 0 s; .* twice")],
)
def test_messages_before_the_clock_are_refused(zeros, sentence, tmp_path):
    """Those of a recorder with simulated time are stamped 0 until the first /clock."""
    file = csv_file(tmp_path, still(lambda k: 0.0 if k < zeros else 1.7e9 + 0.2 * k))
    with pytest.raises(ConfigError, match=sentence):
        checked_log(read_csv(file, PLATFORM), PLATFORM)


def test_a_log_that_begins_at_zero_keeps_its_first_line(tmp_path):
    log = read_csv(csv_file(tmp_path, still(lambda k: 0.2 * k)), PLATFORM)
    assert len(log.times) == 60
    assert len(log.notes) == 1


def test_columns_that_are_not_read_are_named_and_need_no_numbers(tmp_path):
    rows = [f"{row},manual" for row in still(lambda k: 0.2 * k)]
    log = read_csv(csv_file(tmp_path, rows, HEADER + ",Mode"), PLATFORM)
    assert any("not read: 'Mode'" in note for note in log.notes)


def test_a_log_without_positions_is_refused_in_a_sentence():
    times = 0.2 * np.arange(60)
    unknown = np.full((60, 3), np.nan)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (60, 1))
    craft = load_spacecraft("free-flyer")
    commands = np.zeros((60, craft.command_count))
    log = FlightLog("log", times, commands, times, unknown, level, unknown, np.zeros((60, 3)))
    with pytest.raises(ConfigError, match="has no positions"):
        rans.identify(log, craft)
    with pytest.raises(ConfigError, match="quaternion at 0 s has the length 2"):
        rans.identify(replace(log, position=np.zeros((60, 3)), attitude=2.0 * level), craft)


def test_no_window_reaches_over_a_gap_longer_than_itself():
    """Readings of velocity after it belong to no window: the model would need an instant for every 0.02 s of it."""
    times = np.concatenate([0.2 * np.arange(50), 3000.0 + 0.2 * np.arange(50)])
    position = np.zeros((100, 2))
    position[50:55] = np.nan
    log = FlightLog(
        "log", times, np.zeros((100, 8)), times, position, times * 0.0, position, times * 0.0
    )
    parts = windows_of(log, 5.0)
    assert max(np.ptp(times[part]) for part in parts) < 10.0
    covered = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    assert covered.tolist() == [*range(50), *range(55, 100)]
    # The first window ends 5 s after it began, and a short rest belongs to the second.
    assert [part.stop - part.start for part in parts[:2]] == [25, 25]
    assert len(parts) == 4
