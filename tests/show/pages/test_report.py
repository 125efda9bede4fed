from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rans
from rans import ConfigError
from rans.base.files import read_json, write_json
from rans.base.registry import Registry
from rans.evaluation.measure.aggregate import measure
from rans.show.pages import report as report_module
from rans.show.pages.page import Fact, Section
from rans.show.pages.report import (
    SOLVED_SHARE,
    comparison_section,
    evaluation_page,
    evaluation_section,
    report_from_run,
    validation_section,
)
from tests.support.evaluation_flights import two_episodes
from tests.support.training_rows import ROWS

CHECK = {
    "name": "force",
    "value": 1e-16,
    "tolerance": 1e-12,
    "unit": "N",
    "reason": "Rounding.",
    "passed": True,
}
LATE = CHECK | {"name": "rollout", "value": 2e-3, "tolerance": 1e-9, "unit": "m", "passed": False}


class Read(HTMLParser):
    """What a page says and what it loads."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.text: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for key, value in attrs if key in ("src", "href")]

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.text.append(data.strip())


@pytest.fixture
def run(tmp_path, undrawn) -> Path:
    """A run folder that holds everything."""
    flight = two_episodes()
    for name in ("evaluation.svg", "episode.svg"):
        (tmp_path / name).write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    contents: dict[str, Any] = {
        "config.json": {
            "seed": 3,
            "timing": {"control_period": 0.2, "substeps": None},
            "about": {
                "command": "rans train go-to-pose",
                "environment": {"rans": "0.1.0", "revision": "abc1234"},
            },
        },
        "validation.json": {"title": "Dynamics", "checks": [CHECK, LATE]},
        "evaluation.json": {"agent": measure(flight).to_json()},
        "compare.json": {
            "title": "1 start",
            "failures": [],
            "summary": [
                {
                    "contestant": "agent",
                    "starts": 1,
                    "flown": 1,
                    "solved": 1,
                    "median_settling_time": 6.5,
                    "mean_impulse": 20.0,
                }
            ],
        },
    }
    for name, content in contents.items():
        (tmp_path / name).write_text(json.dumps(content))
    (tmp_path / "metrics.jsonl").write_text("\n".join(map(json.dumps, ROWS)) + '\n{"steps": 12')
    return tmp_path


def test_report_from_run_holds_everything(run):
    page = Read(report_from_run(run).html())
    headings = [
        "Comparison",
        "Evaluation",
        "Training",
        "Validation",
        "Configuration",
    ]
    assert [
        text for text in page.text if text in headings
    ] == headings * 2  # in the links and above
    for text in (
        "rans train go-to-pose",
        "rans 0.1.0, revision abc1234",
        "timing.control_period",
        "2.45 cm",
        "compare.html",
        "10,000",
        "5.0 s",
        "100.0%",
    ):
        assert text in " ".join(page.text)
    assert page.tags.count("img") == 4  # two of the flight, and two charts of the training
    assert (
        page.tags.count("details") == 2
    )  # validation and configuration are there for those who ask
    made = page.text.index("How it was made")
    table = page.text.index("2.45 cm", page.text.index("FAIL"))  # also a tile above
    assert table < page.text.index("tolerance") < made


def test_a_report_is_of_a_run():
    with pytest.raises(ConfigError, match="a run, unless it is a name or a file"):
        rans.report([])  # type: ignore[arg-type]


def test_report_loads_nothing_from_elsewhere(run, monkeypatch):
    monkeypatch.undo()  # its figures are drawn
    html = report_from_run(run).html()
    page = Read(html)
    assert page.links
    assert all(link.startswith(("data:", "#")) or link in ("compare.html",) for link in page.links)
    assert not {"link", "iframe"} & set(page.tags)
    assert not re.search(r"<script[^>]+src|fetch\(|XMLHttpRequest", html)  # its own scripts alone
    assert not re.search(r"url\((?!#)", html)  # parts of its own pictures alone
    assert "@import" not in html
    assert len(html) < 3e6


def test_how_it_was_made_is_on_top(run):
    assert report_from_run(run).header == {
        "command": "rans train go-to-pose",
        "seed": "3",
        "environment": "rans 0.1.0, revision abc1234",
    }
    (run / "config.json").unlink()
    assert report_from_run(run).header == {}
    checked = {"checks": [CHECK], "environment": {"drake": "1.51.1"}, "settings": {"seed": 3}}
    (run / "validation.json").write_text(json.dumps(checked))
    assert report_from_run(run).header == {"environment": "drake 1.51.1"}


def test_the_result_is_above_everything(run):
    """One of two episodes is solved, as `two_episodes` flies them; Wilson's interval of that."""
    (run / "compare.json").unlink()
    page = report_from_run(run)
    assert "solves 50 % of 2 episodes (9.45 to 90.5 %)" in page.hero
    assert [tile.amount for tile in page.tiles if "solved" in tile.what] == [
        "50 % (9.45 to 90.5; at least 99 % are asked)"
    ]


