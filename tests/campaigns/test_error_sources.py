"""Tables of missions that were not flown are empty."""

from __future__ import annotations

from campaigns.error_sources import costs

ROW = {
    "arrival": [10.0],
    "impulse": [2.0],
    "margin": [0.5],
    "mean impulse": 1.0,
    "won": 1.0,
}


def test_what_was_not_flown_has_no_rows() -> None:
    more = {**ROW, "impulse": [3.0], "mean impulse": 1.5}
    rows = [
        {**ROW, "mission": "dock", "error": "none"},
        {**more, "mission": "dock", "error": "mass"},
    ]
    assert costs({"rows": rows}, "hold") == []
    (found,) = costs({"rows": rows}, "dock")
    assert (found["mean"], found["spent"]) == (0.5, 0.5)
