"""The oracles themselves, on cases that can be worked out on paper."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, Vec3
from rans.model.spacecraft_file import load_spacecraft
from validation.study import oracles
from validation.study.oracles import spinning_up, tumbling
from validation.study.sampling import gap, random_states


def test_fresnel_without_push_is_a_straight_line() -> None:
    start = random_states(2, 5, 1)
    end = spinning_up(start, np.zeros(5, dtype=complex), np.full(5, -0.7), 3.0)
    assert np.allclose(end.p.x, start.p.x + 3.0 * start.v.x, atol=1e-14)
    assert np.allclose(
        end.attitude.angle, start.attitude.angle + 3.0 * start.w - 0.35 * 9.0, atol=1e-14
    )


def test_fresnel_with_hardly_any_spin_up_is_a_parabola() -> None:
    """From rest at heading 90 degrees, 0.2 m/s^2 forward for 2 s: 0.4 m along y, 0.4 m/s."""
    start = PlanarState(
        Vec2(np.zeros(1), np.zeros(1)),
        Heading(np.array([math.pi / 2])),
        Vec2(np.zeros(1), np.zeros(1)),
        np.zeros(1),
    )
    end = spinning_up(start, np.array([0.2 + 0.0j]), np.array([1e-4]), 2.0)
    # The heading changes by 2e-4 rad, which is 1e-4 of the way; half of it bends the path.
    assert end.p.y[0] == pytest.approx(0.4, abs=1e-7)
    assert end.p.x[0] == pytest.approx(0.0, abs=1e-4)
    assert end.v.y[0] == pytest.approx(0.4, abs=1e-7)


@pytest.mark.parametrize(("least", "largest"), [(0.9, 0.3), (0.2, 0.9)], ids=["inner", "outer"])
def test_the_top_keeps_energy_and_momentum_and_starts_where_it_should(least, largest) -> None:
    moments = np.array([0.2, 0.3, 0.5])
    time = np.linspace(0.0, 20.0, 50)
    track = tumbling(moments, np.full(50, least), np.full(50, largest), time)  # type: ignore[arg-type]
    assert track[:, 0] == pytest.approx([least, 0.0, largest], abs=1e-15)
    for weights in (moments, moments**2):  # twice the energy, the momentum's square
        kept = weights @ track**2
        assert kept == pytest.approx(kept[0], rel=1e-13)
    # I2 w2' = (I3 - I1) w3 w1, by the difference of two close moments.
    early = tumbling(moments, np.array([least]), np.array([largest]), 1e-6)
    assert early[1, 0] / 1e-6 == pytest.approx((0.5 - 0.2) / 0.3 * least * largest, rel=1e-6)


def test_the_numerical_oracle_agrees_with_the_closed_form() -> None:
    """Five periods of a constant wrench: 1e-13 a step of some ten steps a period, of some metres."""
    start = random_states(2, 5, 4)
    push: Any = np.array([0.3 + 0.1j, -1.0j, 0.5, 0.2 - 0.7j])
    spin_up = np.array([0.2, -1.5, 0.7, -0.4])
    craft = load_spacecraft("floating-platform")
    force = craft.mass * np.stack([push.real, push.imag, 0.0 * push.real], axis=1)
    torque = craft.inertia[2][2] * np.stack([0.0 * spin_up, 0.0 * spin_up, spin_up], axis=1)
    found = start
    for _ in range(5):
        found = oracles._solve_planar(craft, found, force, torque, 0.2)
    assert max(gap(found, spinning_up(start, push, spin_up, 1.0)).values()) < 1e-11


def test_the_numerical_oracle_in_space_agrees_with_the_top() -> None:
    """Without thrust: the spin of the closed form, and of all else what does not change."""
    moments = np.array([0.2, 0.3, 0.45])
    craft = replace(load_spacecraft("free-flyer"), inertia=tuple(map(tuple, np.diag(moments))))
    states = random_states(3, 5, 4)
    least = np.array([0.9, 0.2, 0.5, 0.7])
    largest = np.array([0.3, 0.9, 0.5, 0.1])
    start = replace(states, w=Vec3(least, 0.0 * least, largest))
    found = oracles._solve_spatial(craft, start, np.zeros((4, 3)), np.zeros((4, 3)), 2.0)
    expected = tumbling(moments, least, largest, 2.0)
    assert np.array(found.w.columns()) == pytest.approx(expected, abs=1e-11)
    for way, speed, place in zip(
        found.p.columns(), start.v.columns(), start.p.columns(), strict=True
    ):
        assert way == pytest.approx(place + 2.0 * speed, abs=1e-12)
    before, after = (
        state.attitude.rotate(Vec3(*(moments[:, None] * state.w.columns()))).columns()
        for state in (start, found)
    )
    assert np.array(after) == pytest.approx(np.array(before), abs=1e-11)


@pytest.mark.slow
def test_the_worst_top_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of five spins a microradian per second off: the largest counts, whatever the others do."""
    true = oracles.tumbling

    def off(*arguments: Any) -> np.ndarray:
        spin = true(*arguments)
        spin[1, 3] += 1e-6
        return spin

    monkeypatch.setattr(oracles, "tumbling", off)
    [check] = oracles._top_checks(load_spacecraft("free-flyer"), 1, 5)
    assert (check.worst, check.passed) == ("state 3", False)
    assert check.value == pytest.approx(1e-6, rel=1e-3)
