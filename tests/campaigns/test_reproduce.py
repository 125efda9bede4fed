"""Tables flown again: what agrees with the published cells, worked out by hand, and what is listed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from campaigns import reproduce
from campaigns.markdown import Table
from campaigns.provenance import page, unlisted
from campaigns.reproduce import agree, compared, reproduced
from campaigns.runner import Campaign, Shown
from campaigns.table import ROWS

ROOT = Path(__file__).parents[2]
HUNDRED = 100.0, 100.0


def test_every_table_and_file_has_a_source_and_the_page_is_made_from_them():
    """`python -m campaigns.provenance` writes it."""
    assert not unlisted(ROOT / "docs")
    assert page() == (ROOT / "docs" / "provenance.md").read_text("utf-8")
    for source in ROWS.values():
        assert all((ROOT / "docs" / "validation" / name).exists() for name in source.evidence)


@pytest.mark.parametrize(
    ("published", "found", "agrees"),
    [
        # Of 100 and 100 flights p = 0.5 has a deviation of 7 %, and 3 of them are 21 %; of 0.93, 10.7 %.
        ("40.0", "60.0", True),
        ("40.0", "62.0", False),
        ("100.0", "96.0", True),
        ("100.0", "88.0", False),
        ("99.8 / 40.0", "99.0 / 55.0", True),
        ("99.8 / 40.0", "99.0 / 80.0", False),
        ("99.8 (of 4)", "99.8 (of 4) met", False),
        ("40.0", "never", False),
    ],
)
def test_shares_agree_within_three_deviations(published, found, agrees):
    assert agree(published, found, True, HUNDRED, 0.0) is agrees


@pytest.mark.parametrize(
    ("published", "found", "agrees"),
    [
        ("1.000", "1.050", True),
        ("1.000", "1.060", False),
        ("12,240 s", "12,800 s", True),
        ("12,240 s", "13,800 s", False),
        ("2e-16", "3e-16", True),  # one in the last digit
        ("2e-16", "5e-16", False),
        ("0.0", "0.1", True),
        ("0.0", "0.2", False),
        ("5.0 N s", "5.0 kg", False),
        # (22 + 2) of (34 + 4) has a deviation of 35 % between 32 and 2 flights, of 14 % between 32 and 20.
        ("one dead, 20 of 32", "one dead, 2 of 2", True),
        ("one dead, 20 of 32", "one dead, 2 of 20", False),
        ("one dead, 20 of 32", "two dead, 2 of 2", False),
        # A mean of fewer starts, within 5 %.
        ("1.010 of 32", "1.019 of 1", True),
        ("1.010 of 32", "1.090 of 1", False),
        ("-", "1.0", False),
    ],
)
def test_numbers_agree_within_a_tolerance(published, found, agrees):
    assert agree(published, found, False, (0.0, 0.0), 0.05) is agrees


SOURCE = Campaign("x.md", {"x": Shown()}, flights=(100, 100), uncompared=("worst",))


def table(*rows: tuple[str, ...]) -> Table:
    return Table("x.md", "x", ("who", "starts", "won, %", "impulse", "worst"), rows, "")


def test_a_table_is_compared_cell_by_cell():
    before = table(("lqr", "1,024", "90.0", "2.00", "3"), ("mpc", "64", "50.0", "1.00", "2"))
    now = table(("lqr", "1,024", "80.0", "2.01", "9"), ("mpc", "64", "60.0", "1.00", "2"))
    found = [one for one, _ in compared(before, now, SOURCE, False, False) if one is not None]
    # 10 % of 1,024 flights is 7 deviations, of 64 flights 1.1.
    assert [(one.row, one.column, one.agrees) for one in found] == [
        ("lqr", "won, %", False),
        ("lqr", "impulse", True),
        ("mpc", "won, %", True),
    ]
    strict = [one for one, _ in compared(before, now, SOURCE, False, True) if one is not None]
    assert not any(one.agrees for one in strict)
    assert sum(count for _, count in compared(before, now, SOURCE, False, False)) == 8


def test_a_row_is_flown_in_a_copy_and_a_changed_figure_is_reported(tmp_path):
    """The command here changes two shares of the evidence: by as much as fewer flights may, and by far more."""
    name = "dock-errors.json"
    command = f"""import json
evidence = json.load(open({str(ROOT / "docs" / "validation" / name)!r}))
evidence["rows"][0]["won"] -= 0.002
evidence["rows"][1]["won"] -= 0.5
json.dump(evidence, open("docs/validation/{name}", "w"))"""
    (tmp_path / "change.py").write_text(command)
    source = replace(ROWS["dock with errors"], commands=(f"python {tmp_path / 'change.py'}",))
    before = (ROOT / "docs" / "validation" / name).read_bytes()
    result = reproduced("dock with errors", source, False, tmp_path / "flown")
    assert (ROOT / "docs" / "validation" / name).read_bytes() == before
    assert [one.column for one in result.differences] == ["docked, %", "docked, %"]
    text = reproduce.report([result], False, 1.0)
    assert "| dock with errors |" in text
    assert "| revision |" in text
