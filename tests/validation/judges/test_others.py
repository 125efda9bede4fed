"""Judges beside JEOD's orbits: five simulators of a brick, and positions along an arc."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rans.model.fields import Vec3
from validation.judges import brick, lvlh
from validation.judges.arc import along_arc, from_arc


@pytest.mark.parametrize("judge", [brick, lvlh])
def test_a_judge_agrees(judge):
    (row,) = judge.rows()
    assert row.passed, row.differences()


def test_a_brick_is_nearer_to_one_simulator_than_they_are_to_one_another():
    """Four of five deviate from the first by 1e-5 to 3e-3 degrees/s."""
    ours = brick.flown()
    assert max(np.abs(ours[time] - spin).max() for time, spin in brick.FIGURES["01"].items()) < 1e-9


numbers = st.floats(-5e4, 5e4)
speeds = st.floats(-50.0, 50.0)


@given(numbers, numbers, numbers, speeds, speeds, st.floats(-100.0, 100.0))
def test_arcs_and_axes_are_inverse_and_rates_are_changes(x, y, z, u, w, climb):
    radius = 6.76e6
    p, v = Vec3(x, y, z), Vec3(u, w, 1.0)
    arc, rate = along_arc(p, v, radius, climb)
    back, speed = from_arc(arc, rate, radius, climb)
    # Sixteen digits of the radius.
    np.testing.assert_allclose(back.columns(), p.columns(), rtol=0, atol=4e-9)
    np.testing.assert_allclose(speed.columns(), v.columns(), rtol=0, atol=1e-11)
    # The change over a short time, of both the craft and the target.
    dt = 1e-2
    ends = [
        along_arc(
            Vec3(x + s * u * dt, y + s * w * dt, z + s * dt), v, radius + s * climb * dt, climb
        )[0]
        for s in (-0.5, 0.5)
    ]
    change = (np.array(ends[1].columns()) - np.array(ends[0].columns())) / dt
    np.testing.assert_allclose(change, rate.columns(), rtol=0, atol=1e-6)


def test_a_craft_behind_its_target_on_a_circle_has_no_height_along_the_arc():
    """2 km behind on a circle of 7,000 km: d^2 / 2r = 0.2857 m below the axis of the target."""
    radius, angle = 7e6, -2000.0 / 7e6
    p = Vec3(radius * (np.cos(angle) - 1.0), radius * np.sin(angle), 0.0)
    assert p.x == pytest.approx(-0.2857, abs=1e-4)
    arc, _ = along_arc(p, Vec3(0.0, 0.0, 0.0), radius, 0.0)
    np.testing.assert_allclose(arc.columns(), (0.0, -2000.0, 0.0), atol=1e-8)
