"""The campaign of assurances at a small size; what it counts is tested in packages/assurance/tests."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from campaigns import assurances
from campaigns.assurances import Assurances, _campaigns
from rans.verdict import Failure


@pytest.mark.slow
def test_campaigns_become_a_table_and_go_on(tmp_path: Path) -> None:
    page = tmp_path / "assurance" / "assurances.md"
    page.parent.mkdir()
    page.write_text("<!-- table: assurances -->\n<!-- end of table -->\n", "utf-8")
    study = Assurances(("go-to-pose-2d-thrifty",), 300, replay=False, docs=tmp_path)
    assert study.run() == 0
    file = tmp_path / "validation" / "assurance" / "go-to-pose-2d-thrifty.json"
    first = json.loads(file.read_text("utf-8"))
    assert (first["campaign"]["flights"], first["bounds"]["any"]["flights"]) == (300, 300)
    failed = first["bounds"]["any"]["failures"]
    assert f"| 300 | {failed} | " in page.read_text("utf-8")
    study.run()
    assert (
        json.loads(file.read_text("utf-8"))["campaign"] == first["campaign"]
    )  # its seconds too: not flown


def test_who_is_flown_in_what() -> None:
    robust = "pretrained:go-to-pose-2d-robust"
    found = list(_campaigns(("go-to-pose-2d-robust", "multi-task-2d")))
    assert found[:2] == [(robust, "perfect"), (robust, "lab")]
    assert ("pretrained:multi-task-2d#track-twist", "perfect") in found
    assert len(found) == 2 + 5


def test_every_failure_has_a_word() -> None:
    assert assurances._SHORT.keys() == set(Failure)
