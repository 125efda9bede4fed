"""Bounds of engines throttled alike and one by one, and the row of a table that they become."""

from __future__ import annotations

import math

import pytest

from campaigns.throttling import Row, _rows
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.land import Land


def test_a_row_counts_landings_and_says_what_the_others_need() -> None:
    row = Row(
        "some",
        alike=(300.0, 320.0, math.inf, math.inf, math.inf),
        apart=(299.0, 319.0, 398.0, math.inf, math.inf),
        needed=(410.2, math.inf),
    )
    assert row.cells() == [
        "some",
        "5",
        "2",
        "3",
        "310.0 kg",
        "309.0 kg",
        "1: 410 to 410 kg; 1: too little thrust",
    ]


@pytest.mark.slow
def test_one_by_one_needs_no_more_and_a_dead_engine_needs_more() -> None:
    sound, broken = _rows(load_spacecraft("mars-lander-steered"), Land(), 1)
    for row in (sound, broken):
        assert row.apart[0] < row.alike[0]
        assert row.needed == ()
    assert broken.apart[0] > sound.alike[0]
