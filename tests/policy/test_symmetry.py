from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from rans_missions.tasks import Avoid, DockPort
from rans_missions.tasks.avoid import Zones
from scipy.spatial.transform import Rotation

from rans import Spacecraft
from rans.fast.learn.config import FilterSettings, MemorySettings
from rans.model.actuators import Propellant
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.policy.symmetry import Symmetries, symmetries
from rans.tasks import TASKS, MultiTask, observation
from rans.tasks.go_to_pose_priced import DrawnTradeOff
from rans.tasks.shapes import Ball
from tests.support.crafts import nasty_planar, nasty_spatial, random_states
from tests.support.engines import FLYER, PLATFORM, both_crafts
from tests.support.training import scatter, tiny_learner


def views_of(craft: Spacecraft) -> Symmetries:
    views = symmetries(craft)
    assert views is not None
    return views


def symmetric_policy(craft: Spacecraft, task: Any) -> Any:
    network = tiny_learner(craft, dtype=torch.float64, task=task, symmetric=True, zoom=4.0).network
    scatter(network)
    return network


def seen_as(view: np.ndarray, state: Any) -> Any:
    """The same state of a spacecraft whose axes are those of the view, in a mirrored world if need be."""
    hand = round(float(np.linalg.det(view)))
    if isinstance(state, PlanarState):
        flip = np.diag([1.0, hand])
        c = np.cos(state.attitude.angle)
        s = np.sin(state.attitude.angle)
        first = flip @ np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0) @ view.T
        angle = np.arctan2(first[:, 1, 0], first[:, 0, 0])
        p, v = (Vec2(*(flip @ np.stack(u.columns()))) for u in (state.p, state.v))
        return PlanarState(p, Heading(angle), v, state.w * hand)
    flip = np.diag([1.0, 1.0, hand])
    q = state.attitude
    R = Rotation.from_quat(np.stack([q.x, q.y, q.z, q.w], axis=1)).as_matrix()
    x, y, z, w = Rotation.from_matrix(flip @ R @ view.T).as_quat().T
    p, v = (Vec3(*(flip @ np.stack(u.columns()))) for u in (state.p, state.v))
    return SpatialState(p, Quat(w, x, y, z), v, Vec3(*(hand * view @ np.stack(state.w.columns()))))


def zones_seen_as(view: np.ndarray, zones: tuple[Ball, ...], like: Any) -> tuple[Ball, ...]:
    """Zones in the world of `seen_as`."""
    turned = (seen_as(view, replace(like, p=zone.centre, v=zone.v)) for zone in zones)
    return tuple(
        replace(zone, centre=one.p, v=one.v) for zone, one in zip(zones, turned, strict=True)
    )


def single_tasks() -> list[Any]:
    return [TASKS[name]() for name in TASKS if not isinstance(TASKS[name](), MultiTask)]


@pytest.mark.parametrize("task", single_tasks(), ids=lambda task: type(task).__name__)
@both_crafts
def test_policies_fly_every_equivalent_view_alike(craft, task):
    if craft.dimension == 3 and type(task).__name__ == "TrackVelocityHeading":
        pytest.skip("a task of the plane")
    if craft.dimension not in task.dimensions:
        pytest.skip("a task of the other dimension")
    if not task.symmetric:
        pytest.skip("its world is not the same from every side")
    if isinstance(task, DockPort):
        pytest.skip("it finds its port by the spacecraft's x axis, which is another one of a view")
    network = symmetric_policy(craft, task)
    views = views_of(craft)
    state, goal = (random_states(craft.dimension, 50, seed) for seed in (5, 6))

    trade_off = DrawnTradeOff(np.linspace(0.0, 1.0, 50))
    zones = tuple(
        Ball(one.p, one.v, 0.4)
        for one in (random_states(craft.dimension, 50, k) for k in (7, 8, 9))
    )

    def logit(state, goal, zones=zones):
        notes = Zones(zones) if isinstance(task, Avoid) else trade_off
        seen = observation(task, state, replace(goal, notes=notes))
        return network.evaluate(torch.from_numpy(np.stack(seen, axis=1))).policy[0]

    here = logit(state, goal)
    assert len(views.turn) == {2: 8, 3: 16}[craft.dimension]
    for view, place in zip(views.turn, views.place, strict=True):
        turned = zones_seen_as(view, zones, state)
        there = logit(seen_as(view, state), seen_as(view, goal), turned)
        # Rounding of float64 through rotations and weights of order one, magnified by 4.
        torch.testing.assert_close(there[:, place], here, rtol=0, atol=1e-10)
    assert (logit(seen_as(views.turn[-1], state), goal) - here).abs().max() > 0.1


