"""The table of troubles, against the flights that evaluations are made of."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.batch import Found, flown, loaded
from campaigns.robustness import rows
from rans.randomization.conditions import largest

AGENT = "pretrained:go-to-pose-2d"


def test_troubles_count() -> None:
    """A nominal agent does not hold its goal with valves 0.2 s late (audit: 0 %)."""
    network, setup = loaded(AGENT, "cpu")
    found = flown(network, setup, rows()["latency, worst"], 16, 7, "cpu")
    assert found.held.mean() < 0.2
    assert np.isinf(found.settled[~found.held]).mean() > 0.5


def test_rows_are_what_they_are_called() -> None:
    found = rows()
    assert found["none"].or_none is None
    assert largest(found["latency"].thrusters.latency) == 0.2
    assert found["latency, worst"].thrusters.latency == 0.2
    assert found["noise, worst"].sensors.attitude.noise == pytest.approx(np.radians(3.0))
    assert largest(found["noise, worst"].faults.count) == 0


def test_what_is_said_by_hand() -> None:
    none = np.zeros(4)
    held, settled = np.array([True, True, False, True]), np.array([1.0, 2.0, np.inf, 4.0])
    said = Found(held, settled, none, none, none, none).said()
    assert said["held"]["value"] == 75.0
    assert said["settling time"] == 3.0
