"""Starts of rows that are divided among processes come back whole, in order and row by row."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st

from campaigns.parts import in_parts


def numbered(_: None, row: str, first: int, count: int, shift: int) -> np.ndarray:
    return shift + np.arange(first, first + count)


@given(st.lists(st.integers(1, 9), min_size=1, max_size=4), st.integers(1, 30))
def test_every_start_of_every_row_comes_once_and_in_order(sizes, count):
    together = {f"row {k}": size for k, size in enumerate(sizes)}
    found = list(in_parts(numbered, together, count, 1, 100))
    assert [row for row, _ in found] == list(together)
    for row, parts in found:
        np.testing.assert_array_equal(np.concatenate(parts), 100 + np.arange(count))
        assert max(map(len, parts)) <= together[row]
