"""Circumnavigation of a target, in a simulation of its own: matrix exponentials, and angles at every point."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from rans_missions.control import circumnavigation
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.convex.inspecting import Burns
from rans_missions.convex.inspection import inspection_bound
from rans_missions.tasks import Inspect
from rans_missions.tasks.inspect import Inspected
from rans_missions.team.task import InspectTeam
from rans_missions.vectors import motion_of

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios
from tests.support.clohessy_wiltshire import transition

DEPUTY = load_spacecraft("afrl-deputy")
TASK = Inspect()
N = TASK.mean_motion
MASS = 12.0
PERIOD = 20.0
STEP = 10.0
"""Time between checks, s."""
END = 12_240.0
"""Length of an episode, s."""

MOVE = transition(N, STEP)


class Flown(NamedTuple):
    """Flights of N craft."""

    finish: np.ndarray
    """When 96 points had been seen, s; infinite: never."""
    spent: np.ndarray
    """Impulse until then, N s."""
    at_last: np.ndarray
    """Impulse of the last 1,000 s, N s."""
    least: np.ndarray
    """Least distance from the target at a check, m."""
    most: np.ndarray
    """Largest one, m."""


def flown(pilot: Any, until: float) -> Flown:
    """Fly a controller from `STARTS`."""
    size = len(STARTS.start.p.x)
    x = motion_of(STARTS.start).T
    sun = np.broadcast_to(STARTS.goal.notes.sun, size)
    normals = np.array(TASK.normals)
    seen = np.zeros((size, 100), bool)
    finish = np.full(size, np.inf)
    spent = np.zeros(size)
    at_last = np.zeros(size)
    least = np.full(size, np.inf)
    most = np.zeros(size)
    pilot.reset(size)
    for k in range(int(until / PERIOD)):
        now = k * PERIOD
        bits = (seen.reshape(size, 5, 20) * 2.0 ** np.arange(20)).sum(axis=2)
        state = SpatialState(
            Vec3(*x[:3]), Quat(1.0, 0.0, 0.0, 0.0), Vec3(*x[3:]), Vec3(0.0, 0.0, 0.0)
        )
        goal = SpatialState(
            Vec3(0.0, 0.0, 0.0),
            Quat(1.0, 0.0, 0.0, 0.0),
            Vec3(0.0, 0.0, 0.0),
            Vec3(0.0, 0.0, 0.0),
            notes=Inspected(sun - N * now, seen.sum(axis=1).astype(float), tuple(bits.T)),
        )
        command = pilot.act(state, goal, np.zeros((size, 1)))
        assert command.min() >= 0.0
        assert command.max() <= 1.0
        impulse = command.sum(axis=1) * PERIOD
        spent += np.where(np.isfinite(finish), 0.0, impulse)
        at_last += impulse * (now >= until - 1_000.0)
        push = (command[:, ::2] - command[:, 1::2]).T / MASS
        for check in (1, 2):
            x = (MOVE @ np.vstack([x, push]))[:6]
            p = x[:3].T
            distance = np.linalg.norm(p, axis=1)
            least = np.minimum(least, distance)
            most = np.maximum(most, distance)
            time = now + check * STEP
            angle = sun - N * time
            towards = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
            way = p[:, None] - 10.0 * normals
            seen |= ((way * normals).sum(axis=2) > 0.0) & (towards @ normals.T > 0.0)
            finish = np.where((seen.sum(axis=1) >= 96) & (finish == np.inf), time, finish)
    return Flown(finish, spent, at_last, least, most)


STARTS = scenarios(TASK, DEPUTY, seed=70, count=4)


def bounds(within: float) -> np.ndarray:
    """Least impulse from every start, N s."""
    both: Any = (STARTS.start, STARTS.goal)
    result = []
    for k in range(4):
        start, goal = map_leaves(lambda x, k=k: float(x[k]) if np.ndim(x) else x, both)
        result.append(inspection_bound(DEPUTY, TASK, start, goal, within, TASK.timing))
    return np.array(result)


@pytest.mark.slow
def test_a_cheap_inspection_is_found_and_left_to_a_safe_orbit() -> None:
    """From every start near the bound: plans of two burns onto an orbit around the target are at 1.56 of it."""
    result = flown(Circumnavigation(DEPUTY, TASK), END + 5_000.0)
    assert result.finish.max() <= 12_240.0
    assert result.spent.mean() < 1.35 * bounds(12_240.0).mean()
    assert np.all(result.spent >= bounds(12_240.0))
    # The ball has a radius of 15 m, the zone ends at 800 m, and nothing needs to be done in the end.
    assert result.least.min() > 15.0
    assert result.most.max() < 800.0
    assert result.at_last.max() < 0.01 * 12.0


def test_a_team_flies_dearer_burns_if_their_coasts_alone_keep_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Abreast of each other both coast through one point within a quarter of an orbit, unless one leaves."""

    def burns(price: float, away: float) -> Burns:
        changes = np.zeros((2, 1, 3))
        changes[:, 0] = [[away, 0.0, 0.0], [0.0, 0.0, 0.01]]
        return Burns(price, np.array([0]), changes, 5_000.0)

    class Searches:
        """Whose flights meet but for the dearest of the longest search."""

        earliest = 1_000.0
        coast = times = None

        def __init__(self, *settings: Any) -> None:
            is_whole = settings[5] == END
            self._flights = [burns(1.0, 0.0), burns(3.0, 0.05)] if is_whole else [burns(2.0, 0.0)]

        def best(self, paths: Any, hops: int, is_safe: Any = lambda one: True) -> Burns:
            return next(filter(is_safe, self._flights), self._flights[0])

    monkeypatch.setattr(circumnavigation, "InspectionSearch", Searches)
    monkeypatch.setattr(Circumnavigation, "_beginnings", lambda *_: [])
    zero = np.zeros(2)
    still = Vec3(zero, zero, zero)
    level = Quat(zero + 1.0, zero, zero, zero)
    state = SpatialState(Vec3(zero, zero - 40.0, np.array([0.0, 30.0])), level, still, still)
    seen = Inspected(zero, zero, tuple(np.zeros((5, 2))))
    pilot = Circumnavigation(DEPUTY, InspectTeam(deputies=2))
    pilot.reset(2)
    change, _ = pilot.velocity_change(state, SpatialState(still, level, still, still, seen), 0.0)
    assert change[0, 0] == pytest.approx(0.05, abs=0.005)
