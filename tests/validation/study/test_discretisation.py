import numpy as np
import pytest

from rans.model.body import Body
from rans.model.dynamics import Wrench
from rans.model.fields import Vec2
from rans.model.spacecraft_file import load_spacecraft
from tests.support.states import planar
from validation.study import discretisation
from validation.study.checks import Check, Curve
from validation.study.discretisation import discretisation_checks, order_curves, semi_implicit_euler
from validation.study.invariants import _silence
from validation.study.sampling import random_states


def test_the_originals_scheme_by_hand():
    """One step of 0.5 s, 2 kg pushed by 4 N: velocity first (1 m/s), then position with it (0.5 m)."""
    start = planar()
    end = semi_implicit_euler(start, Wrench(Vec2(4.0, 0.0), 0.25), Body(2.0, (0.5,)), 0.5, 1)
    assert (end.p.x, end.v.x, end.w, end.attitude.angle) == (0.5, 1.0, 0.25, 0.125)
    coasting = random_states(3, 4, 0)
    sphere = Body(1.0, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0))
    turned = semi_implicit_euler(coasting, _silence(coasting), sphere, 2.0, 3)
    # Without torque a sphere turns by |w| t, up to rounding.
    angle = coasting.attitude.to(turned.attitude).magnitude()
    assert angle == pytest.approx(2.0 * coasting.w.norm(), abs=1e-13)


@pytest.mark.parametrize(
    ("spacecraft", "evaluations"),
    [
        ("floating-platform", 30.0),
        pytest.param("pingu", 30.0, marks=pytest.mark.slow),
        pytest.param("free-flyer", 15.0, marks=pytest.mark.slow),
    ],
)
def test_the_default_step_must_gain_a_decade(spacecraft, evaluations, monkeypatch):
    """Error is a tenth of that of 50 Hz Euler, whether or not the craft has a wheel, which fills within seconds.

    At 5 Hz six nodes in the plane, or a step of three nodes in space, are 30 and 15 forces a second.
    """
    craft = load_spacecraft(spacecraft)
    monkeypatch.setattr(discretisation, "_CONTROL_RATES", (5,))
    monkeypatch.setattr(discretisation, "_EULER_RATES", (50,))
    monkeypatch.setattr(discretisation, "_OUR_NODES", (6,))
    monkeypatch.setattr(discretisation, "_OUR_STEPS", (1,))
    found = discretisation_checks(craft, 1, 1)
    (good,) = (c for c in found if isinstance(c, Check))
    assert good.passed
    assert good.tolerance == 0.1
    # In the plane exact beside a first-order step.
    assert 0.0 < good.value < (1e-6 if craft.dimension == 2 else 1e-2)
    euler, _, ours, _ = (c for c in found if isinstance(c, Curve))
    assert (euler.x, ours.x) == ((50.0,), (evaluations,))
    assert ours.y[0] == pytest.approx(good.value * euler.y[0])


def test_orders_of_convergence():
    """Halving the step halves the error of Euler's scheme; ours falls 64 times, until it meets rounding."""
    curves = {curve.name: curve for curve in order_curves(load_spacecraft("free-flyer"), 1, 16)}
    euler = curves["semi-implicit Euler"]
    ours = curves["ours"]
    assert euler.x == ours.x == pytest.approx([0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625])
    slopes = np.diff(np.log(euler.y)) / np.diff(np.log(euler.x))
    # The error's next term is of the step's size, 10 % at 0.2 s for turns of 0.2 rad a period.
    assert slopes == pytest.approx(1.0, abs=0.1)
    assert np.log2(ours.y[0] / ours.y[1]) > 5.0
