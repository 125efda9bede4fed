"""Campaigns of invented flights whose failures are known, and of a real agent's beside its evaluation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from rans_assurance.assure.bounds import plan
from rans_assurance.assure.campaign import Campaign

from rans.episode.flight_statistics import FlightStatistics
from rans.episode.verdict import Failure


class Fleet:
    """Every hundredth flight fails; every thousandth is lost."""

    device = type("Device", (), {"type": "cpu"})()

    def __init__(self, *_: object, **__: object) -> None:
        self.calls: list[tuple[int, int]] = []

    def parts(self, first: int, count: int, seed: int) -> Iterator[FlightStatistics]:
        for begin in range(first, first + count, 20_000):
            yield self.part(begin, min(20_000, first + count - begin))

    def part(self, first: int, count: int) -> FlightStatistics:
        numbers = np.array([n for n in range(first, first + count) if n % 100 == 7], dtype=np.int64)
        kinds = np.where(numbers % 1000 == 7, Failure.TERMINATED, Failure.LEFT).astype(np.uint8)
        counts = {kind: int((kinds == kind).sum()) for kind in Failure}
        return replace(
            FlightStatistics.none(125),
            flights=count,
            failures=counts,
            numbers=numbers,
            kinds=kinds,
            ways=frozenset({"by hand"}),
        )


@pytest.fixture
def fleet(monkeypatch) -> None:
    monkeypatch.setattr("rans_assurance.assure.campaign.Flights", Fleet)


def _flown(campaign: Campaign) -> Campaign:
    setup: object = None
    campaign.fly(setup, setup, "cpu")  # type: ignore[arg-type]  # the fleet needs neither
    return campaign


@pytest.mark.usefixtures("fleet")
def test_every_flight_is_counted_once_and_failures_are_listed_by_number():
    campaign = _flown(Campaign(plan(0.99, 50_000), 3))
    assert campaign.flights == 50_000
    assert campaign.events == dict.fromkeys(Failure, 0) | {
        Failure.LEFT: 450,
        Failure.TERMINATED: 50,
    }
    assert campaign.numbers(Failure.TERMINATED)[:2] == [7, 1007]
    bound = campaign.bound(Failure.TERMINATED)
    assert bound.low < bound.rate == 1e-3 < bound.high


@pytest.mark.usefixtures("fleet")
def test_a_wanted_bound_far_from_the_truth_is_decided_early():
    refuted = _flown(Campaign(plan(0.99, None, 1e-3), 0))
    assert refuted.decision == "above"
    assert refuted.flights == refuted.plan.looks[0].flights
    shown = _flown(Campaign(plan(0.99, None, 0.1), 0))
    assert shown.decision == "below"
    assert shown.flights < shown.plan.flights


@pytest.mark.parametrize("failures", [0, 900])
def test_an_interrupt_decides_nothing(failures):
    """Counts that would decide at a look: looks at any time would be wrong more often than is said."""
    campaign = Campaign(plan(0.99, None, 0.1), 0)
    at_look = campaign.plan.looks[0].flights
    for flights, decision in ((at_look - 1, "open"), (1, "above" if failures else "below")):
        more = Fleet().part(0, 0)
        counts = {**more.failures, Failure.LEFT: min(failures, flights)}
        campaign.add(replace(more, flights=flights, failures=counts))
        assert campaign.decision == decision


@pytest.mark.usefixtures("fleet")
def test_bars_reach_their_ends_where_a_campaign_is_decided_early():
    bars = {}

    def stages(name, total, /):
        bars[name] = [0, total]

        def advance(count, /):
            bars[name][0] += count

        return advance

    campaign = Campaign(plan(0.99, None, 2e-2), 0)
    setup = None
    campaign.fly(setup, setup, "cpu", stages)  # type: ignore[arg-type]  # the fleet needs neither
    assert campaign.flights < campaign.plan.flights
    assert len(bars) > 1
    assert all(done == total for done, total in bars.values())
    assert [total for _, total in bars.values()][-1] == campaign.flights
