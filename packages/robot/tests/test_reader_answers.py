"""What the readers of logs make of planted ones (`tests.support.reader_questions`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rans_robot.bag import BagMessage
from rans_robot.identify.log import checked_log, read_csv
from rans_robot.interfaces import Interface
from rans_robot.logs import read_bag

from rans.model.spacecraft_file import load_spacecraft
from tests.support.reader_questions import (
    Answer,
    Answers,
    check_said,
    planted,
    written,
)
from tests.support.robots import bag_of

CRAFT = load_spacecraft("floating-platform")
HEADER = "time,x,y,heading," + ",".join(f"u{k}" for k in range(8))


def table(
    time: Callable[[int], float] = lambda k: 0.2 * k,
    x: Callable[[int], float] = lambda k: 0.01 * k,
    command: str = "0",
    header: str = HEADER,
) -> Any:
    """A log of a craft that drifts, judged as `rans identify` does."""
    lines = [f"{time(k)!r},{x(k)!r},0,0,{command}{',0' * 7}" for k in range(60)]
    text = "\n".join([header, *lines])
    return written("log.csv", text, lambda file: checked_log(read_csv(file, CRAFT), CRAFT))


def bag(messages: Sequence[BagMessage]) -> Any:
    def plant(folder: Path) -> Callable[[], object]:
        file = bag_of(folder, messages)
        return lambda: read_bag(file, CRAFT, "ros")

    return plant


def commands(robot: Any) -> list[BagMessage]:
    return [BagMessage(0, *one) for one in Interface(robot, 8, 8).command([0.0] * 8, 0)]


ANSWERS: Answers = {
    "read_csv": {
        "units": Answer(table(header=HEADER.replace(",x,", ",x (mm),")), "must be in m"),
        "frames": "columns of the world have their own names, and docs say which axes they are of",
        "times": Answer(table(time=lambda k: 200.0 * k), "times in ms"),
        "order": Answer(table(command="7"), "another order of columns"),
        "dropped": Answer(table(header=HEADER + ",u8", command="0,0"), "has the commands u8 too"),
        "sizes": Answer(table(header=HEADER + ",note", command="0," + "9" * 200_000), "line"),
        "evidence": Answer(table(x=lambda k: 1e12), "other units, or damaged"),
    },
    "read_bag": {
        "units": "ROS 2 and PX4 define those of each message",
        "frames": "poses of two frames are refused (test_logs.py)",
        "times": "clocks of messages and bag are compared (test_logs.py)",
        "order": "commands have the craft's order, and their number is compared",
        "dropped": Answer(bag(commands("odometry")), "0 readings and 1 commands .* --robot"),
        "sizes": "each message is bounded by its kind (test_logs.py changes bytes)",
        "evidence": Answer(bag(commands("ros")), "0 readings and 1 commands"),
    },
}


@planted(ANSWERS)
def test_a_file_that_means_something_else(answer, tmp_path):
    check_said(answer, tmp_path)
