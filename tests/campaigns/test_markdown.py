"""Tables that studies write into documents."""

from campaigns.markdown import with_table

PAGE = "before\n<!-- table: a command -->\nold\n<!-- end of table -->\nafter\n"


def test_the_table_goes_between_its_marks():
    page = with_table(PAGE, "a command", ("one", "two"), [("1", "2"), ("3", "4")], "Where from.")
    table = "| one | two |\n| --- | --- |\n| 1 | 2 |\n| 3 | 4 |\n\nWhere from.\n"
    assert page == f"before\n<!-- table: a command -->\n{table}<!-- end of table -->\nafter\n"
    assert (
        with_table(page, "a command", ("one", "two"), [("1", "2"), ("3", "4")], "Where from.")
        == page
    )
