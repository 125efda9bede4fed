"""The table of what effects cost."""

from __future__ import annotations

import pytest

from campaigns.speed import conditions
from campaigns.speed.conditions import EFFECTS, Cost, costs, table
from rans.model.spacecraft import Spacecraft
from tests.support.engines import FLYER, PLATFORM
from validation.speed.measurement import Clock


@pytest.mark.parametrize(
    ("craft", "moved"),
    [(PLATFORM, (135, 135, 151)), (FLYER, (259, 259, 291))],
    ids=["plane", "space"],
)
def test_what_is_drawn_again_moves_no_byte(
    craft: Spacecraft, moved: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A latency needs the last command: a byte for each of 8 or 16 thrusters, read and written."""
    monkeypatch.setattr(
        conditions, "EFFECTS", {name: EFFECTS[name] for name in ("force", "latency")}
    )
    perfect, force, latency = costs(craft, 4, Clock("cpu"))
    assert tuple(one.bytes_moved for one in (perfect, force, latency)) == moved
    assert perfect.operations < force.operations < latency.operations
    assert (perfect.name, perfect.rate) == ("a perfect world", None)


def test_shares_are_of_the_first_row() -> None:
    rows = table(
        [Cost("none", 1, 200, 135, 28000.0), Cost("late", 2, 1400, 151, 7000.0)]
    ).splitlines()
    assert rows[2] == "| none | 1 | 200 | 135 | 28.00 | 100 % |"
    assert rows[3] == "| late | 2 | 1,400 | 151 | 7.00 | 25 % |"
