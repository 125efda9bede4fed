"""Late and gradual valves, against SciPy's integrator on thrusts followed nozzle by nozzle, and by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from rans import Spacecraft, Thruster, Timing
from rans.effectors.motion import held
from rans.model.actuators import Pulsed
from rans.model.body import Body
from rans.model.dynamics import PlanarState, Wrench
from rans.randomization.valves import Lag, pieces
from tests.support.states import planar

PERIOD = 0.2


def after(
    start: PlanarState,
    craft: Spacecraft,
    lag: Lag,
    newest: Any,
    earlier: Sequence[Any],
    disturbance: Wrench | None = None,
) -> PlanarState:
    """The state one period after a start, with earlier commands on their way."""
    body = Body.of(craft)
    late = pieces(craft, body, (newest, *earlier), lag, PERIOD)
    return held(start, craft, body, newest, Timing(PERIOD), disturbance=disturbance, pieces=late)


ROD = Spacecraft(
    "rod",
    2,
    2.0,
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    tuple(
        Thruster((at, 0.0, 0.0), (x, y, 0.0), 1.0)
        for at, x, y in (
            (0.0, 1.0, 0.0),
            (0.0, -1.0, 0.0),
            (0.0, 0.0, 1.0),
            (0.0, 0.0, -1.0),
            (0.5, 0.0, 1.0),
            (0.5, 0.0, -1.0),
        )
    ),
)
"""2 kg; the first four of its nozzles, of 1 N, push through its middle."""
ALONG = (1.0, *[0.0] * 5)
NONE = (0.0,) * 6


@pytest.mark.parametrize("known", [False, True], ids=["", "bounds are known"])
@pytest.mark.parametrize(
    ("lag", "told", "earlier", "speed"),
    [
        # 1 N on 2 kg from 0.05 s on: 0.15 s.
        (Lag(0.05, None), ALONG, [NONE], 0.075),
        # Half of a rise of 0.1 s is lost as well.
        (Lag(0.05, 0.1), ALONG, [NONE], 0.05),
        # The rise is not over: from 0.1 s on a triangle up to a half, 0.1 s * 0.5 / 2.
        (Lag(0.1, 0.2), ALONG, [NONE], 0.0125),
        # Shut, but the valve hears of it after 0.12 s and falls for 0.04 s: 0.14 s.
        (Lag(0.12, 0.04), NONE, [ALONG], 0.07),
        # Late by more than a period: open since -0.4 s, shut since -0.2 s, felt until 0.1 s.
        (Lag(0.3, None), ALONG, [NONE, ALONG], 0.05),
        # At once, where a ramp takes no time.
        (Lag(0.0, 0.0), ALONG, [NONE], 0.1),
    ],
)
def test_impulses_by_hand(lag, told, earlier, speed, known):
    if known:
        lag = replace(lag, latest=lag.latency, slowest=lag.rise or 0.0)
    rest = planar()
    found = after(rest, ROD, lag, told, earlier)
    assert (found.v.x, found.v.y) == pytest.approx((speed, 0.0), abs=1e-15)


def test_a_pulse_as_long_as_the_period_does_not_end_with_it():
    """Two valves open all the time stay open, however slowly valves move."""
    craft = replace(ROD, actuators=Pulsed(100))
    rest = planar()
    both = (1.0, 0.0, 1.0, *[0.0] * 3)
    found = after(rest, craft, Lag(0.0, 0.1), both, [both])
    assert (found.v.x, found.v.y) == pytest.approx((0.1, 0.1), abs=1e-15)
