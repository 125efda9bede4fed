from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans.model.body import Body
from rans.model.dynamics import PlanarState, SpatialState, Wrench
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft_file import load_spacecraft
from validation.study import discretisation
from validation.study.checks import Check, Curve
from validation.study.discretisation import discretisation_checks, order_curves, semi_implicit_euler
from validation.study.invariants import _silence
from validation.study.sampling import random_states


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


@pytest.mark.parametrize(
    "spacecraft", ["floating-platform", pytest.param("pingu", marks=pytest.mark.slow)]
)
def test_the_default_step_must_gain_a_decade(
    spacecraft: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the error of 50 Hz Euler, whether or not the craft has a wheel, which would be full after seconds."""
    craft = load_spacecraft(spacecraft)
    monkeypatch.setattr(discretisation, "_CONTROL_RATES", (5,))
    monkeypatch.setattr(discretisation, "_EULER_RATES", (50,))
    monkeypatch.setattr(discretisation, "_OUR_NODES", (6,))
    (good,) = (c for c in discretisation_checks(craft, 1, 1) if isinstance(c, Check))
    assert good.passed
    assert good.tolerance == 0.1
    assert 0.0 < good.value < 1e-6  # exact beside a first-order step


def test_the_gain_is_a_ratio_of_medians(monkeypatch: pytest.MonkeyPatch) -> None:
    """Medians of 0.1 and 2 m: 0.05. The median of the three ratios is 0.1, that of the means 0.4."""
    errors = {"euler": np.array([1.0, 2.0, 10.0]), "ours": np.array([0.1, 0.02, 5.0])}

    def flown(
        _craft: Any, _start: Any, _inputs: Any, _period: Any, method: Any, _steps: Any
    ) -> str:
        return "euler" if method is semi_implicit_euler else "ours"

    monkeypatch.setattr(discretisation, "_flown", flown)
    monkeypatch.setattr(
        discretisation, "gaps", lambda who, _: dict.fromkeys(("position", "attitude"), errors[who])
    )
    checks = [
        c
        for c in discretisation_checks(load_spacecraft("floating-platform"), 1, 1)
        if isinstance(c, Check)
    ]
    assert [(check.value, check.unit) for check in checks] == [(pytest.approx(0.05), "ratio")] * 2
    assert "over the median" in checks[0].reason


@pytest.mark.parametrize(
    ("craft", "rates"),
    [
        ("floating-platform", [5.0 * nodes for nodes in (1, 2, 3, 4, 5, 6)]),
        ("free-flyer", [5.0 * 3 * steps for steps in (1, 2, 3, 4, 8, 16)]),
    ],
)
def test_force_evaluations_per_second(
    craft: str, rates: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 5 Hz: a node each in the plane, steps of three nodes in space; one of Euler's steps is one.

    The default is judged: all six nodes, or one step; here errors fall as one over the evaluations.
    """

    def rate(
        _state: Any, _applied: Any, _body: Any, period: float, steps: int, nodes: int = 3
    ) -> float:
        return nodes * steps / period

    monkeypatch.setattr(discretisation, "_CONTROL_RATES", (5,))
    monkeypatch.setattr(discretisation, "advance", rate)
    monkeypatch.setattr(discretisation, "semi_implicit_euler", lambda *given: rate(*given, nodes=1))
    monkeypatch.setattr(
        discretisation,
        "_flown",
        lambda _craft, start, inputs, period, method, steps: method(
            start, inputs, None, period, steps
        ),
    )
    monkeypatch.setattr(
        discretisation,
        "gaps",
        lambda rate, _: dict.fromkeys(("position", "attitude"), np.array([1.0 / rate])),
    )
    monkeypatch.setattr(discretisation, "drake_states", lambda *_: np.zeros(1))
    found = discretisation_checks(load_spacecraft(craft), 1, 1)
    curves = {(curve.figure, curve.name): curve for curve in found if isinstance(curve, Curve)}
    for quantity in ("position", "attitude"):
        figure = f"{quantity} error after 25 s"
        euler = curves[figure, "semi-implicit Euler, control at 5 Hz"]
        ours = curves[figure, "ours, control at 5 Hz"]
        assert list(euler.x) == [50, 100, 200, 400, 800]
        assert list(ours.x) == rates
        for curve in (euler, ours):
            assert curve.y == pytest.approx([1.0 / x for x in curve.x])
    [check] = (check for check in found if isinstance(check, Check))
    default = rates[-1] if craft == "floating-platform" else rates[0]
    assert check.value == pytest.approx(50 / default)


def test_orders_of_convergence() -> None:
    """Halving the step halves the error of Euler's scheme; ours falls 64 times, until it meets rounding."""
    curves = {curve.name: curve for curve in order_curves(load_spacecraft("free-flyer"), 1, 16)}
    euler = curves["semi-implicit Euler"]
    ours = curves["ours"]
    assert euler.x == ours.x == pytest.approx([0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625])
    slopes = np.diff(np.log(euler.y)) / np.diff(np.log(euler.x))
    # The error's next term is of the step's size, 10 % at 0.2 s for turns of 0.2 rad a period.
    assert slopes == pytest.approx(1.0, abs=0.1)
    assert np.log2(ours.y[0] / ours.y[1]) > 5.0


def test_the_originals_scheme_spins_up_by_eulers_equations() -> None:
    """Moments of 1, 2 and 3 kg m^2 at (1, 1, 1) rad/s: w x I w is (1, -2, 1), so w' = (-1, 1, -1/3)."""
    body = Body(1.0, (1.0, 0.0, 0.0, 2.0, 0.0, 3.0))
    ones = Vec3(*np.ones((3, 1)))
    nothing = Vec3(*np.zeros((3, 1)))
    start = SpatialState(nothing, Quat(*np.array([[1.0], [0.0], [0.0], [0.0]])), nothing, ones)
    end = semi_implicit_euler(
        start, Wrench(nothing, Vec3(*np.array([[0.0], [0.0], [1.0]]))), body, 0.3, 1
    )
    # With a torque of 1 N m about z: a third of a radian per second squared more.
    assert np.array(end.w.columns()).ravel() == pytest.approx([0.7, 1.3, 1.0])
