"""Texts of strangers in every page: they are read, and run nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

import rans
from rans import RansError
from rans.api.pages import flyers
from rans.base.files import write_json
from rans.base.table import Table
from rans.episode.flight import Flight
from rans.evaluation.measure.aggregate import measure
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions
from rans.show import markup
from rans.show.pages.comparison_page import page as comparison_page
from rans.show.pages.notebook import html_of
from rans.show.pages.page import Fact, Page, Section
from rans.show.pages.playground import playground
from rans.show.pages.replay import replay_page
from rans.show.pages.report import evaluation_page, report_from_run
from tests.support import comparisons
from tests.support.browser import HOSTILE, HOSTILE_NAME, live, ran
from tests.support.damage import edited
from tests.support.evaluation_flights import two_episodes
from tests.support.training_rows import ROWS
from tests.support.written_files import contents

pytestmark = [
    # Such names leave no room for the axes of some figures.
    pytest.mark.filterwarnings("ignore:constrained_layout not applied"),
]
PACKAGE = Path(rans.__file__).parent


def spacecraft_file(folder: Path) -> Path:
    """The floating platform under a hostile name; a file's name cannot hold a slash."""
    text = (files("rans.data.spacecraft") / "floating-platform.toml").read_text("utf-8")
    file = folder / "<img src=hostile onerror=hostile()>.toml"
    file.write_text(
        re.sub(r"(?m)^name = .*", lambda _: f"name = {json.dumps(HOSTILE_NAME)}", text), "utf-8"
    )
    return file


def flight() -> Flight:
    """Of a hostile controller and spacecraft."""
    flown = two_episodes()
    return replace(flown, controller=HOSTILE, craft=replace(flown.craft, name=HOSTILE_NAME))


UNSEEN = {"assurance-lab.json"}
"""Files of which a page says no text as it stands, but numbers, and words of its own."""


def planted(value: Any) -> Iterator[Any]:
    """Copies of the value with one text, of a value or a key, made hostile; of every text in turn."""

    def hostile(one: Any) -> Iterator[Any]:
        if isinstance(one, str):
            yield HOSTILE
        for key in one if isinstance(one, dict) else ():
            yield {HOSTILE if name == key else name: x for name, x in one.items()}

    return (other for _, other in edited(value, hostile))


def written(folder: Path, files: dict[str, Any]) -> None:
    folder.mkdir(exist_ok=True)
    for name, content in files.items():
        write_json(folder / name, content)
    (folder / "metrics.jsonl").write_text("\n".join(map(json.dumps, ROWS)))


@pytest.mark.parametrize("name", sorted(contents()))
def test_a_report_of_a_stranger_is_text(name, tmp_path, monkeypatch):
    """Every text and every key of every file in turn: a page in which it is a text, or a sentence."""
    # Drawn for every text they take seconds, and they show none of it.
    monkeypatch.setattr("rans.show.pages.report.learning_charts", lambda rows: ())
    if name == "config.json":  # which is shown beside the rows of a training alone
        written(tmp_path, {})
    shown = 0
    for content in planted(contents()[name]):
        write_json(tmp_path / name, content)
        try:
            html = report_from_run(tmp_path).html()
        except RansError:
            continue
        assert live(html) == []
        shown += "hostile()" in html
    assert shown or name in UNSEEN


@pytest.mark.parametrize(
    "planted",
    [
        "<script>hostile()</script>",
        "<img src=hostile onerror=hostile()>",
        '<p title="x" onclick="y">',
        '<script>const x = "<!--<script>";</script>',
    ],
)
def test_live_texts_are_seen(planted):
    assert live(f"<body>{planted}</body>")


def pages(folder: Path) -> dict[str, Callable[[], str]]:
    """Every kind of page, made of hostile texts wherever a file of a stranger, or its name, has them."""
    file = spacecraft_file(folder)
    craft = load_spacecraft(file)
    conditions = replace(load_conditions("lab"), description=HOSTILE)
    comparison = comparisons.comparison()
    (entry,) = comparison.entries
    hostile_entry = replace(
        entry,
        contestant=replace(entry.contestant, name=HOSTILE, knows=HOSTILE, tuning=HOSTILE),
        flight=replace(entry.flight, craft=craft, controller=HOSTILE),
    )
    comparison = replace(
        comparison,
        contest=replace(comparison.contest, craft=craft),
        entries=[hostile_entry],
        failures=[HOSTILE],
        notes=[HOSTILE],
    )
    (flyer,) = flyers((f"any-craft-2d@{file}",), None, False)
    folder = folder / "<img src=hostile onerror=hostile()>"
    written(folder, contents())
    (folder / "spacecraft.toml").write_text(file.read_text("utf-8"), "utf-8")
    table = Table((HOSTILE, "n"), [(HOSTILE, 1.0)], HOSTILE, colours={HOSTILE: "red"})
    fact = Fact(HOSTILE, "1", passed=True, note=HOSTILE)
    section = Section(
        HOSTILE, 9 * HOSTILE, [table], [], [fact], [HOSTILE], [HOSTILE], link="x.html", hero=HOSTILE
    )

    return {
        "playground": playground(flyer).html,
        "replay": replay_page([flight()], HOSTILE).html,
        "evaluation": evaluation_page([measure(flight())], flight(), HOSTILE).html,
        "comparison": comparison_page(comparison, HOSTILE).html,
        "report": report_from_run(folder).html,
        "page": Page(HOSTILE, [section], {HOSTILE: HOSTILE}).html,
        **{
            type(value).__name__: partial(html_of, value)
            for value in (craft, conditions, measure(flight()), flight(), comparison)
        },
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("hostile")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # an agent for any craft is written into runs/
        return {name: html() for name, html in pages(folder).items()}


def test_every_kind_of_page_is_text(made):
    assert "onerror" in made["playground"]
    assert {name: live(html) for name, html in made.items() if live(html)} == {}
    heads = [html.partition("<script")[0] for html in made.values() if "<html" in html]
    assert all("Content-Security-Policy" in head for head in heads)  # no request leaves a page


@pytest.mark.slow
def test_a_browser_runs_nothing_of_them(made, tmp_path):
    """Chromium reads a page by rules of its own; a page beside them that does run such a text says so."""
    assert ran(made, tmp_path / "profile") == ["control"]


def test_code_that_would_end_its_script_is_refused():
    for text in ("a</script>", "a</ScRiPt x", "a<!--b", 'x = "<script'):
        with pytest.raises(ValueError, match="ends its script element"):
            markup.code("const a = 1;", text)
    assert json.loads(markup.data({"a": HOSTILE})) == {"a": HOSTILE}


def test_only_one_module_makes_mark_up():
    """No template calls a text safe, and no module escapes or marks texts by itself."""
    templates = [file for kind in ("*.j2", "*.html") for file in PACKAGE.rglob(kind)]
    assert templates
    assert [
        file.name
        for file in templates
        if re.search(r"\|\s*(safe|tojson)\b|autoescape", file.read_text())
    ] == []
    maker = re.compile(r"^\s*(?:import|from) (?:html|markupsafe)\b|def __html__", re.MULTILINE)
    makers = [file.name for file in PACKAGE.rglob("*.py") if maker.search(file.read_text("utf-8"))]
    assert makers == ["markup.py"]
