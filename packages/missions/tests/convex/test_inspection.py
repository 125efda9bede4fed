"""Bound of the impulse of an inspection, against linear programs over sequences of burns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from rans_missions.convex.inspection import inspection_bound
from rans_missions.tasks import Inspect
from rans_missions.tasks.inspect import Inspected
from scipy.optimize import linprog

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from tests.support.clohessy_wiltshire import transition

DEPUTY = load_spacecraft("afrl-deputy")
MASS = 12.0
WITHIN = 1_500.0


def states(p: Any, v: Any, sun: float) -> tuple[SpatialState, SpatialState]:
    """Start and goal of an episode."""
    level = Quat(1.0, 0.0, 0.0, 0.0)
    still = Vec3(0.0, 0.0, 0.0)
    start = SpatialState(Vec3(*map(float, p)), level, Vec3(*map(float, v)), still)
    return start, SpatialState(still, level, still, still, notes=Inspected(sun, 0.0, (0.0,)))


def program(task: Inspect, normal: np.ndarray, p: Any, v: Any, sun: float) -> float:
    """Least impulse of one point by linear programs: burns along the axes at every check, seen at one of them."""
    n = task.mean_motion
    times = np.arange(0.0, WITHIN + 1.0, 10.0)
    moves = [transition(n, time)[:6, :6] for time in times]
    best = math.inf
    for k, time in enumerate(times):
        angle = sun - n * time
        if normal @ [math.cos(angle), math.sin(angle), 0.0] <= 0.0:
            continue
        free = normal @ (moves[k] @ np.concatenate([p, v]))[:3]
        if free >= task.surface_distance:
            return 0.0
        effects = np.concatenate([normal @ move[:3, 3:] / MASS for move in moves[: k + 1]])
        row = -np.concatenate([effects, -effects])[None]
        solution = linprog(np.ones(row.size), row, [free - task.surface_distance])
        if solution.status == 0:
            best = min(best, float(solution.fun))
    return best


@pytest.mark.parametrize("seed", [5, 8])
def test_the_bound_is_the_second_dearest_of_three_points_by_linear_programs(seed):
    """One of three points may stay unseen; from these starts the second dearest is not free."""
    rng = np.random.default_rng(seed)
    task = Inspect(points=3, unseen_tolerance=0.4)
    p = rng.normal(size=3)
    p *= 70.0 / np.linalg.norm(p)
    v = rng.normal(size=3) * 0.05
    sun = rng.uniform(-3.0, 3.0)
    programs = sorted(program(task, np.array(one), p, v, sun) for one in task.normals)
    assert programs[1] > 0.0
    found = inspection_bound(DEPUTY, task, *states(p, v, sun), WITHIN, task.timing)
    # The tolerance of HiGHS, and burns between checks, which the programs have not.
    assert programs[1] * (1.0 - 2e-4) < found < programs[1] * (1.0 + 1e-6)


def test_a_point_is_priced_by_hand():
    """At rest 40 m along the track a craft stays, with x = 0; the only point has its normal along x.

    After a quarter of an orbit, 1 m/s along x is worth 1 / n metres of x, and 1 m/s along y 2 / n. So 10 m cost
    12 kg x 10 m x n / 2, and a craft that may push in any direction 12 kg x 10 m x n / sqrt(5).
    """
    task = Inspect(points=1)
    n = task.mean_motion
    start, goal = states((0.0, 40.0, 0.0), (0.0, 0.0, 0.0), 0.25 * math.pi)
    quarter = 0.5 * math.pi / n
    # The last check is 9 s before the quarter.
    along_axes = inspection_bound(DEPUTY, task, start, goal, quarter, task.timing)
    assert along_axes == pytest.approx(12.0 * 10.0 * n / 2.0, rel=0.01)
    turning = load_spacecraft("afrl-12kg")
    anywhere = inspection_bound(turning, task, start, goal, quarter, task.timing)
    assert anywhere == pytest.approx(turning.mass * 10.0 * n / math.sqrt(5.0), rel=0.01)
