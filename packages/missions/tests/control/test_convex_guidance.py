"""Guidance by convex programs: it keeps limits, and finds back to its way."""

from __future__ import annotations

import pytest
from rans_missions.bounds.first_starts import mission_bounds
from rans_missions.control.convex_guidance import ConvexGuidance, _tightened
from rans_missions.tasks import Dock

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.compare.contest import Contest
from rans.evaluation.measure.metrics import impulses, won
from rans.model.fields import Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks.shapes import Ball, Cone, SpeedLimit

DEPUTY = load_spacecraft("afrl-deputy")


X, ZERO = Vec2(1.0, 0.0), Vec2(0.0, 0.0)


@pytest.mark.parametrize(
    "limit",
    [Ball(ZERO, ZERO, 1.0), Cone(ZERO, X, 0.5, 9.0), SpeedLimit(ZERO, 0.5, 0.1)],
    ids=lambda limit: type(limit).__name__,
)
def test_a_reserve_makes_every_limit_tighter(limit):
    """What keeps the tighter limit keeps the limit with room to spare."""
    place, velocity = Vec2(2.0, 0.9), Vec2(0.3, 0.4)
    assert 0.0 < _tightened(limit, 0.1).gap(place, velocity) < limit.gap(place, velocity)


@pytest.mark.slow
def test_it_docks_below_the_speed_limit_near_the_bound():
    task = Dock(deadline=(700.0, 700.0))
    starts = scenarios(task, DEPUTY, 7, 4)
    kept = fly(DEPUTY, task, ConvexGuidance(DEPUTY, task), starts, task.timing)
    assert won(kept).all()
    *_, bounds = mission_bounds(Contest(DEPUTY, task, task.timing, 7, 4), 4)
    ratios = impulses(kept) / bounds.lower
    assert (ratios >= 1.0).all()
    assert ratios.mean() < 1.02
