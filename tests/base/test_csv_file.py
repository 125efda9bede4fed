"""Tables of others: every reader of CSV files refuses the same damage (`rans.base.csv_file`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rans_foreign_policies.flights_file import FlightsFile
from rans_robot.identify.log import read_csv as read_log

import rans
from rans import ConfigError, Timing
from rans.base.csv_file import read_csv
from rans.episode.step import Setup
from rans.model.actuators import Throttle

PLATFORM = rans.load_spacecraft("floating-platform")
THROTTLED = replace(PLATFORM, actuators=Throttle())
SETUP = Setup(THROTTLED, rans.GoToPose(), Timing(control_period=0.2, episode_steps=5))

COMMANDS = [f"command.{k}" for k in range(8)]
INPUTS = [f"u{k}" for k in range(8)]
POSE = ["x", "y", "heading"]
READERS: dict[str, tuple[Callable[[Path], object], list[str], list[str]]] = {
    "flights": (
        lambda file: FlightsFile(file, SETUP),
        ["start", "time", *COMMANDS],
        ["0", "0", *["1"] * 8],
    ),
    "log": (
        lambda file: read_log(file, PLATFORM),
        ["time", *POSE, *INPUTS],
        ["0", "0", "0", "0", *["1"] * 8],
    ),
}
"""Each reader with a header and a first row that it takes."""


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        (lambda head, row: (head, [f"{row[0]},5", *row[1:]]), "decimal comma|cells instead of"),
        (lambda head, row: (head, row[:-1]), "cells instead of"),
        (lambda head, row: ([*head, head[-1]], [*row, row[-1]]), "twice"),
        (lambda head, row: (head, ["1" * 200_000, *row[1:]]), "field limit"),
        (lambda head, row: (head, ["one", *row[1:]]), "number"),
        (lambda *rows: [[";".join(one)] for one in rows], "write commas"),
        (lambda *rows: [["\t".join(one)] for one in rows], "write commas"),
        (
            lambda *rows: [["sep=", ""], *rows],
            "the first line of .* must name its columns, got 'sep='",
        ),
        (lambda *rows: [["# of a robot"], *rows], "the first line of .* must name its columns"),
    ],
    ids=[
        "decimal comma",
        "short row",
        "doubled column",
        "endless cell",
        "word",
        ";",
        "tabs",
        "sep",
        "#",
    ],
)
def test_every_reader_refuses(name, damage, sentence, tmp_path):
    read, head, row = READERS[name]
    file = tmp_path / "table.csv"
    file.write_text("\n".join(map(",".join, damage(head, row))) + "\n")
    with pytest.raises(ConfigError, match=sentence):
        read(file)


def test_columns_stand_in_any_order_with_their_units(tmp_path):
    file = tmp_path / "table.csv"
    file.write_text("Y (m), note, x\n2,a,1\n\n4,b,3\n")
    table = read_csv(file)
    assert table.columns({"x": ("m",), "y": ("m",)}) == {"y": 0, "x": 2}
    assert [line for line, _ in table.rows] == [2, 4]
    with pytest.raises(ConfigError, match="must be in cm"):
        table.columns({"y": ("cm",)})