def test_a_comparison_begins_the_report(run):
    """Its own sentence and tiles, its chart as an image, and its page for the rest."""
    first = {
        "hero": "A settles.",
        "tiles": [{"label": "bound", "value": "1.13 x", "note": "of 2 starts"}],
    }
    write_json(run / "compare.json", first | read_json(run / "compare.json"))
    (run / "compare.svg").write_text("<svg><script>hostile()</script></svg>")
    page = report_from_run(run)
    assert page.hero == "A settles."
    assert page.tiles[0] == Fact("bound", "1.13 x", note="of 2 starts")
    assert [section.title for section in page.sections if section.first] == ["Time and impulse"]
    assert "hostile" not in page.html()
    assert 'href="compare.html"' in page.html()


def test_an_evaluation_has_a_page_with_a_replay(run):
    flight = two_episodes()
    page = evaluation_page([measure(flight)], flight, "rans evaluate agent")
    assert [section.title for section in page.sections] == ["Replay", "Evaluation"]
    assert "solves 50 % of 2 episodes" in page.hero
    page.write(run / "evaluation.html")
    assert 'href="evaluation.html"' in report_from_run(run).html()


@pytest.mark.parametrize(
    "kept",
    [
        "validation.json",
        "metrics.jsonl",
        "evaluation.json",
        "compare.json",
    ],
)
def test_what_is_missing_is_left_out(run, kept):
    for file in run.iterdir():
        if file.name != kept:
            file.unlink()
    page = Read(report_from_run(run).html())
    assert page.tags.count("section") == 1


@pytest.mark.parametrize(
    ("share", "passed"),
    [(100.0, True), (SOLVED_SHARE, True), (SOLVED_SHARE - 0.01, False), (0.0, False)],
)
def test_as_many_solved_as_are_wanted_are_enough(share, passed):
    measured = measure(two_episodes())
    rows = tuple(
        replace(row, value=share) if row.name == "solved" else row for row in measured.rows
    )
    section = evaluation_section([replace(measured, rows=rows, episodes=381)])
    assert [check for check, _ in section.checks] == [passed]
    # n / (n + 1.96^2) is 0.99 from n = 380.3 on.
    few = evaluation_section([replace(measured, rows=rows, episodes=380)])
    assert [check for check, _ in few.checks] == [False] * (not passed)
    assert ("380 episodes cannot show 99 %" in str(few.notes)) is passed
    assert (
        "at least 98.9 % at 95 % confidence; at least 381 are needed" in str(few.notes)
    ) is passed


def test_no_results_is_an_error(tmp_path):
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(ConfigError, match="holds no results"):
        report_from_run(tmp_path)
    with pytest.raises(ConfigError, match="holds no results"):
        report_from_run(tmp_path / "nowhere")
    (tmp_path / "flights.csv").touch()
    with pytest.raises(ConfigError, match=r"are compared first: rans compare .*flights\.csv"):
        report_from_run(tmp_path)


