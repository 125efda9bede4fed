"""Flights under conditions against Drake: what is flown, and that an error is found in its group."""

from dataclasses import replace

import pytest

import rans.model.dynamics
import rans.randomization.valves
from rans import BodyConditions, Conditions, DisturbanceConditions, ThrusterConditions
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions_file import load_conditions
from tests.support.worlds import EFFECTS
from validation.study.checks import Check
from validation.study.conditions import condition_checks, effect_groups

CRAFT = load_spacecraft("floating-platform")


def test_groups_are_what_is_in_the_conditions():
    """By hand, of a mixture: what only the other conditions have is a group too."""
    body = BodyConditions(mass=(0.8, 1.2))
    late = ThrusterConditions(latency=0.1, thrust=0.9)
    mixed = Conditions(body, weight=2.0, others=(Conditions(thrusters=late),))
    found = effect_groups(mixed)
    assert list(found) == ["body", "thrust and supply", "late and gradual valves", "all together"]
    assert found["body"] == Conditions(body, weight=2.0, others=(Conditions(),))
    assert found["late and gradual valves"].others[0].thrusters == ThrusterConditions(latency=0.1)
    assert found["all together"] is mixed


def test_groups_leave_nothing_out():
    """Everything at once falls into all groups, and perfect conditions into none."""
    groups = effect_groups(EFFECTS["all"])
    assert len(groups) == 11
    assert list(effect_groups(Conditions())) == ["all together"]
    kicks = DisturbanceConditions(kick=(0.0, 1.0))
    assert groups["kicks"].disturbances == kicks


@pytest.mark.slow
def test_an_error_shows_in_its_group_and_in_all_together(monkeypatch):
    true = rans.model.dynamics.wrench_of
    for module in (rans.model.dynamics, rans.randomization.valves):
        monkeypatch.setattr(
            module,
            "wrench_of",
            lambda craft, shares, body: true(
                craft, shares, replace(body, centre=tuple(-x for x in body.centre))
            ),
        )
    checks = [
        c for c in condition_checks(CRAFT, load_conditions("roboran"), 1, 2) if isinstance(c, Check)
    ]
    failed = {check.name for check in checks if not check.passed}
    assert failed == {
        f"{group}: {what}" for group in ("body", "all together") for what in ("motion", "told")
    }
