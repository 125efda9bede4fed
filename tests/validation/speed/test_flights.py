"""What is measured of many flights."""

from __future__ import annotations

import pytest

from tests.support.engines import PLATFORM
from validation.speed.flights import flight_rates
from validation.speed.measurement import Clock


def test_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("validation.speed.flights._UNITS", {2: (16,)})
    (measured,) = flight_rates(PLATFORM, 8, Clock("cpu", repeats=1, seconds=0.001))
    assert measured.name == "floating-platform, 16x16, CPU, float32"
    assert (measured.kind, measured.unit) == ("flights", "M steps/s")
    assert measured.value
