"""Coasts past balls and in turning cones against small steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings, strategies as st
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.coasting import Coasting
from rans_missions.tasks import Avoid, DockPort
from rans_missions.tasks.avoid import Zones

from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World
from rans.model.drift import FREE
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball

PLATFORM = load_spacecraft("floating-platform")
unit = st.floats(-1.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(unit, min_size=8, max_size=8), st.floats(0.2, 0.6))
def test_coasting_past_balls_is_judged_as_by_small_steps(xs, radius):
    """The closed form against 4,000 instants of 60 s, whatever the two velocities."""
    x, y, vx, vy, bx, by, ux, uy = xs
    ball = Ball(Vec2(2.0 * bx, 2.0 * by), Vec2(0.05 * ux, 0.05 * uy), radius)
    task = Avoid(zones=1)
    p = Vec2(np.array([2.0 * x]), np.array([2.0 * y]))
    v = Vec2(np.array([vx]), np.array([vy]))
    state = PlanarState(p, Heading(np.zeros(1)), v, np.zeros(1))
    goal = PlanarState(Vec2(0.0, 0.0), Heading(0.0), Vec2(0.0, 0.0), 0.0, notes=Zones((ball,)))
    world = World(Setup(PLATFORM, task, task.timing))
    times = np.linspace(0.0, 60.0, 4001)
    gaps = ball.later(times).gap(p + v.scale(times))
    coasting = Coasting(Ahead(world), 3)
    # Between two instants a gap falls by half of the way at most, and what is later than 60 s is not seen.
    step = 0.5 * 60.0 / 4000 * float(np.hypot(vx - 0.05 * ux, vy - 0.05 * uy))
    least = float(coasting.least(state, goal)[0])
    assert least <= gaps.min() + 1e-9
    assert least >= gaps.min() - step - 1e-9 or gaps.argmin() == 4000


def test_coasting_in_a_turning_cone_is_never_called_safe_where_it_is_not():
    """Asked once a period, but true at twenty instants of each: 40 s of 200 craft near a port."""
    task = DockPort()
    starts = scenarios(task, PLATFORM, seed=5, count=200)
    rng = np.random.default_rng(1)
    p: Any = starts.goal.p + Vec2(*(0.6 * rng.normal(size=(2, 200))))
    v = Vec2(*(0.05 * rng.normal(size=(2, 200))))
    state = replace(starts.start, p=p, v=v)
    world = World(Setup(PLATFORM, task, task.timing))
    found = Coasting(Ahead(world), 200).least(state, starts.goal) >= 0.0
    times = np.linspace(0.0, 40.0, 4001)[:, None]
    moved, _ = FREE.carry(p, v, times)
    margins = task.constraints(replace(state, p=moved), task.later(starts.goal, times))
    kept = np.all([margin >= 0.0 for margin in margins.values()], axis=(0, 1))
    assert 10 < found.sum() < 190
    assert not (found & ~kept).any()
    assert (found & kept).sum() > 0.8 * kept.sum()
