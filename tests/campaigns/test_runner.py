"""Rows of data become evidence and tables: by a campaign of three numbers."""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any

import pytest

from campaigns import runner
from campaigns.runner import Campaign, Shown, cell, command, found, merged
from campaigns.table import CAMPAIGNS, read_campaigns
from rans import ConfigError

PAGE = "<!-- table: squares -->\n<!-- end of table -->\n"
SQUARES = Campaign(
    "page.md",
    {"squares": Shown((("x", "{x}"), ("square", "{square:.1f}")), source="{count} rows, {file}.")},
    measure="nowhere:Squares",
    labels=("x",),
    given=("--count", "2"),
    evidence=("squares.json",),
)


@dataclass(frozen=True)
class Squares:
    """Numbers and their squares; it fails above 10."""

    count: int = 3
    only: tuple[int, ...] = ()

    def measured(self) -> Iterator[dict[str, Any]]:
        for x in self.only or range(self.count):
            yield {"x": x, "square": x * x}

    def failed(self, evidence: Any) -> bool:
        return any(row["square"] > 10 for row in evidence["rows"])


@pytest.fixture
def docs(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(runner, "found", lambda name: Squares)
    (tmp_path / "validation").mkdir()
    (tmp_path / "page.md").write_text(PAGE)
    return tmp_path


def measure(docs: Path, *arguments: str) -> int:
    return command("squares", SQUARES, [*arguments, "--docs", str(docs)])


def test_a_campaign_writes_its_evidence_and_its_table(docs):
    assert measure(docs) == 0
    evidence = json.loads((docs / "validation" / "squares.json").read_text("utf-8"))
    assert evidence["count"] == 2
    assert "revision" in evidence["environment"]
    table = "| x | square |\n| --- | --- |\n| 0 | 0.0 |\n| 1 | 1.0 |\n"
    below = "\n2 rows, [squares.json](validation/squares.json).\n"
    mark, end = PAGE.splitlines(keepends=True)
    assert (docs / "page.md").read_text("utf-8") == mark + table + below + end


def test_rows_that_are_not_measured_stay_where_they_are(docs):
    """And those that are new come last."""
    measure(docs)
    assert measure(docs, "--only", "4", "0") == 1
    rows = json.loads((docs / "validation" / "squares.json").read_text("utf-8"))["rows"]
    assert [row["x"] for row in rows] == [0, 1, 4]


def test_an_interrupted_campaign_leaves_the_rows_until_then(docs, monkeypatch):
    def two_and_an_interrupt(_):
        yield {"x": 0, "square": 0}
        yield {"x": 1, "square": 1}
        raise KeyboardInterrupt

    monkeypatch.setattr(Squares, "measured", two_and_an_interrupt)
    with pytest.raises(KeyboardInterrupt):
        measure(docs)
    assert len(json.loads((docs / "validation" / "squares.json").read_text("utf-8"))["rows"]) == 2


def test_a_new_row_replaces_the_one_with_its_labels():
    before = [{"who": "a", "size": 1, "won": 0}, {"who": "a", "size": 2, "won": 0}]
    new = [{"who": "a", "size": 2, "won": 9}]
    assert [row["won"] for row in merged(before, new, ("who", "size"))] == [0, 9]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{won:%.1f}", "12.3"),
        ("{spent:~3} N s", "12,300 N s"),
        ("{count:,}", "1,024"),
        ("{name}", "lqr"),
        ("{missing:.2f} s", "-"),
        ("{never:.2f}", "-"),
        ("{late:.1f}", "-"),
        ("{pair[1]:.2f}", "2.00"),
    ],
)
def test_cells(text, expected):
    """Worked out by hand; JSON has infinite numbers as text."""
    row = {"won": 0.1234, "spent": 12345.6, "count": 1024, "name": "lqr", "pair": [1.0, 2.0]}
    assert cell(text, {**row, "missing": None, "never": "inf", "late": math.nan}) == expected


def test_every_campaign_has_what_measures_it():
    """A dataclass whose fields have defaults but those that the table gives."""
    for name, campaign in CAMPAIGNS.items():
        assert bool(campaign.measure) != bool(campaign.commands) or campaign.given, name
        if campaign.measure:
            plan: Any = found(campaign.measure)
            assert not inspect.signature(plan.measured).parameters.keys() - {"self"}, name
            assert is_dataclass(plan), name
            assert campaign.evidence or campaign.prints, name


@pytest.mark.parametrize("fault", ["tabels = {}", 'flights = "many"', "tolerance = [0.1]"])
def test_a_row_with_something_else_is_a_sentence(fault, tmp_path):
    file = tmp_path / "table.toml"
    file.write_text(f'[columns]\n[mine]\npage = "page.md"\n{fault}\n')
    with pytest.raises(ConfigError, match=r"mine of table\.toml"):
        read_campaigns(file)
