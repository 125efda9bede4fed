"""Craft whose thrusters all act through the centre of mass: they are pushed, and never turned."""

import numpy as np
import pytest
from rans_optimal.mpc import MPC

from rans import (
    LQR,
    ConfigError,
    GoToPose,
    GoToPosition,
    Switching,
    Timing,
    TrackTwist,
    TrackVelocity,
)
from rans.control.allocation import Allocation
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import impulses, settling_times
from tests.support.crafts import deputy, point

KINDS = (LQR, MPC, Switching)
CRAFTS = {"deputy": deputy(), "point": point()}

every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
every_craft = pytest.mark.parametrize("craft", CRAFTS.values(), ids=CRAFTS)


@every_craft
def test_forces_are_met_and_torques_ignored(craft):
    wanted = np.random.default_rng(0).normal(size=(20, craft.degrees_of_freedom)) * 0.1
    commands = Allocation(craft).commands(wanted)
    given = commands @ np.array(craft.wrench_map)
    axes = craft.dimension
    np.testing.assert_allclose(given[:, :axes], wanted[:, :axes], atol=1e-9)
    np.testing.assert_allclose(given[:, axes:], 0.0, atol=1e-15)
    assert (commands >= 0.0).all()


@pytest.mark.parametrize(
    ("kind", "number"),
    [(LQR, 0), (MPC, 1), (Switching, 0)],
    ids=lambda x: getattr(x, "name", ("place", "velocity")[x] if isinstance(x, int) else None),
)
def test_every_controller_settles(kind, number):
    """The position with one craft, the velocity with the other.

    3 to 4 m with 0.083 and 0.22 m/s^2: at least 2 sqrt(4 / 0.083) = 14 s. Pulses of the point are 0.04 m/s,
    half of which is within the tolerance."""
    task = (GoToPosition().for_evaluation(), TrackVelocity())[number]
    craft = list(CRAFTS.values())[number]
    period = 0.5 if craft.dimension == 3 else 0.16
    timing = Timing(control_period=period, episode_steps=round(40.0 / period))
    starts = scenarios(task, craft, 9, 2)
    flight = fly(craft, task, kind(craft, task, timing), starts, timing)
    settled = settling_times(flight)
    assert np.isfinite(settled).all()
    assert settled.max() < 30.0
    assert impulses(flight).min() > 0.0


@every_kind
@pytest.mark.parametrize("task", [GoToPose(), TrackTwist()], ids=["attitude", "spin"])
def test_what_cannot_turn_is_not_asked_to(kind, task):
    with pytest.raises(ConfigError, match=r"asks for .*spin, and spacecraft 'point' cannot turn"):
        kind(point(), task, Timing())
