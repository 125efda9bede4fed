"""Figures of the documents are those of the files in docs/validation that they came from."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from campaigns.figures import validations, values
from campaigns.table import PAGES, table

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def figures(name: str) -> Any:
    return json.loads((DOCS / "validation" / f"{name}.json").read_text("utf-8"))


@pytest.mark.parametrize("name", PAGES)
def test_a_table_is_what_its_file_says(name):
    """`python -m campaigns.figures` writes them."""
    found = table(DOCS, name)
    assert found.rows
    assert found.within(DOCS) == (DOCS / found.page).read_text("utf-8")


@pytest.mark.slow
def test_every_marked_table_is_compared():
    pages = [ROOT / "README.md", *DOCS.rglob("*.md"), *ROOT.glob("packages/*/docs/*.md")]
    marks = [
        mark
        for page in pages
        for mark in re.findall(r"<!-- table: (.*) -->", page.read_text("utf-8"))
    ]
    assert sorted(marks) == sorted(PAGES)


def sentences() -> Iterator[tuple[str, str]]:
    """Pages, and what they must say."""
    gate = figures("settled-gate")["settled"]["runs/settled-gate"]
    sign, gain, bias = (
        f"{gate[kind]['value']:.1f} %" for kind in ("sign", "gain", "gain and bias")
    )
    yield (
        "assurance/robustness",
        f"ours solves {sign} of the sign faults, {gain} of the gains and {bias} of gains",
    )
    checks = [
        int(re.findall("Of ([0-9]+) flights", one["reason"])[0])
        for one in figures("bounds")["checks"]
    ]
    yield "bounds/certificate", f"none of {checks[0]:,} flights is below its hull bound"
    yield "bounds/certificate", f"none of {checks[2]} below the certificate's dual bound"
    for task in ("pose", "position"):
        held, duty = (worst("3DoF go to " + task, what) for what in ("PT5 / 2 / 1", "duty"))
        yield "measured", f"{task} {' / '.join(f'{x:.1f}' for x in held)} %, {duty[0]:.1f} %"
    paths = [worst(f"3DoF follow the {path}", "")[0] for path in ("circle", "spiral", "square")]
    yield "measured", f"{paths[0]:.1f}, {paths[1]:.1f} and {paths[2]:.1f} cm"


def worst(row: str, what: str) -> list[float]:
    """Of a row of agents.json, the figures of the worst training."""
    lines = figures("agents")["lines"]
    return next(
        one["worst"] for one in lines if one["row"].startswith(row) and what in ("", one["what"])
    )


def test_sentences_say_what_their_files_say():
    for page, sentence in sentences():
        text = " ".join((DOCS / f"{page}.md").read_text("utf-8").split())
        assert sentence in text, f"docs/{page}.md should say: {sentence}"


def test_a_check_that_allows_nothing_has_a_share_of_its_tolerance(tmp_path):
    """As many checks of a validation allow nothing: 0 of 0 is kept, and more is beyond every tolerance."""
    (tmp_path / "validation").mkdir()
    about = {"unit": "-", "reason": "", "worst": "", "layer": "onsets", "passed": True}
    checks = [
        {"name": "kicks: of an episode", "value": 0.0, "tolerance": 0.0, **about},
        {"name": "faults: a period late", "value": 1.0, "tolerance": 0.0, **about},
    ]
    study = {"checks": checks}
    file = tmp_path / "validation" / "floating-platform.json"
    file.write_text(json.dumps(study), "utf-8")
    _, rows = values(tmp_path)
    assert [row[-1] for row in rows] == ["0e+00", "inf"]
    _, ((*_, passed, _),) = validations(tmp_path)
    assert passed == "1 of 2"
