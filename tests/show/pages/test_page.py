"""A page's verdict and colours, and its tables, as a reader sees them."""

from __future__ import annotations

import re

import pytest

from rans.show.pages.page import Finding, Page, Section, header
from rans.show.pages.report import validation_section

GOOD = Finding("fine", True)
BAD = Finding("broken", False)
NOTE = Finding("noted")


@pytest.mark.parametrize(
    ("findings", "passed", "verdict", "box"),
    [
        ([], None, "Nothing was checked here.", None),
        ([NOTE], None, "Nothing was checked here.", None),
        ([GOOD, NOTE], True, "Everything checked has passed.", "verdict good"),
        ([GOOD, BAD, NOTE], False, "Something has failed.", "verdict bad"),
        ([BAD], False, "Something has failed.", "verdict bad"),
    ],
)
def test_verdict_and_its_box(
    findings: list[Finding], passed: bool | None, verdict: str, box: str | None
) -> None:
    page = Page("title", [Section("one", findings=findings)])
    assert (page.passed, page.verdict) == (passed, verdict)
    html = page.html()
    assert re.findall(r'<div class="(verdict.*?)">', html) == ([box] if box else [])
    assert (verdict in html) is (box is not None)


def test_a_conclusion_is_on_top_though_nothing_was_checked() -> None:
    """As of an assurance in which no flight failed."""
    html = Page("title", [Section("one")], conclusion="0 of 9 flights failed.").html()
    assert html.index("0 of 9 flights failed.") < html.index("<h2")
    assert '<div class="verdict">' in html
    assert "<ul>" not in html


def test_a_study_that_checked_nothing_passes_nothing() -> None:
    section = validation_section(
        {"title": "Empty", "checks": [], "skipped": [{"name": "kernel", "reason": "No compiler."}]}
    )
    assert [(f.text, f.passed) for f in section.findings] == [
        ("Empty: 0 of 0 checks within tolerance.", None),
        ("Not run: kernel. No compiler.", None),
    ]
    assert Page("x", [section]).verdict == "Nothing was checked here."
    assert section.tables[0].rows == [["kernel", None, None, None, "not run", None, "No compiler."]]


def test_how_it_was_made_is_one_line_a_group() -> None:
    assert header(
        {"seed": 3, "versions": {"torch": "2.9", "gpu": {"name": "none"}}, "layers": [64, 64]}
    ) == {"seed": "3", "versions": "torch 2.9, gpu.name none", "layers": "64, 64"}
