"""What is listed is what is: formulas against the tasks themselves."""

from __future__ import annotations

import math

import rans
from rans.show.tables.listing import conditions_listing, task_listings


def test_ends_and_ranges_by_value() -> None:
    listings = {one.title: one for one in task_listings(rans.GoToPose(position_tolerance=0.02))}
    ends = listings["An episode"]
    assert ends.rows[0] == ("truncated", "125 control periods of 0.2 s are over, 25 s")
    near = f"position 0.02 m, attitude {math.radians(5):.4g} rad"
    assert ends.rows[2][1] == f"truncated with errors within {near}"
    conditions = rans.Conditions(
        rans.BodyConditions(mass=(0.5, 1.5)), rans.ThrusterConditions(latency=0.1)
    )
    assert conditions_listing(conditions).rows == [
        ("body.mass", "0.5 to 1.5"),
        ("thrusters.latency", "0.1"),
    ]
