"""Texts of strangers in every page: they are read, and run nothing."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from rans_assurance.assure.assurance import Assurance
from rans_assurance.assure.bounds import plan
from rans_assurance.assure.campaign import Campaign
from rans_assurance.stress.effects import Level
from rans_assurance.stress.outcome import StressOutcome
from rans_assurance.stress.report import StressReport

import rans
from rans.api.pages import flyers
from rans.errors import RansError
from rans.evaluation.measure.aggregate import measure
from rans.files import write_json
from rans.flight import Flight
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions
from rans.show import markup
from rans.show.pages.comparison_page import page as comparison_page
from rans.show.pages.notebook import html_of
from rans.show.pages.page import Finding, Page, Section, Tile
from rans.show.pages.playground import playground
from rans.show.pages.replay import replay_page
from rans.show.pages.report import evaluation_page, report_from_run
from rans.table import Table
from tests.support import comparisons
from tests.support.browser import HOSTILE, HOSTILE_NAME, live, ran
from tests.support.evaluation_flights import two_episodes
from tests.support.stress_runs import small
from tests.support.training_rows import ROWS

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


BOUND = {"failures": 17, "flights": 2000, "rate": 0.01, "at least": 0.004, "at most": 0.015}


def run_folder() -> dict[str, Any]:
    """Contents of a run folder's files as RANS writes them, with harmless texts."""
    summary = {"contestant": "agent", "starts": 1, "flown": 1, "solved": 1, "kind": "agent"}
    check = {
        "name": "force",
        "value": 1e-16,
        "tolerance": 1e-12,
        "unit": "N",
        "reason": "Rounding.",
    }
    held = {"held": {"value": 0.5, "low": 0.1, "high": 0.9}}
    return {
        "config.json": {
            "seed": 3,
            "task": {"name": "go-to-pose"},
            "conditions": {"description": "a laboratory"},
            "about": {
                "command": "rans train",
                "environment": {"rans": "0.1", "gpu": {"name": "none"}},
            },
        },
        "validation.json": {
            "title": "Dynamics",
            "checks": [check | {"passed": True}],
            "skipped": [{"name": "kernel", "reason": "No compiler."}],
        },
        "evaluation.json": {
            "conditions": {"contestant": "agent"},
            "agent": measure(two_episodes()).to_json(),
        },
        "compare.json": {
            "hero": "A settles.",
            "tiles": [{"label": "solved", "value": "1 %", "note": "of 2"}],
            "title": "1 start",
            "failures": ["none came"],
            "summary": [summary],
        },
        "stress.json": {
            "title": "agent",
            "failures": [],
            "notes": ["a note"],
            "conditions": {"lab": {"size": None, "contestants": {"agent": held}}},
            "effects": {"latency": {"unit": "s", "holds_to": {"agent": 0.1}}},
        },
        "assurance-lab.json": {
            "about": {
                "agent": "agent",
                "confidence": 0.99,
                "below": None,
                "looks": [[2000, 0.01, 0.01]],
            },
            "decision": "open",
            "command": "rans assure agent",
            "bounds": {"any": BOUND, "LEFT": BOUND},
        },
        "sweep.json": {
            "best": 0,
            "members": [
                {
                    "member": 0,
                    "seed": 0,
                    "diverged": False,
                    "solved": True,
                    "steps": 1000,
                    "success": 1.0,
                    "rate": "1e-3",
                }
            ],
        },
    }


UNSEEN = {"assurance-lab.json"}
"""Files of which a page says no text as it stands, but numbers, and words of its own."""
MANY_TEXTS = {"config.json": 1, "evaluation.json": 9, "stress.json": 1}
"""Files of so many texts that a page with each takes seconds; of rows that are alike every so manieth is enough."""


def planted(value: Any) -> Iterator[Any]:
    """The value with one text, of a value or a key, made hostile; of every text in turn."""
    if isinstance(value, str):
        yield HOSTILE
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from ([*value[:k], other, *value[k + 1 :]] for other in planted(inner))
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield {HOSTILE if name == key else name: x for name, x in value.items()}
            yield from (value | {key: other} for other in planted(inner))


