"""Bounds of landings beside the flights of a comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rans_missions.bounds.first_starts import bounded, mission_bounds
from rans_missions.bounds.mission_bounds import MissionBounds
from rans_missions.tasks.land import Land

from rans import BodyConditions, Conditions, ConfigError, FaultConditions, GoToPose
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.controllers import default_opponents
from rans.evaluation.measure.metrics import propellant_used
from rans.model.spacecraft_file import load_spacecraft

CRAFT = load_spacecraft("mars-lander-steered")
TASK = Land()
CONTEST = Contest(CRAFT, TASK, TASK.timing, seed=9, episodes=1)


@pytest.fixture(scope="module")
def bounds() -> MissionBounds:
    (found,) = mission_bounds(CONTEST, 1)
    return found


@pytest.mark.slow
def test_the_agent_is_near_its_bound_and_not_below(bounds):
    agent = contestant("pretrained:land-3d").controller
    entry = Entry(Contestant("agent", agent, "state", "none"), CONTEST.fly(agent, workers=1))
    over = bounds.over(entry)
    assert over.shape == (1,)
    assert np.all((over > 1.0) & (over < 1.06))
    assert bounds.impossible([entry]) == []
    wrong = replace(bounds, lower=1.001 * propellant_used(entry.flight))
    (sentence,) = wrong.impossible([entry])
    assert "agent beats the certified least propellant" in sentence
    headings, rows = bounds.table([entry])
    assert headings == ("start", "least propellant, kg", "agent")
    assert [row[0] for row in rows] == ["0"]
    assert f"({over[0]:.3f})" in rows[0][2]


@pytest.mark.slow
def test_a_dead_engine_takes_more():
    """On a short way."""
    short = 300.0, 300.0
    task = Land(start_altitude=short, start_distance=short, start_descent=(30.0, 30.0))
    near = replace(CONTEST, task=task)
    dead = Conditions(faults=FaultConditions(kinds=("dead",), thrusters=(0,)))
    (without,) = mission_bounds(replace(near, conditions=dead), 1)
    (whole,) = mission_bounds(near, 1)
    assert without.lower[0] > 1.05 * whole.lower[0] > 0.0


def test_landings_have_bounds_where_nothing_is_drawn():
    assert bounded(CONTEST)
    assert not bounded(replace(CONTEST, conditions=Conditions()))
    dead = Conditions(faults=FaultConditions(kinds=("dead",), thrusters=(0,)))
    assert bounded(replace(CONTEST, conditions=dead))
    assert not bounded(replace(CONTEST, conditions=replace(dead, body=BodyConditions(mass=1.1))))
    with pytest.raises(ConfigError, match="no lander"):
        bounded(replace(CONTEST, craft=replace(CRAFT, propellant=None)))
    assert default_opponents(TASK) == ("optimal",)
    assert "lqr" in default_opponents(GoToPose())