def test_validation_findings():
    assert [f.passed for f in validation_section({"checks": [CHECK, LATE]}).facts] == [False, False]
    assert [f.passed for f in validation_section({"checks": [CHECK]}).facts] == [True]
    # A value that is not finite comes as null.
    broken = LATE | {"value": None}
    (_, fact) = validation_section({"checks": [broken]}).facts
    assert (fact.what, fact.amount) == ("rollout", "– m (tolerance 1e-09)")  # noqa: RUF001


def test_a_comparison_is_its_outcomes_and_what_went_wrong():
    agent = {
        "contestant": "agent",
        "starts": 4,
        "flown": 4,
        "solved": 2,
        "median_settling_time": None,
        "mean_impulse": 12.0,
    }
    bound = agent | {"contestant": "least time", "flown": 3}
    gaps = {"impulse by 9 s": {"agent": [2.0, "inf"]}, "by 6 s": {"agent": ["inf"]}}
    section = comparison_section(
        {
            "title": "4 starts",
            "summary": [agent, bound],
            "failures": ["One lost."],
            "certified": {"gaps": gaps},
        }
    )
    assert section.text == "4 starts."
    assert section.checks == [(False, "One lost.")]
    assert section.facts == [
        Fact("agent", "solves its task from 2 of 4 starts, 12.00 N s of thrust (mean)"),
        Fact(
            "least time",
            "solves its task from 2 of 4 starts, 12.00 N s of thrust (mean); the optimiser found none from 1",
        ),
        Fact(
            "gap of agent: impulse by 9 s",
            "2.000 times the certified least, mean of 1 of 2 starts",
            "limits",
        ),
        Fact("gap of agent: by 6 s", "never, of 1 start", "limits"),
    ]


@pytest.mark.parametrize("picture", ["no picture", "<html/>"])
def test_a_picture_that_is_none_is_one_sentence(run, picture):
    """Or one that brings a script along."""
    (run / "episode.svg").write_text(picture)
    with pytest.raises(
        ConfigError, match=r"the picture .*episode\.svg was not put into the report: it "
    ):
        report_from_run(run)


def test_two_packages_may_add_to_the_same_file(run, tmp_path_factory, monkeypatch):
    place = tmp_path_factory.mktemp("packages")
    for name in ("sun", "moon"):
        (place / f"{name}_pages.py").write_text(
            "from rans.show.pages.page import Section\n"
            f"def section(file, content): return Section('{name} of ' + file.name)\n"
        )
        info = place / f"{name}_pages-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}-pages\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(
            f"[rans.planted_sections]\nevaluation*.json = {name}_pages:section\n"
        )
    monkeypatch.syspath_prepend(str(place))
    planted = Registry("section", "rans.planted_sections", {}, lambda build: build)
    monkeypatch.setattr(report_module, "SECTIONS", planted)
    titles = [section.title for section in report_from_run(run).sections]
    assert {"sun of evaluation.json", "moon of evaluation.json"} <= {*titles}


def test_notes_of_a_package_leave_the_headline_to_the_training(tmp_path, monkeypatch):
    """A section that has found nothing out says no result."""
    (tmp_path / "notes.json").write_text(json.dumps({"author": "Ada"}))
    offered = [("notes.json", lambda file, notes: Section("Notes"))]
    monkeypatch.setattr(report_module, "SECTIONS", SimpleNamespace(each=lambda: offered))
    assert report_from_run(tmp_path).hero == ""
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "metrics.jsonl").write_text(json.dumps({"steps": 2000, "success": 0.75}))
    hero = report_from_run(tmp_path).hero
    assert "75.0% of its last episodes in training, after 2,000 steps" in hero
    row = {"steps": 2000, "success": 0.75, "member": 1}  # of a sweep of version 0.3
    (tmp_path / "metrics.jsonl").write_text(json.dumps(row))
    assert report_from_run(tmp_path).hero == ""