def written(folder: Path, contents: dict[str, Any]) -> None:
    folder.mkdir(exist_ok=True)
    for name, content in contents.items():
        write_json(folder / name, content)
    (folder / "metrics.jsonl").write_text("\n".join(map(json.dumps, ROWS)))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in MANY_TEXTS))
        for name in sorted(run_folder())
    ],
)
def test_a_report_of_a_stranger_is_text(name: str, tmp_path: Path) -> None:
    """Every text and every key of every file in turn: a page in which it is a text, or a sentence."""
    written(tmp_path, {})
    shown = 0
    for content in islice(planted(run_folder()[name]), None, None, MANY_TEXTS.get(name, 1)):
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
def test_live_texts_are_seen(planted: str) -> None:
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
    campaign = Campaign(plan(0.99, 2000, None), 1, flights=2000)
    assurance = Assurance(
        f"any-craft-2d@{file}",
        HOSTILE,
        campaign,
        command=HOSTILE,
        environment={HOSTILE: HOSTILE},
        given=flyer.under(conditions),
    )
    folder = folder / "<img src=hostile onerror=hostile()>"
    written(folder, run_folder())
    (folder / "spacecraft.toml").write_text(file.read_text("utf-8"), "utf-8")
    table = Table((HOSTILE, "n"), [(HOSTILE, 1.0)], HOSTILE, colours={HOSTILE: "red"})
    section = Section(HOSTILE, 9 * HOSTILE, [table], [], [Finding(HOSTILE)], link="x.html")

    stress = small("lqr:go-to-pose-2d", episodes=2)
    ((spec, contestant),) = stress.contestants.items()
    stress.contestants = {spec: replace(contestant, name=HOSTILE, knows=HOSTILE, tuning=HOSTILE)}
    stress.named = [Level(HOSTILE, None, conditions)]
    stress.outcomes = {
        (level.name, HOSTILE): StressOutcome.of(two_episodes()) for level in stress.levels
    }

    return {
        "playground": playground(flyer).html,
        "replay": replay_page([flight()], HOSTILE).html,
        "evaluation": evaluation_page([measure(flight())], flight(), HOSTILE).html,
        "comparison": comparison_page(comparison, HOSTILE).html,
        "assurance": Page(HOSTILE, [assurance.section]).html,
        "stress": Page(HOSTILE, [StressReport(stress, folder, 1, HOSTILE).section]).html,
        "report": report_from_run(folder).html,
        "page": Page(
            HOSTILE, [section], {HOSTILE: HOSTILE}, HOSTILE, HOSTILE, [Tile(*[HOSTILE] * 3)]
        ).html,
        **{
            type(value).__name__: partial(html_of, value)
            for value in (craft, conditions, measure(flight()), flight(), comparison)
        },
    }


@pytest.mark.slow
def test_every_kind_of_page_is_text_and_a_browser_runs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chromium reads a page by rules of its own; a page beside them that does run such a text says so."""
    monkeypatch.chdir(tmp_path)  # an agent for any craft is written into runs/
    made = {name: html() for name, html in pages(tmp_path).items()}
    assert {name: live(html) for name, html in made.items() if live(html)} == {}
    assert ran(made, tmp_path / "profile") == ["control"]


def test_a_craft_in_the_playground_is_text(here: Path) -> None:
    (flyer,) = flyers((f"any-craft-2d@{spacecraft_file(here)}",), None, False)
    html = playground(flyer).html()
    assert "onerror" in html
    assert live(html) == []


def test_code_that_would_end_its_script_is_refused() -> None:
    for text in ("a</script>", "a</ScRiPt x", "a<!--b", 'x = "<script'):
        with pytest.raises(ValueError, match="ends its script element"):
            markup.code("const a = 1;", text)
    assert json.loads(markup.data({"a": HOSTILE})) == {"a": HOSTILE}


def test_only_one_module_makes_mark_up() -> None:
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
