"""Sections of stress tests and assurances in the report of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rans_assurance.sections.assurance import assurance_section

from rans.base.files import write_json
from rans.show.pages.report import report_from_run
from tests.support.written_files import SCOPE, contents

ASSURANCE: dict[str, Any] = contents()["assurance-lab.json"]


@pytest.fixture
def run(tmp_path) -> Path:
    """A run folder with a file of every command."""
    for name, content in contents().items():
        write_json(tmp_path / name, content)
    return tmp_path


def test_both_are_sections_of_the_report(run):
    page = report_from_run(run)
    sections = {section.title: section for section in page.sections}
    for title in ("Stress", "Assurance lab"):
        assert "position within 5 cm" in str(sections[title].details)
    tables = str([section.tables for section in page.sections])
    for text in (
        "50.0% (10.0% to 90.0%)",
        "at most (99 %)",
        "left the tolerances in the last fifth",
        "0.015",
    ):
        assert text in tables
    rows = [cells for cells in page.summary().rows if "17 of 2,000" in cells]
    assert len(rows) == 1


def test_the_first_screen_says_how_sure(run):
    """The bound of `ASSURANCE` is a tile."""
    tiles = report_from_run(run).tiles
    assert len(tiles) <= 6
    assert [tile.amount for tile in tiles if "at most" in tile.what] == [
        "0.015 (17 of 2,000 flights failed; 99 % confidence)"
    ]


def test_a_stress_test_alone_begins_with_the_worst_conditions(tmp_path):
    def row(mine, other):
        held = {
            name: {"held": {"value": x, "low": x - 0.1, "high": x + 0.1}}
            for name, x in (("mine", mine), ("LQR", other))
        }
        return {"size": None, "contestants": held}

    write_json(
        tmp_path / "stress.json",
        {
            "title": "mine, LQR: 8 episodes",
            "failures": [],
            "scope": SCOPE,
            "contestants": {"mine": {"episodes": 8}},
            "conditions": {
                "perfect": row(0.9, 0.875),
                "lab": row(0.5, 0.75),
                "latency-0.1": row(0.9, 0.5) | {"size": 0.1, "effect": "latency"},
            },
            "effects": {
                "latency": {
                    "unit": "s",
                    "holds_to": {"mine": 0.1, "LQR": None},
                    "not_finished": {"LQR": None},
                }
            },
        },
    )
    page = report_from_run(tmp_path)
    for part in ("mine", "50.0%", "lab", "LQR 75.0%", "the worst of 2"):
        assert part in page.hero
    labels, values, notes = zip(*((x.what, x.value, x.note) for x in page.tiles), strict=True)
    for label, name in zip(labels, ("lab", "perfect", "latency"), strict=True):
        assert name in label
    assert values == ("50.0%", "90.0%", "0.1 s")
    assert labels[2] == "latency, all of 8 episodes solved up to"
    for note, part in zip(
        notes, ("40.0% to 60.0%", "80.0% to 100.0%", "not finished"), strict=True
    ):
        assert part in note
        assert "LQR" in note


def test_an_assurance_passes_if_what_was_wanted_is_shown(tmp_path):
    """One that was interrupted decides nothing."""
    file = tmp_path / "assurance.json"
    about = ASSURANCE["about"]
    wanted = ASSURANCE | {"about": about | {"below": 0.02}, "decision": "below"}
    assert assurance_section(file, wanted).title == "Assurance"
    for decision, flights, passed, said in (
        (
            "below",
            1000,
            True,
            "Shown: the probability of failure is below 0.02. 17 of 2,000 flights",
        ),
        ("above", 1000, False, "Refuted: the probability of failure is above 0.02. 17 of"),
        (
            "open",
            2000,
            False,
            "Not decided: whether the probability of failure is below 0.02. 17 of",
        ),
        ("open", 4000, None, "Interrupted. Not decided"),
    ):
        looks = {"looks": [[flights, 0.01, 0.01]]}
        section = assurance_section(
            file,
            wanted | {"about": wanted["about"] | looks, "decision": decision},
        )
        assert section.sure is not None
        assert section.sure.passed is passed
        assert section.hero.startswith(said)
