"""``rans tune``."""

from __future__ import annotations

import pytest

from rans.evaluation.fly.tuned import OWN


@pytest.fixture(autouse=True)
def _few(monkeypatch, here) -> None:
    """A search of seconds, in an empty folder."""
    monkeypatch.setattr("rans.cli.tune._CANDIDATES", 1)
    monkeypatch.setattr("rans.cli.tune._STARTS", 2)


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
