"""Control periods in which thrusters fail: what is so at any instant, of any craft, valves and commands."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rans.episode import Setup, World
from rans.model.actuators import OnOff, Pulsed, Throttle
from rans.model.body import Body
from rans.model.dynamics import PlanarState, SpatialState, undelayed
from rans.model.fields import Heading, Quat, Vec2, Vec3, leaves
from rans.model.timing import Timing
from rans.randomization.parameters import Failing, StepInputs
from rans.randomization.valves import Lag, failing
from rans.tasks import GoToPose
from tests.support.crafts import nasty_planar, nasty_spatial

PERIOD = 0.2
CRAFTS = {2: nasty_planar(), 3: nasty_spatial()}
STARTS: dict[int, Any] = {
    2: PlanarState(Vec2(0.1, -0.2), Heading(0.7), Vec2(0.3, 0.1), 0.5),
    3: SpatialState(
        Vec3(0.1, -0.2, 0.3),
        Quat(1.0, 0.2, -0.3, 0.4).normalised(),
        Vec3(0.3, 0.1, -0.2),
        Vec3(0.5, -0.2, 0.3),
    ),
}
LAGS = [
    None,
    Lag(0.06, None),
    Lag(0.0, 0.05, 0.0, 0.1),
    Lag(0.13, 0.09),
    Lag(0.02, 0.3),
]

TOLERANCE = {2: 1e-13, 3: 1e-9}
"""Rounding of a dozen pieces in the plane; what the series of order six leaves in space, where a period that
is divided otherwise takes other substeps."""

each_kind = pytest.mark.parametrize(
    ("dimension", "kind"),
    [
        (2, OnOff()),
        (2, Pulsed(1000)),
        (2, Throttle()),
        (3, Pulsed(2)),
    ],
    ids=str,
)
few = settings(max_examples=6)
lags = st.sampled_from(LAGS)
seeds = st.integers(0, 2**32 - 1)


class Period:
    """One control period of a craft: random commands, and random thrusters that are broken after it."""

    def __init__(self, dimension: int, kind: Any, lag: Lag | None, seed: int) -> None:
        random = np.random.default_rng(seed)
        craft = replace(CRAFTS[dimension], actuators=kind)
        thrusters = len(craft.thrusters)
        most = 4 if kind.is_continuous else 1
        commands = random.integers(0, most + 1, (4, thrusters)) / most
        told = tuple(tuple(row) for row in commands.tolist())
        within = lag is not None and lag.latest < PERIOD
        self._sound = StepInputs(Body.of(craft), told[:2] if within else told, lag)
        self._start = STARTS[dimension]
        self.world = World(Setup(craft, GoToPose(), Timing(PERIOD, substeps=4)))
        self.sound = self._sound.body
        self.broken = replace(
            self.sound,
            gain=tuple(random.uniform(0.0, 1.0, thrusters).tolist()),
            leak=tuple(random.uniform(0.0, 0.5, thrusters).tolist()),
        )

    def after(self, body: Body, then: Failing | None = None) -> Any:
        """The state in the end, of whoever flies this body, and another one from an instant on."""
        moved = self.world.move(self._start, replace(self._sound, body=body, failing=then))
        return np.array(np.broadcast_arrays(*leaves(moved[-1])))


@each_kind
@few
@given(lag=lags, seed=seeds, long=st.sampled_from([0.0, 1e-9, 0.1, 30.0]))
def test_who_fails_outside_the_period_is_failed_or_sound_in_all_of_it(
    dimension: int, kind: Any, lag: Lag | None, seed: int, long: float
) -> None:
    one = Period(dimension, kind, lag, seed)
    instants = np.array([-long, PERIOD + long])
    found = one.after(one.sound, Failing(instants, one.broken))
    expected = np.stack([one.after(one.broken), one.after(one.sound)], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE[dimension])


@each_kind
@few
@given(lag=lags, seed=seeds, instant=st.floats(0.0, PERIOD))
def test_where_nothing_changes_it_does_not_matter_when(
    dimension: int, kind: Any, lag: Lag | None, seed: int, instant: float
) -> None:
    """Broken thrusters that fail once more as they are."""
    one = Period(dimension, kind, lag, seed)
    found = one.after(one.broken, Failing(instant, one.broken))
    np.testing.assert_allclose(found, one.after(one.broken), rtol=0, atol=TOLERANCE[dimension])


@given(
    counts=st.integers(1, 6),
    duties=st.lists(st.floats(0.0, 1.0), min_size=5, max_size=5),
    instant=st.floats(-0.1, 0.3),
)
def test_pieces_fill_the_period_and_none_is_longer_than_it_says(
    counts: int, duties: list[float], instant: float
) -> None:
    """Bounds choose the substeps: they hold at any instant, as a program knows none of them."""
    craft = replace(CRAFTS[2], actuators=Pulsed(counts))
    body = Body.of(craft)
    when = np.array([instant])
    sound, failed = (undelayed(craft, body, duties, PERIOD) for _ in range(2))
    pieces = list(failing(sound, failed, when))
    durations = np.array([np.broadcast_to(piece[0], 1)[0] for piece in pieces])
    assert durations.sum() == pytest.approx(PERIOD, abs=1e-15)
    assert (durations >= 0.0).all()
    assert (durations <= np.array([piece[3] for piece in pieces]) + 1e-15).all()
    # One count each, beside the one that the instant divides.
    assert [piece[3] for piece in pieces] == pytest.approx([PERIOD / counts] * (counts + 1))
