"""A port that turns: where the docked state is, what the cone allows, and what counts as docked."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.tasks import DockPort
from scipy.spatial.transform import Rotation

from rans.episode.drawing import columns, rotations
from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World, step
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
SHUT = (0.0,) * 8


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=["plane", "space"])
def test_the_docked_state_turns_about_the_origin(craft):
    """After 20 s it is where SciPy's rotation takes it; its velocity is how its place changes."""
    task = DockPort(port_rate=(0.01, 0.3))
    goal = scenarios(task, craft, seed=2, count=32).goal
    later = task.later(goal, 20.0)
    spin = np.stack([np.broadcast_to(w, 32) for w in goal.spin()], axis=1)
    if craft is PLATFORM:
        spin = np.pad(spin, ((0, 0), (2, 0)))
    R = rotations(goal)
    turn = Rotation.from_rotvec(np.einsum("nij,nj->ni", R, spin) * 20.0)
    # A rotation's angle of 6 rad and lengths below 1 m: rounding.
    np.testing.assert_allclose(columns(later.p), turn.apply(columns(goal.p)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(rotations(later), turn.as_matrix() @ R, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(columns(later.p), axis=1), 0.65, rtol=0, atol=1e-12)
    small = 1e-4
    ways = columns(task.later(goal, small).p) - columns(task.later(goal, -small).p)
    # Differences of third order: w^3 r dt^2 / 6 = 3e-11; rounding over the step: 1e-12.
    np.testing.assert_allclose(columns(goal.v), ways / (2 * small), rtol=0, atol=1e-10)


def port_ahead(rate: float = 0.0) -> PlanarState:
    """The port at x = 0.65 m, whose docked spacecraft looks along -x."""
    return PlanarState(Vec2(0.65, 0.0), Heading(math.pi), Vec2(0.0, 0.65 * rate), rate)


def test_cone_and_target_by_hand():
    task = DockPort()
    apex = 0.55
    state = port_ahead()
    for x, y, cone in (
        (apex + 0.5, 0.0, 0.25),
        (apex, 0.4, -0.4 * math.cos(math.radians(30.0))),
        (apex + 2.0, 0.0, 1.0),
        (-0.6, 0.0, 0.15),
    ):
        margins = task.constraints(replace(state, p=Vec2(x, y)), state)
        assert margins["cone"] == pytest.approx(cone, abs=1e-8)
        assert margins["target"] == pytest.approx(math.hypot(x, y) - 0.5, abs=1e-8)
    cone, target = task.scenery(port_ahead())
    assert cone.gap(Vec2(apex + 0.5, 0.0)) == pytest.approx(0.25, abs=1e-8)
    assert target.gap(Vec2(0.0, 0.0)) == pytest.approx(-0.5, abs=1e-8)


def test_docked_is_relative_to_the_port():
    """A craft that stands still at a turning port is not docked; one that turns with it is."""
    task = DockPort(spin_tolerance=math.radians(1.0))
    goal = port_ahead(rate=0.1)
    assert bool(task.done(goal, goal))
    still = replace(goal, v=Vec2(0.0, 0.0), w=0.0)
    errors = task.errors(still, goal)
    assert errors["velocity"] == pytest.approx(0.065)
    assert errors["spin"] == pytest.approx(0.1)
    assert not bool(task.done(still, goal))


@pytest.mark.parametrize(("speed", "docked"), [(0.04, True), (0.06, False)])
def test_contact_between_two_commands(speed, docked):
    """From 6 cm away it passes the docked position within the period of 2 s, slowly enough or not.

    Its looks are 0.5 s or at most 3 cm apart, less than the 4 cm within which it is docked.
    """
    task = DockPort()
    world = World(Setup(PLATFORM, task, replace(task.timing, control_period=2.0, substeps=1)))
    goal = port_ahead()
    start = replace(goal, p=Vec2(0.71, 0.0), v=Vec2(-speed, 0.0))
    outcome = step(world, world.begin(start, goal), SHUT)
    assert bool(outcome.done) is docked
    assert bool(outcome.at_goal) is docked
    assert float(outcome.terms["done"]) == (400.0 if docked else 0.0)
