"""Forces and torques that stay put in the world."""

from __future__ import annotations

import pytest

from rans.model.body import Body
from rans.model.dynamics import PlanarState, Wrench, advance, wrench
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft


def test_a_steady_push_is_the_parabola() -> None:
    """Half a newton along x for 0.2 s on 5.32 kg: 0.5 / 5.32 * 0.2 = 0.0187970 m/s, half of that * 0.2 s."""
    craft = load_spacecraft("floating-platform")
    state = PlanarState(Vec2(0.0, 0.0), Heading(1.0), Vec2(0.0, 0.0), 0.0)
    after = advance(state, wrench(craft, (0.0,) * 8), Body.of(craft), 0.2,
                    disturbance=Wrench(Vec2(0.5, 0.0), 0.02045008))
    assert (after.v.x, after.v.y) == pytest.approx((0.018796992, 0.0), abs=1e-9)
    assert after.p.x == pytest.approx(0.0018796992, abs=1e-10)
    # 0.02045008 N m on 0.2045008 kg m^2 are 0.1 rad/s^2.
    assert (after.w, after.attitude.angle) == pytest.approx((0.02, 1.002), abs=1e-12)
