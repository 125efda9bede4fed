from dataclasses import replace

import pytest

import rans.control.lqr
from rans import ConfigError
from rans.model.spacecraft_file import load_spacecraft
from validation.study import closed_loop
from validation.study.checks import Check, Skipped
from validation.study.closed_loop import closed_loop_checks

PLATFORM = load_spacecraft("floating-platform")


def test_the_closed_loop_is_the_same_in_both_engines():
    """Four flights of an LQR; of four all of which are solved, Wilson leaves 51 % and more."""
    checks = [c for c in closed_loop_checks(PLATFORM, 1, 4) if isinstance(c, Check)]
    assert all(check.passed for check in checks)
    assert {check.name: (check.tolerance, check.unit) for check in checks} == {
        "closed loop, LQR: solved": (pytest.approx(49.0, abs=0.05), "%"),
        "closed loop, LQR: position error": (pytest.approx(0.1), "cm"),
        "closed loop, LQR: attitude error": (pytest.approx(0.1), "deg"),
    }


def test_a_judge_of_another_mass_breaks_the_closed_loop(monkeypatch):
    """Drake flies a craft of twice the mass with the same controller."""
    true = closed_loop.fly_in_drake
    monkeypatch.setattr(
        closed_loop,
        "fly_in_drake",
        lambda craft, *rest: true(replace(craft, mass=2.0 * craft.mass), *rest),
    )
    assert not all(
        check.passed for check in closed_loop_checks(PLATFORM, 1, 2) if isinstance(check, Check)
    )


def test_a_craft_that_no_regulator_steers_is_skipped(monkeypatch):
    def refuse(*_):
        raise ConfigError("LQR: it cannot be steered.")

    monkeypatch.setattr(rans.control.lqr, "LQR", refuse)
    assert closed_loop_checks(PLATFORM, 1, 1) == [
        Skipped("closed loop", "LQR: it cannot be steered.")
    ]
