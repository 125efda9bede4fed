"""A page's verdict, and how it was made, as a reader sees them."""

import re

import pytest

from rans.show.pages.page import Fact, Page, Section, header
from rans.show.pages.report import validation_section

GOOD = Fact("pressure", "1 bar", passed=True)
BAD = Fact("leak", "2 g/s", passed=False, note="1 g/s allowed")
NOTE = Fact("colour", "white")


@pytest.mark.parametrize(
    ("facts", "failures", "passed", "first"),
    [
        ([], [], None, None),
        ([NOTE], [], None, None),
        ([GOOD, NOTE], [], True, "pressure: 1 bar"),
        ([GOOD, BAD, NOTE], [], False, "leak: 2 g/s (1 g/s allowed)"),
        ([GOOD], ["It burst."], False, "It burst."),
    ],
)
def test_verdict_and_its_box(facts, failures, passed, first):
    page = Page("title", [Section("one", facts=facts, failures=failures)])
    assert page.passed is passed
    boxes = re.findall(
        r'<div class="verdict (good|bad)">.*?<li>.*?<span>(.*?)</span>', page.html(), re.S
    )
    assert boxes == ([] if passed is None else [("good" if passed else "bad", first)])


def test_a_study_that_checked_nothing_passes_nothing():
    section = validation_section(
        {"title": "Empty", "checks": [], "skipped": [{"name": "kernel", "reason": "No compiler."}]}
    )
    assert section.checks == []
    assert section.notes == ["Not run: kernel. No compiler."]
    assert section.tables[0].rows == [["kernel", None, None, None, "not run", None, "No compiler."]]


def test_how_it_was_made_is_one_line_a_group():
    assert header(
        {"seed": 3, "versions": {"torch": "2.9", "gpu": {"name": "none"}}, "layers": [64, 64]}
    ) == {"seed": "3", "versions": "torch 2.9, gpu.name none", "layers": "64, 64"}
