"""Bounds of engines throttled alike and one by one, and the row of a table that they become."""

from __future__ import annotations

import math

from campaigns.runner import texts
from campaigns.table import ROWS


def test_a_row_counts_landings_and_says_what_the_others_need() -> None:
    row = {
        "engines": "some",
        "alike": (300.0, 320.0, math.inf, math.inf, math.inf),
        "apart": (299.0, 319.0, 398.0, math.inf, math.inf),
        "needed": (410.2, math.inf),
    }
    _, rows = texts(ROWS["throttling"].tables["throttling"], {"rows": [row]})
    assert rows == [
        [
            "some",
            "5",
            "2",
            "3",
            "310.0 kg",
            "309.0 kg",
            "1: 410 to 410 kg; 1: too little thrust",
        ]
    ]
