"""Tables that studies write into documents."""

from __future__ import annotations

import pytest

from campaigns.markdown import with_table
from rans.errors import ConfigError

PAGE = "before\n<!-- table: a command -->\nold\n<!-- end of table -->\nafter\n"


def test_the_table_goes_between_its_marks() -> None:
    page = with_table(PAGE, "a command", ("one", "two"), [("1", "2"), ("3", "4")], "Where from.")
    table = "| one | two |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n\nWhere from.\n"
    assert page == f"before\n<!-- table: a command -->\n{table}<!-- end of table -->\nafter\n"
    assert (
        with_table(page, "a command", ("one", "two"), [("1", "2"), ("3", "4")], "Where from.")
        == page
    )


@pytest.mark.parametrize("page", ["no marks", PAGE.replace("a command", "another"), PAGE[:40]])
def test_a_page_without_a_place_for_it_stays_as_it_is(page: str) -> None:
    with pytest.raises(ConfigError, match="must have the lines <!-- table: a command -->"):
        with_table(page, "a command", ("one",), [])
