"""Flights of the free flyer's proved network with throttled thrusters, in an engine."""

from __future__ import annotations

import importlib

import pytest

from tests.support.processes import ROOT

FOLDER = ROOT / "examples/proofs"


@pytest.mark.slow
def test_no_flight_breaks_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also a law of the other sign, which leaves the limits: the count can be above 0."""
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    monkeypatch.syspath_prepend(str(FOLDER))
    flights = importlib.import_module("free_flyer_flights")
    network = FOLDER / "free-flyer-agent.onnx"
    count, far, turned = flights.broken(network, "fast", 50, 0)
    assert count == 0
    assert 0.05 < far < 0.15
    assert 0.04 < turned < 0.139
    monkeypatch.setattr(flights, "STRONGEST", -0.1 * flights.STRONGEST)
    assert flights.broken(network, "fast", 50, 0)[0] == 50
