"""The study passes on what is right and names the layer of a planted error."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rans.dynamics
import validation.dynamics
from rans.fields import Vec3
from rans.reference.plant import Plant
from rans.spacecraft import Spacecraft
from tests.crafts import nasty_planar, nasty_spatial
from validation.checks import Check
from validation.dynamics import (
    VALIDATION_SUBSTEPS,
    acceleration_checks,
    flight_checks,
    period_checks,
    thruster_checks,
    wrench_checks,
)
from validation.invariants import invariant_checks


def layers(craft: Spacecraft) -> list[Check]:
    """All but the long flights."""
    substeps = VALIDATION_SUBSTEPS[craft.dimension]
    return [*thruster_checks(craft), *wrench_checks(craft, 1, 8), *acceleration_checks(craft, 1, 8),
            *period_checks(craft, 1, 8), *invariant_checks(craft, 1, 8, substeps)]


def failed(checks: list[Check]) -> set[str]:
    return {check.name for check in checks if not check.passed}


def drake_flies(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Give Drake a spacecraft that differs from ours."""
    def plant(craft: Spacecraft, *arguments: Any) -> Plant:
        return Plant(replace(craft, **changes), *arguments)

    monkeypatch.setattr(validation.dynamics, "Plant", plant)


@pytest.mark.parametrize("craft", [nasty_planar(), nasty_spatial()], ids=["plane", "space"])
def test_nothing_planted_nothing_found(craft: Spacecraft) -> None:
    assert failed(layers(craft)) == set()


def test_a_reversed_thruster_is_found_at_the_thruster(monkeypatch) -> None:
    craft = nasty_spatial()
    first, *others = craft.thrusters
    x, y, z = first.direction
    drake_flies(monkeypatch, thrusters=(replace(first, direction=(-x, -y, -z)), *others))
    assert {"every thruster: force", "every thruster: torque"} <= failed(layers(craft))


def test_a_thruster_turned_by_a_microradian_is_found(monkeypatch) -> None:
    craft = nasty_spatial()
    first, *others = craft.thrusters
    nudged = np.array(first.direction) + 1e-6 * np.cross(first.direction, [0.0, 0.0, 1.0])
    direction = tuple(float(x) for x in nudged / np.linalg.norm(nudged))
    drake_flies(monkeypatch, thrusters=(replace(first, direction=direction), *others))
    assert "every thruster: force" in failed(layers(craft))


def test_a_shifted_centre_of_mass_is_found_in_the_torques_alone(monkeypatch) -> None:
    craft = nasty_spatial()
    x, y, z = craft.centre_of_mass
    drake_flies(monkeypatch, centre_of_mass=(x + 1e-6, y, z))
    assert failed([*thruster_checks(craft), *wrench_checks(craft, 1, 8)]) == {
        "every thruster: torque", "random commands: torque"}


def test_a_wrong_mass_is_found_in_the_accelerations(monkeypatch) -> None:
    craft = nasty_planar()
    drake_flies(monkeypatch, mass=craft.mass * (1 + 1e-9))
    found = failed(layers(craft))
    assert "accelerations: linear" in found
    assert not {name for name in found if "thruster" in name or "commands" in name}


def test_a_product_of_inertia_of_the_wrong_sign_is_found_in_the_accelerations(monkeypatch) -> None:
    craft = nasty_spatial()
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = craft.inertia
    drake_flies(monkeypatch, inertia=((xx, xy, -xz), (xy, yy, yz), (-xz, yz, zz)))
    assert failed([*wrench_checks(craft, 1, 8), *acceleration_checks(craft, 1, 8)]) == {
        "accelerations: angular"}


def test_unshared_supply_is_found_in_random_commands(monkeypatch) -> None:
    """One thruster at a time shares with nobody: only their sum can show it."""
    drake_flies(monkeypatch, thrust_sharing="split")
    assert failed([*thruster_checks(nasty_planar()), *wrench_checks(nasty_planar(), 1, 8)]) == {
        "random commands: force", "random commands: torque"}


def test_a_lost_gyroscopic_term_is_found_in_the_accelerations(monkeypatch) -> None:
    complete = rans.dynamics._rate

    def without_gyroscopic_term(state, applied, body):  # type: ignore[no-untyped-def]
        still = replace(state, w=Vec3(0.0, 0.0, 0.0))
        return replace(complete(state, applied, body), w=complete(still, applied, body).w)

    monkeypatch.setattr(rans.dynamics, "_rate", without_gyroscopic_term)
    found = failed(layers(nasty_spatial()))
    assert {"accelerations: angular", "one control period: spin", "coasting: angular momentum"} <= found
    assert not {"accelerations: linear", "every thruster: torque", "random commands: torque"} & found


def test_a_first_order_step_is_found_in_the_control_period(monkeypatch) -> None:
    def euler(state, applied, body, h):  # type: ignore[no-untyped-def]
        return rans.dynamics._moved(state, rans.dynamics._rate(state, applied, body), h)

    monkeypatch.setattr(rans.dynamics, "_advance_spatial", euler)
    found = failed(layers(nasty_spatial()))
    assert {"one control period: position", "order of integration less 4"} <= found
    assert not {name for name in found if "accelerations" in name}


def test_a_coarse_quadrature_is_found_in_the_plane(monkeypatch) -> None:
    """Two Gauss nodes instead of five."""
    nodes, weights = np.polynomial.legendre.leggauss(2)
    monkeypatch.setattr(rans.dynamics, "_NODES", tuple((nodes + 1) / 2))
    monkeypatch.setattr(rans.dynamics, "_WEIGHTS", tuple(weights / 2))
    found = failed(layers(nasty_planar()))
    assert {"one control period: velocity", "one substep against eight"} <= found
    assert not {name for name in found if "accelerations" in name}


def test_long_flights_notice_what_one_period_may_not(monkeypatch) -> None:
    """A mass off by 1e-7 moves one period by 1e-9 m and 25 s by much more than 1e-9 m."""
    craft = nasty_planar()
    assert failed(flight_checks(craft, 1, 4)) == set()
    drake_flies(monkeypatch, mass=craft.mass * (1 + 1e-7))
    assert {"25 s: position", "25 s: velocity"} == failed(flight_checks(craft, 1, 4))
