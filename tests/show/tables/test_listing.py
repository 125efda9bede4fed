"""What a listing says of an episode's end."""

from __future__ import annotations

import pytest

from rans.show.tables.listing import task_listings
from tests.support.missions import Pass


@pytest.mark.parametrize(
    ("ends", "said"), [(True, "terminated, failed"), (False, "goes on, and is no success")]
)
def test_a_violation_ends_an_episode_where_the_task_says_so(ends, said):
    tables = {table.title: table for table in task_listings(Pass(violation_ends=ends))}
    told = [
        what for what, when in tables["An episode"].rows if when == "a margin is negative: wall"
    ]
    assert told == [said]
