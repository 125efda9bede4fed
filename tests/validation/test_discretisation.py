from __future__ import annotations

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
