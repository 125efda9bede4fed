"""What a row says of searches, by numbers that are worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.least import SEARCHES, cells, row_of_search
from rans.files import read_json
from tests.support.processes import ROOT


def test_a_row_compares_contestants_with_what_was_found() -> None:
    """Three starts: one gains a half, one gains nothing, and one was won by no contestant."""
    # Columns: convex, mission, found, bound.
    found = np.array([[4.0, 6.0, 2.0, 1.0], [3.0, np.nan, 3.0, 2.0], [np.nan, np.nan, 1.0, 1.0]])
    row = row_of_search("dock", found)
    assert row["before"] == pytest.approx(3.5)
    assert row["spent"] == pytest.approx(2.0)
    assert row["ratio"] == pytest.approx((2.0 + 1.5 + 1.0) / 3.0)
    assert row["improved"] == 2
    assert row["gains"] is True
    convex, mission = row["over"]
    assert (convex["mean"], convex["worst"]) == (pytest.approx(7.0 / 5.0), 2.0)
    assert (mission["mean"], mission["worst"]) == (3.0, 3.0)
    (cell,) = cells({"rows": [row]})
    assert cell["ratios"] == "convex 1.400 (2.000), mission 3.000 (3.000)"


def test_a_search_names_as_many_starts_as_the_evidence_has() -> None:
    rows = read_json(ROOT / "docs/validation/least-known.json")["rows"]
    assert {row["mission"]: row["starts"] for row in rows}.items() <= {
        name: search.starts for name, search in SEARCHES.items()
    }.items()


def test_a_search_that_finds_nothing_gains_nothing() -> None:
    found = np.array([[4.0, 6.0, 4.0 - 1e-6, 1.0], [3.0, 3.5, 3.0, 2.0]])
    row = row_of_search("dock", found)
    assert row["improved"] == 0
    assert row["gains"] is False
