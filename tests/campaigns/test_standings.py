"""The first table of each mission's page: nobody in the evidence is cheaper than the least known flight."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from campaigns.standings import MISSIONS, rows as standings

DOCS = Path(__file__).parents[2] / "docs"


def _ratio(row: Sequence[str]) -> float:
    """The mean ratio of a row, which may be of fewer starts than the row."""
    return float(row[4].partition(" of ")[0])


@pytest.mark.parametrize("mission", MISSIONS)
def test_nobody_who_always_wins_is_cheaper(mission):
    _, lines = standings(DOCS, mission)
    (cheapest,) = (row for row in lines if row[0] == "least known")
    ratio = _ratio(cheapest)
    others = [_ratio(row) for row in lines if row[3] == "100.0" and row[4] != "-"]
    assert ratio <= min(others)


@pytest.mark.parametrize("mission", MISSIONS)
def test_the_page_has_the_table_of_the_evidence(mission):
    page = (DOCS / "missions" / f"{mission}.md").read_text("utf-8")
    for row in standings(DOCS, mission)[1]:
        assert re.search(r"\| " + re.escape(" | ".join(row)) + r" \|", page), row
