"""Bounds against SciPy's own intervals, flights against sums by hand, plans against simulated campaigns."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rans_assurance.assure.bounds import CampaignPlan, flights_needed, lower, plan, upper
from scipy.stats import binomtest


@pytest.mark.parametrize(
    ("events", "flights"), [(0, 10), (3, 1000), (10, 10), (17, 10**6), (0, 10**9)]
)
def test_bounds_are_those_of_scipys_exact_interval(events, flights):
    # A two-sided interval at 98 % leaves 1 % outside of either end.
    low, high = binomtest(events, flights).proportion_ci(0.98, "exact")
    assert upper(events, flights, 0.01) == pytest.approx(high, rel=1e-6)  # its root finding
    assert lower(events, flights, 0.01) == pytest.approx(low, rel=1e-6)


def test_a_rare_event_needs_as_many_flights_as_the_logarithm_says():
    # (1 - p)^n = 0.01, n = ln(0.01) / ln(1 - 1e-7): 46,051,699.6 by hand.
    assert flights_needed(1e-7, 0.01) == math.ceil(math.log(0.01) / math.log1p(-1e-7)) == 46_051_700


def _ends(made: CampaignPlan, probability: float, campaigns: int) -> tuple[float, float]:
    """Shares of campaigns that end in "below" and in "above"."""
    random = np.random.default_rng(0)
    ends = {"below": 0, "above": 0, "open": 0}
    for _ in range(campaigns):
        failures = flown = 0
        decision = "open"
        for look in made.looks:
            failures += random.binomial(look.flights - flown, probability)
            flown = look.flights
            if (decision := made.decision(failures, flown)) != "open":
                break
        ends[decision] += 1
    return ends["below"] / campaigns, ends["above"] / campaigns


def test_looking_often_does_not_make_wrong_statements_more_frequent_than_promised():
    # Right at the bound both statements are wrong; each may be made in 5 % of all campaigns. 250 of them
    # scatter by 1.4 %: 3 of these are allowed.
    below, above = _ends(plan(0.95, None, 1e-3), 1e-3, 250)
    assert below <= 0.05 + 0.042
    assert above <= 0.05 + 0.042
    assert below > 0.01  # the chance is spent, not hoarded


def test_campaigns_end_early_on_either_side():
    made = plan(0.99, None, 1e-3)
    assert _ends(made, 1e-4, 100)[0] >= 0.99
    assert _ends(made, 1e-2, 100)[1] == 1.0
    first = next(look for look in made.looks if made.decision(0, look.flights) == "below")
    assert made.decision(1, first.flights) != "below"
    # ln(1 / 0.0045) / ln(1 / 0.01) = 1.173: what looking costs where nothing fails.
    assert first.flights < 1.18 * flights_needed(1e-3, 0.01)


def test_levels_of_all_looks_add_up_to_the_chance_of_error():
    for made in (
        plan(0.99, None, 1e-4),
        plan(0.99, 150_000, 1e-4),
        plan(0.99, 50_000, 1e-4),
        plan(0.9, 7),
    ):
        assert sum(look.high_level for look in made.looks) == pytest.approx(1.0 - made.confidence)
        assert sum(look.low_level for look in made.looks) == pytest.approx(1.0 - made.confidence)
        assert [look.flights for look in made.looks] == sorted(
            {look.flights for look in made.looks}
        )


def test_a_plan_ends_where_numbers_of_flights_do():
    # ln(1 / 0.0045) / 1e-8 = 540 million; four times as many have numbers of 31 bits, eight times have not.
    late = plan(0.99, None, 1e-8).looks[-3:]
    assert [round(look.flights / 1e6) for look in late] == [540, 1081, 2147]