@both_crafts
@pytest.mark.parametrize("drift", [(), (0.1,)], ids=["history", "commands and a filter"])
def test_what_is_remembered_is_seen_from_the_same_side(craft, drift):
    """Flights of three steps, and the same flights of a craft turned about."""
    task = TASKS["go-to-pose"]()
    memory = {"memory": MemorySettings(2), "filters": FilterSettings(drift)}
    network = scatter(
        tiny_learner(craft, dtype=torch.float64, task=task, symmetric=True, **memory).network
    )
    goal, *states = (random_states(craft.dimension, 50, seed) for seed in range(4))

    def flown(view, place):
        kept = network.initial_state(50)
        said = torch.empty(0)
        for step, state in enumerate(states):
            seen = np.stack(observation(task, seen_as(view, state), seen_as(view, goal)), axis=1)
            output, columns = network.forward(torch.from_numpy(seen), kept)
            told = torch.randn(
                50, len(place), generator=torch.Generator().manual_seed(step)
            ).double()
            command = torch.empty_like(told)
            command[:, place] = told  # the same nozzles, wherever they are now
            kept = network.next_state(columns, kept, command)
            said = output.policy[0][:, place]  # type: ignore
        return said

    views = views_of(craft)
    here = flown(np.eye(craft.dimension), np.arange(len(craft.thrusters)))
    for view, place in zip(views.turn, views.place, strict=True):
        # Rounding of float64 through rotations and weights of order one.
        torch.testing.assert_close(flown(view, place), here, rtol=0, atol=1e-10)
    mixed = flown(views.turn[-1], np.arange(len(craft.thrusters)))
    assert (mixed - here).abs().max() > 0.1


@both_crafts
def test_thrusters_push_in_their_new_places_as_in_their_old_ones(craft):
    views = views_of(craft)
    wrench = np.array(craft.wrench_map)
    d = craft.dimension
    for view, hand, place in zip(*views, strict=True):
        np.testing.assert_allclose(wrench[place][:, :d], wrench[:, :d] @ view.T, atol=1e-12)
        torque = wrench[:, d:] * hand if d == 2 else hand * wrench[:, d:] @ view.T
        np.testing.assert_allclose(wrench[place][:, d:], torque, atol=1e-12)


def test_spacecraft_with_less_symmetry():
    anchor = tuple(replace(t, force=0.5) if i < 2 else t for i, t in enumerate(PLATFORM.thrusters))
    diagonal = views_of(
        replace(PLATFORM, thrusters=anchor)
    )  # both nozzles of the anchor at 45 degrees
    swapped = [[[0.0, 1.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]]]
    np.testing.assert_allclose(sorted(diagonal.turn.round(9).tolist()), swapped, atol=1e-9)
    one = tuple(replace(t, force=0.5) if i == 0 else t for i, t in enumerate(PLATFORM.thrusters))
    assert symmetries(replace(PLATFORM, thrusters=one)) is None
    # Ahead of the middle: left and right look alike, front and back do not.
    ahead = views_of(replace(PLATFORM, centre_of_mass=(0.05, 0.0, 0.0)))
    assert sorted(ahead.hand.tolist()) == [-1.0, 1.0]
    # Three different moments of inertia about the axes leave turns by 180 degrees and mirror images.
    long = replace(FLYER, inertia=((0.1, 0.0, 0.0), (0.0, 0.15, 0.0), (0.0, 0.0, 0.2)))
    assert len(views_of(long).turn) == 8
    assert symmetries(nasty_planar()) is None
    assert symmetries(nasty_spatial()) is None


def test_twin_thrusters_never_share_a_place():
    """Of two at one place it cannot be said which becomes which, and one command must not go to both."""
    views = symmetries(replace(PLATFORM, thrusters=PLATFORM.thrusters * 2))
    places = [] if views is None else views.place.tolist()
    assert all(sorted(place) == list(range(16)) for place in places)


def test_thrusters_without_a_lever_arm_have_their_own_view_only():
    centred = tuple(replace(t, position=(0.0, 0.0, 0.0)) for t in PLATFORM.thrusters)
    assert symmetries(replace(PLATFORM, thrusters=centred)) is None


def test_a_tank_off_the_centre_is_on_one_side():
    tank = Propellant(1.0, 200.0, (0.05, 0.02, 0.0))
    assert symmetries(replace(PLATFORM, propellant=tank)) is None
    centred = replace(tank, position=PLATFORM.centre_of_mass)
    assert len(views_of(replace(PLATFORM, propellant=centred)).hand) == len(views_of(PLATFORM).hand)


def test_sides_with_other_supplies_do_not_look_the_same():
    """Supplies by turns leave half of the platform's views; one thruster with a supply of its own leaves none."""
    every = len(views_of(PLATFORM).hand)
    halves = tuple(replace(one, supply=i // 4) for i, one in enumerate(PLATFORM.thrusters))
    assert 1 < len(views_of(replace(PLATFORM, thrusters=halves)).hand) < every
    lone = (replace(PLATFORM.thrusters[0], supply=1), *PLATFORM.thrusters[1:])
    assert symmetries(replace(PLATFORM, thrusters=lone)) is None
