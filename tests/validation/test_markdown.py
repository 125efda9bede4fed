"""Tables that studies write into documents."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from rans.errors import ConfigError
from validation import agents, assurances, rest
from validation.markdown import with_table

PAGE = "before\n<!-- table: a command -->\nold\n<!-- end of table -->\nafter\n"
DOCS = Path(__file__).parents[2] / "docs"


def test_the_table_goes_between_its_marks() -> None:
    page = with_table(PAGE, "a command", ("one", "two"), [("1", "2"), ("3", "4")], "Where from.")
    table = "| one | two |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n\nWhere from.\n"
    assert page == f"before\n<!-- table: a command -->\n{table}<!-- end of table -->\nafter\n"
    assert with_table(page, "a command", ("one", "two"), [("1", "2"), ("3", "4")], "Where from.") == page


@pytest.mark.parametrize("page", ["no marks", PAGE.replace("a command", "another"), PAGE[:40]])
def test_a_page_without_a_place_for_it_stays_as_it_is(page: str) -> None:
    with pytest.raises(ConfigError, match="must have the lines <!-- table: a command -->"):
        with_table(page, "a command", ("one",), [])


@pytest.mark.parametrize(("page", "study"), [("agents", agents), ("agents", rest), ("assurance", assurances)])
def test_the_pages_have_the_marks(page: str, study: ModuleType) -> None:
    """Each its own, though two tables stand in one page."""
    with_table((DOCS / f"{page}.md").read_text("utf-8"), study._COMMAND, study._HEADINGS, [])
