"""``rans tune``."""

from __future__ import annotations

import pytest

from rans import TASKS, Timing
from rans.evaluation.compare.contest import Contest
from rans.evaluation.compare.entrants import simple_controller
from rans.evaluation.fly.tuned import OWN
from rans.model.spacecraft_file import load_spacecraft


@pytest.fixture(autouse=True)
def _few(monkeypatch, here) -> None:
    """A search of seconds, in an empty folder."""
    monkeypatch.setattr("rans.cli.tune._CANDIDATES", 1)
    monkeypatch.setattr("rans.cli.tune._STARTS", 2)


@pytest.mark.slow
def test_what_is_tuned_flies_from_then_on(monkeypatch, ran):
    monkeypatch.setattr("rans.cli.tune._CANDIDATES", 2)
    said = ran("tune lqr:track-velocity-2d@atmos")
    file = OWN / "lqr-track-velocity-atmos.json"
    assert f"Written to {file}." in said
    assert "weights.velocity" in said
    assert file.exists()
    contest = Contest(load_spacecraft("atmos"), TASKS["track-velocity"](), Timing(), 1, 1)
    assert simple_controller("lqr", contest).tuning.startswith("tuned: 2 settings on 2 starts")


@pytest.mark.slow
def test_a_worse_result_replaces_nothing(monkeypatch, ran):
    """As of a search that was stopped early, or on fewer starts."""
    tune = "tune lqr:track-velocity-2d@atmos"
    monkeypatch.setattr("rans.cli.tune._CANDIDATES", 4)
    ran(tune)
    file = OWN / "lqr-track-velocity-atmos.json"
    good = file.read_text()
    file.write_text(
        good.replace('"tuned": ', '"tuned": -')
    )  # as if far better settings had been found
    kept = file.read_text()
    monkeypatch.setattr("rans.cli.tune._CANDIDATES", 1)
    said = ran(tune)
    assert "Not written: the settings in use, tuned: 4 settings on 2 starts" in said
    assert "were found on more starts" in said
    assert file.read_text() == kept
    monkeypatch.setattr("rans.cli.tune._STARTS", 1)
    ran(tune)
    assert file.read_text() == kept
    monkeypatch.setattr("rans.cli.tune._STARTS", 3)
    ran(tune)
    assert '"starts": 3' in file.read_text()


def test_what_is_damaged_is_told_before_anything_is_flown(monkeypatch, refused):
    monkeypatch.setattr("rans.evaluation.compare.tuning.tuned_settings", None)
    OWN.mkdir(parents=True)
    (OWN / "lqr.json").write_text("{")
    assert "Delete it" in refused("tune lqr")
