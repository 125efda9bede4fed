"""The oracles themselves, on cases that can be worked out on paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from validation.oracles import spinning_up, tumbling
from validation.sampling import random_states


def test_fresnel_without_push_is_a_straight_line() -> None:
    start = random_states(2, 5, 1)
    end = spinning_up(start, np.zeros(5, dtype=complex), np.full(5, -0.7), 3.0)
    assert np.allclose(end.p.x, start.p.x + 3.0 * start.v.x, atol=1e-14)
    assert np.allclose(end.attitude.angle, start.attitude.angle + 3.0 * start.w - 0.35 * 9.0, atol=1e-14)


def test_fresnel_with_hardly_any_spin_up_is_a_parabola() -> None:
    """From rest at heading 90 degrees, 0.2 m/s^2 forward for 2 s: 0.4 m along y, 0.4 m/s."""
    start = PlanarState(Vec2(np.zeros(1), np.zeros(1)), Heading(np.array([math.pi / 2])),
                        Vec2(np.zeros(1), np.zeros(1)), np.zeros(1))
    end = spinning_up(start, np.array([0.2 + 0.0j]), np.array([1e-4]), 2.0)
    # The heading changes by 2e-4 rad, which is 1e-4 of the way; half of it bends the path.
    assert end.p.y[0] == pytest.approx(0.4, abs=1e-7)
    assert end.p.x[0] == pytest.approx(0.0, abs=1e-4)
    assert end.v.y[0] == pytest.approx(0.4, abs=1e-7)


@pytest.mark.parametrize(("least", "largest"), [(0.9, 0.3), (0.2, 0.9)], ids=["inner", "outer"])
def test_the_top_keeps_energy_and_momentum_and_starts_where_it_should(least, largest) -> None:
    moments, time = np.array([0.2, 0.3, 0.5]), np.linspace(0.0, 20.0, 50)
    track = tumbling(moments, np.full(50, least), np.full(50, largest), time)  # type: ignore[arg-type]
    assert track[:, 0] == pytest.approx([least, 0.0, largest], abs=1e-15)
    for weights in (moments, moments**2):  # twice the energy, the momentum's square
        kept = weights @ track**2
        assert kept == pytest.approx(kept[0], rel=1e-13)
    # I2 w2' = (I3 - I1) w3 w1, by the difference of two close moments.
    early = tumbling(moments, np.array([least]), np.array([largest]), 1e-6)
    assert early[1, 0] / 1e-6 == pytest.approx((0.5 - 0.2) / 0.3 * least * largest, rel=1e-6)
