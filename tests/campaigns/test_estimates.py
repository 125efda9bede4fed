"""Errors of readings and of filters, which docs/decisions/robustness.md compares."""

from __future__ import annotations

from dataclasses import replace

import pytest

from campaigns import estimates
from campaigns.estimates import Estimates


@pytest.mark.slow
def test_filters_know_more_than_readings() -> None:
    """Noise of 0 to 0.03 m/s, drawn evenly: 0.03 / sqrt(3) in the mean. Of 64 flights a tenth is chance."""
    asked = Estimates("floating-platform", 64)
    noise = asked.errors("noise")
    lab = asked.errors("lab")
    assert noise["reading"][0] == pytest.approx(0.03 / 3**0.5, rel=0.15)
    assert 5.0 * noise["drift 0.001"][0] < noise["reading"][0]
    # A filter that believes in the designed craft is led astray, one that looks for what pushes is not.
    assert lab["drift 0.001"][2] > 5.0 * lab["reading"][2]
    for part in (0, 2, 3):
        assert lab["drift 0.1, steady too"][part] < lab["reading"][part]
    # Where nozzles open oftener, how they answer is worth knowing, of spin most: a pulse gives much of it,
    # and a fourth more or less of that, by inertia and thrust each, is most of the error without.
    often = replace(asked, open=0.03).errors("lab")
    assert often["drift 0.1, responses too"][1] < 0.6 * often["drift 0.1, steady too"][1]


def test_it_prints_a_table_for_each_world(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(estimates, "_STEPS", 2)
    monkeypatch.setattr(estimates, "_SETTLED", 0)
    assert Estimates("free-flyer", 4).run() == 0
    printed = capsys.readouterr().out
    for world in ("noise", "lab"):
        assert f"free-flyer in {world}" in printed
