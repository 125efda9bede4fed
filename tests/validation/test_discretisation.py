from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans.model.body import Body
from rans.model.dynamics import PlanarState, Wrench
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from validation import discretisation
from validation.checks import Check
from validation.discretisation import discretisation_checks, semi_implicit_euler
from validation.invariants import _silence
from validation.sampling import random_states


def test_the_originals_scheme_by_hand() -> None:
    """One step of 0.5 s, 2 kg pushed by 4 N: velocity first (1 m/s), then position with it (0.5 m)."""
    start = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    end = semi_implicit_euler(start, Wrench(Vec2(4.0, 0.0), 0.25), Body(2.0, (0.5,)), 0.5, 1)
    assert (end.p.x, end.v.x, end.w, end.attitude.angle) == (0.5, 1.0, 0.25, 0.125)
    coasting = random_states(3, 4, 0)
    sphere = Body(1.0, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0))
    turned = semi_implicit_euler(coasting, _silence(coasting), sphere, 2.0, 3)
    # Without torque a sphere turns by |w| t, up to rounding.
    angle = coasting.attitude.to(turned.attitude).magnitude()
    assert angle == pytest.approx(2.0 * coasting.w.norm(), abs=1e-13)


def test_the_default_step_must_gain_a_decade(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the error of 50 Hz Euler; a method as bad as Euler fails."""
    craft = load_spacecraft("floating-platform")
    monkeypatch.setattr(discretisation, "_CONTROL_RATES", (5,))
    monkeypatch.setattr(discretisation, "_EULER_RATES", (50,))
    monkeypatch.setattr(discretisation, "_OUR_NODES", (6,))
    good, = (c for c in discretisation_checks(craft, 1, 1) if isinstance(c, Check))
    assert good.passed
    assert good.tolerance == 0.1
    assert 0.0 < good.value < 1e-6  # exact beside a first-order step


def test_the_gain_is_a_ratio_of_medians(monkeypatch: pytest.MonkeyPatch) -> None:
    """Medians of 0.1 and 2 m: 0.05. The median of the three ratios is 0.1, that of the means 0.4."""
    errors = {"euler": np.array([1.0, 2.0, 10.0]), "ours": np.array([0.1, 0.02, 5.0])}

    def flown(_craft: Any, _start: Any, _inputs: Any, _period: Any, method: Any, _steps: Any) -> str:
        return "euler" if method is semi_implicit_euler else "ours"

    monkeypatch.setattr(discretisation, "_flown", flown)
    monkeypatch.setattr(discretisation, "gaps", lambda who, _: dict.fromkeys(("position", "attitude"),
                                                                           errors[who]))
    checks = [c for c in discretisation_checks(load_spacecraft("floating-platform"), 1, 1)
              if isinstance(c, Check)]
    assert [(check.value, check.unit) for check in checks] == [(pytest.approx(0.05), "ratio")] * 2
    assert "over the median" in checks[0].reason
