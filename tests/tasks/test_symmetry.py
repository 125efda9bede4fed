"""Neither where the world's frame lies nor whether a motion is planar changes what a task says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.episode.scenario import scenarios
from rans.model.drift import FREE
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Quat, Vec2, Vec3, leaves, unflatten
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.derived import dimensions
from rans.tasks.shapes import Ball
from tests.support.crafts import random_states
from tests.support.states import in_space
from tests.support.transitions import COUNT, arrival


def test_a_moved_world_changes_nothing(task, states, goals, commands):
    """Errors, reward and failure are the same when start and goal are turned and shifted together.

    A drift that is not the same in all directions shows in the reward.
    """
    moved_states = moved(states)
    moved_goals = moved(goals)
    here, there = (
        {
            "failed": task.failed(s, g),
            **task.errors(s, g),
            **(task.reward(arrival(s, g, *commands)) if task.drift is FREE else {}),
        }
        for s, g in ((states, goals), (moved_states, moved_goals))
    )
    for name, x in here.items():
        # distances of 10 m carry 1e-15; an angle near zero or half a turn keeps half the digits of
        # a cosine but all of an atan2
        np.testing.assert_allclose(there[name], x, rtol=0, atol=1e-12, err_msg=name)


def moved(state: Any) -> Any:
    """The state seen from a world frame that is turned and shifted; body quantities stay."""
    state = replace(state, notes=with_zones(moved_zone, state.notes))
    if isinstance(state, PlanarState):
        turn = Rotation.from_rotvec([0, 0, 2.1]).as_matrix()[:2, :2]
        p, v = (Vec2(*(turn @ np.stack(x.columns()))) for x in (state.p, state.v))
        return replace(
            state, p=p + Vec2(3.0, -5.0), attitude=Heading(state.attitude.angle + 2.1), v=v
        )
    turn = Rotation.from_rotvec([0.4, -1.2, 0.8])
    p, v = (Vec3(*turn.apply(np.stack(x.columns(), axis=1)).T) for x in (state.p, state.v))
    w, x, y, z = leaves(state.attitude)
    qx, qy, qz, qw = (turn * Rotation.from_quat(np.stack([x, y, z, w], axis=1))).as_quat().T
    return replace(state, p=p + Vec3(3.0, -5.0, 1.0), attitude=Quat(qw, qx, qy, qz), v=v)


def with_zones(change: Any, notes: Any) -> Any:
    """Notes of a goal with every zone changed; numbers stay."""
    if not hasattr(notes, "zones"):
        return notes
    return replace(notes, zones=tuple(map(change, notes.zones)))


def moved_zone(zone: Ball) -> Ball:
    """A zone moves as a state does."""
    like = random_states(len(zone.centre.columns()), COUNT, seed=1)  # pyrefly: ignore[bad-argument-type]
    there = moved(replace(like, p=zone.centre, v=zone.v))
    return replace(zone, centre=there.p, v=there.v)


def test_the_plane_is_a_slice_of_space(task):
    """A planar motion written as a spatial one has the same errors and reward."""
    if dimensions(task) != (2, 3):
        pytest.skip("the task works in one of them")
    flat = random_states(2, COUNT, seed=7)
    drawn_goal = flat_goals(task)
    goal = random_states(2, COUNT, seed=8, speed=0.0, spin=0.0)
    goal = unflatten(drawn_goal, (*leaves(goal), *leaves(drawn_goal)[6:]))
    opened = (np.ones(COUNT),) * 8
    shut = (np.zeros(COUNT),) * 8
    pairs = (
        (task.errors(flat, goal), task.errors(embedded(flat), embedded(goal))),
        (
            task.reward(arrival(flat, goal, opened, shut)),
            task.reward(arrival(embedded(flat), embedded(goal), opened, shut)),
        ),
    )
    for plane, space in pairs:
        assert plane.keys() == space.keys()
        for key, value in plane.items():
            # twice an atan2 against a difference of angles
            np.testing.assert_allclose(space[key], value, rtol=0, atol=1e-13, err_msg=key)


def flat_goals(task: Any) -> Any:
    return scenarios(task, load_spacecraft("floating-platform"), seed=9, count=COUNT).goal


def embedded(flat: Any) -> Any:
    return replace(in_space(flat), notes=with_zones(spatial_ball, flat.notes))


def spatial_ball(disc: Ball) -> Ball:
    zero = np.zeros(COUNT)
    centre, v = (Vec3(u.x, u.y, zero) for u in (disc.centre, disc.v))
    return Ball(centre, v, disc.radius)
