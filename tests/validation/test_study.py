"""The bounds of every check, as they were agreed: who loosens one changes this table too."""

from __future__ import annotations

import pytest

from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from validation import flights
from validation.checks import Check
from validation.dynamics import acceleration_checks, mass_checks, period_checks, thruster_checks
from validation.sampling import reach
from validation.study import LAYERS, Scope

PLATFORM, FLYER = load_spacecraft("floating-platform"), load_spacecraft("free-flyer")
QUANTITIES = {"position": "m", "attitude": "rad", "velocity": "m/s", "spin": "rad/s"}

PLANE = {
    "every thruster: force": (1e-12, "N"), "every thruster: torque": (1e-12, "N m"),
    "random commands: force": (1e-12, "N"), "random commands: torque": (1e-12, "N m"),
    "mass matrix": (1e-12, "relative"),
    "accelerations: linear": (1e-12, "relative"), "accelerations: angular": (1e-12, "relative"),
    "coasting: velocity": (1e-12, "m/s"), "coasting: angular momentum": (1e-12, "relative"),
    "coasting: energy": (1e-12, "relative"), "work less energy gained": (1e-10, "relative"),
    "superposition of forces": (1e-13, "m/s"), "one substep against eight": (1e-10, "SI"),
    **{f"{layer}: {name}": (bound, unit) for layer, bound in (
        ("one control period", 1e-9), ("disturbed period", 1e-9), ("world turned", 1e-12),
        ("Fresnel integrals", 1e-9), ("DOP853", 1e-9), ("25 s", 1e-9), ("bang-bang", 1e-9),
        ("engine, NumPy float64", 1e-11), ("engine, torch float64", 1e-11), ("engine, float32", 1e-3))
        for name, unit in QUANTITIES.items()},
    "Drake's own error: position": (1e-10, "m"), "Drake's own error: attitude": (1e-10, "rad"),
}
SPACE = {
    "coasting: velocity": (1e-12, "m/s"), "coasting: angular momentum": (1e-9, "relative"),
    "coasting: energy": (1e-9, "relative"), "work less energy gained": (1e-8, "relative"),
    "superposition of forces": (1e-13, "m/s"), "order of integration short of 6": (0.3, "-"),
    **{f"world turned: {name}": (1e-12, unit) for name, unit in QUANTITIES.items()},
}


def bounds(checks: object) -> dict[str, tuple[float, str]]:
    return {c.name: (c.tolerance, c.unit) for c in checks if isinstance(c, Check)}  # type: ignore[attr-defined]


def test_bounds_in_the_plane() -> None:
    """Flights near the goal stay within 10 m, where nothing is loosened for their length."""
    scope = Scope(PLATFORM, seed=1, states=4, flights=1)
    found = bounds(check for look in LAYERS.values() for check in look(scope))
    assert found == {name: (pytest.approx(bound), unit) for name, (bound, unit) in PLANE.items()}


def test_bounds_in_space() -> None:
    scope = Scope(FLYER, seed=1, states=4, flights=1)
    found = bounds(LAYERS["invariants"](scope))
    assert found == {name: (pytest.approx(bound), unit) for name, (bound, unit) in SPACE.items()}
    for look in (thruster_checks, mass_checks):
        assert {bound for bound, _ in bounds(look(FLYER)).values()} == {1e-12}
    assert {bound for bound, _ in bounds(acceleration_checks(FLYER, 1, 4)).values()} == {1e-12}
    assert {bound for bound, _ in bounds(period_checks(FLYER, 1, 4)).values()} == {1e-9}


def test_long_ways_loosen_in_proportion() -> None:
    """10 m and less count as they are, 25 m two and a half times."""
    for way, factor in ((3.0, 1.0), (10.0, 1.0), (25.0, 2.5)):
        states = PlanarState(Vec2(way, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
        assert reach(states) == factor
        assert flights._agreement(states) == pytest.approx(1e-9 * factor)
