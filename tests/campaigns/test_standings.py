"""The first table of each mission's page: nobody in the evidence is cheaper than the least known flight."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from campaigns.standings import MISSIONS, rows as standings
from rans.base.files import write_json

DOCS = Path(__file__).parents[2] / "docs"


def _ratio(row: Sequence[str]) -> float:
    """The mean ratio of a row, which may be of fewer starts than the row."""
    return float(row[4].partition(" of ")[0])


@pytest.mark.parametrize("mission", MISSIONS)
def test_nobody_who_always_wins_is_cheaper(mission):
    _, lines = standings(DOCS, mission)
    (cheapest,) = (row for row in lines if row[0] == "least known")
    ratio = _ratio(cheapest)
    others = [_ratio(row) for row in lines if row[3] == "100.0" and row[4] != "-"]
    assert ratio <= min(others)


@pytest.mark.parametrize("mission", MISSIONS)
def test_the_page_has_the_table_of_the_evidence(mission):
    page = (DOCS / "missions" / f"{mission}.md").read_text("utf-8")
    for row in standings(DOCS, mission)[1]:
        assert re.search(r"\| " + re.escape(" | ".join(row)) + r" \|", page), row


def test_ratios_of_fewer_starts_than_their_row_say_so(tmp_path):
    folder = tmp_path / "validation"
    folder.mkdir()
    row = {"condition": "default zones", "starts": 9, "won": 1.0, "ratio": 3.0, "spent": 3.0}
    rows = [
        row | {"who": "pretrained:avoid-2d", "compared": 4},
        row | {"who": "pretrained:avoid-3d", "compared": 3},
        row | {"who": "MPC", "starts": 4, "compared": 4},
    ]
    write_json(folder / "mission-avoid.json", {"episodes": 9, "bounded": 4, "rows": rows})
    write_json(folder / "passive-safety.json", {"rows": []})
    ratios = {line[1]: line[4] for line in standings(tmp_path, "avoid")[1]}
    assert ratios["pretrained:avoid-2d"] == "3.000 of 4"
    assert ratios["pretrained:avoid-3d"] == "3.000 of 3"
    assert ratios["MPC"] == "3.000"


def test_the_least_known_flights_are_of_the_craft_and_stand_once(tmp_path):
    """An agent always wins with 3 N s, guidance wins half with 1; a search finds 2, and throttles would need 1."""
    folder = tmp_path / "validation"
    folder.mkdir()
    agent = {"condition": "default zones", "starts": 9, "won": 1.0, "ratio": 3.0, "spent": 3.0}
    guidance = agent | {"who": "MPC", "won": 0.5, "ratio": 1.0, "spent": 1.0}
    rows = [agent | {"who": "pretrained:avoid-2d"}, guidance]
    write_json(folder / "mission-avoid.json", {"episodes": 9, "rows": rows})
    write_json(folder / "passive-safety.json", {"rows": []})
    front = [{"time": 20.0, "start": 0, "bound": 1.0, "flight": 1.0}]
    write_json(folder / "avoid-front.json", {"rows": front})

    def kinds():
        lines = standings(tmp_path, "avoid")[1]
        return {who: [line[0] for line in lines if line[1] == who] for _, who, *_ in lines}

    assert kinds()["pretrained:avoid-2d"] == ["least known", "agent"]
    found = agent | {"mission": "avoid", "who": "from it", "ratio": 2.0, "spent": 2.0}
    write_json(folder / "least-known.json", {"rows": [found | {"gains": True}]})
    assert kinds()["from it"] == ["least known"]
    assert kinds()["pretrained:avoid-2d"] == ["agent"]
    assert not any("throttled" in who for who in kinds())


def test_times_of_other_deadlines_are_not_in_a_row():
    """Those of passive safety have deadlines of their own, and a row by 1,000 s none of their times."""
    for mission, asked in MISSIONS.items():
        for what, who, *_, time in standings(DOCS, mission)[1]:
            if asked.condition and " by " in who and what != "guidance, passively safe":
                assert time == "-"


def test_a_run_of_another_condition_has_no_cheapest_flight(tmp_path):
    """As a quick run whose deadline is not that of the standings."""
    safety = {"rows": []}
    row = {"who": "guidance", "condition": "4,000 s", "won": 1.0, "starts": 1, "ratio": 1.1}
    write_json(tmp_path / "validation" / "passive-safety.json", safety)
    write_json(tmp_path / "validation" / "mission-rendezvous.json", {"rows": [row]})
    assert "least known" not in [line[0] for line in standings(tmp_path, "rendezvous")[1]]
