"""Late and gradual valves, against SciPy's integrator on thrusts followed nozzle by nozzle, and by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rans.effectors.motion import held
from rans.model.actuators import OnOff, Pulsed, Throttle
from rans.model.body import Body
from rans.model.dynamics import PlanarState, Wrench
from rans.model.fields import Heading, Vec2, leaves
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.timing import Timing
from rans.randomization.valves import Lag, pieces
from tests.support.crafts import nasty_planar

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


def nozzle(told: list[tuple[float, float]], lag: Lag, t: float) -> float:
    """Thrust of one nozzle, told shares at times: what was first, and every change on its way."""
    share = told[0][1]
    for (_, old), (time, new) in pairwise(told):
        ramp: Any = lag.rise
        share += (new - old) * float(np.interp(t - time - lag.latency, [0.0, ramp], [0.0, 1.0]))
    return share


def pushes(craft: Spacecraft, commands: list[list[float]]) -> list[list[tuple[float, float]]]:
    """When each nozzle was told what; oldest command first, the last one at time 0."""
    result: list[list[tuple[float, float]]] = [[] for _ in craft.thrusters]
    for age, command in zip(range(len(commands) - 1, -1, -1), commands, strict=True):
        for told, duty in zip(result, command, strict=True):
            kind = craft.actuators
            if not isinstance(kind, Pulsed):
                told.append((-age * PERIOD, duty))
                continue
            open_for = round(duty * kind.counts) / kind.counts
            told.append((-age * PERIOD, float(open_for > 0)))
            if open_for < 1.0:
                told.append(((open_for - age) * PERIOD, 0.0))
    return result


@pytest.mark.parametrize("kind", [OnOff(), Pulsed(1000), Pulsed(4), Throttle()], ids=str)
@pytest.mark.parametrize(
    "lag",
    [
        Lag(0.13, 0.09),
        Lag(0.0, 0.19),
        Lag(0.02, 0.3),
        # Known to be over within the period, whose own command is then the only change.
        Lag(0.06, 0.05, 0.1, 0.1),
    ],
    ids=str,
)
def test_one_period_is_that_of_scipy(kind: Any, lag: Lag) -> None:
    craft = replace(nasty_planar(), actuators=kind)
    random = np.random.default_rng(6)
    most = 4 if kind.is_continuous else 1
    felt = 2 if lag.latest < PERIOD else 4
    commands = random.integers(0, most + 1, (felt, 5)) / most
    told = pushes(craft, commands.tolist())
    arms = np.array([t.position for t in craft.thrusters])[:, :2] - craft.centre_of_mass[:2]
    forces = np.array([np.array(t.direction[:2]) * t.force for t in craft.thrusters])
    torques = arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]

    def derivative(t: float, y: np.ndarray) -> Any:
        shares = np.array([nozzle(one, lag, t) for one in told])
        (fx, fy) = shares @ forces
        c = np.cos(y[2])
        s = np.sin(y[2])
        return [
            y[3],
            y[4],
            y[5],
            (c * fx - s * fy + 0.2) / craft.mass,
            (s * fx + c * fy - 0.1) / craft.mass,
            (shares @ torques + 0.03) / craft.inertia[2][2],
        ]

    y = np.array([0.1, -0.2, 0.7, 0.3, 0.1, 0.5])
    start = PlanarState(Vec2(*y[:2]), Heading(y[2]), Vec2(*y[3:5]), y[5])
    times = {
        time + lag.latency + more
        for one in told
        for time, _ in one
        for more in (0.0, lag.rise or 0.0)
    }
    kinks = sorted({0.0, PERIOD, *(t for t in times if 0.0 < t < PERIOD)})
    for begin, end in pairwise(kinks):
        y = solve_ivp(derivative, (begin, end), y, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    newest, *earlier = [tuple(row) for row in commands[::-1].tolist()]
    found = after(start, craft, lag, newest, earlier, disturbance=Wrench(Vec2(0.2, -0.1), 0.03))
    np.testing.assert_allclose(
        leaves(found), y, rtol=0, atol=1e-11
    )  # SciPy's tolerance, a few pieces of it


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
def test_impulses_by_hand(lag: Lag, told: Any, earlier: Any, speed: float, known: bool) -> None:
    if known:
        lag = replace(lag, latest=lag.latency, slowest=lag.rise or 0.0)
    rest = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    found = after(rest, ROD, lag, told, earlier)
    assert (found.v.x, found.v.y) == pytest.approx((speed, 0.0), abs=1e-15)


def test_a_pulse_as_long_as_the_period_does_not_end_with_it() -> None:
    """Two valves open all the time stay open, however slowly valves move."""
    craft = replace(ROD, actuators=Pulsed(100))
    rest = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0)
    both = (1.0, 0.0, 1.0, *[0.0] * 3)
    found = after(rest, craft, Lag(0.0, 0.1), both, [both])
    assert (found.v.x, found.v.y) == pytest.approx((0.1, 0.1), abs=1e-15)
