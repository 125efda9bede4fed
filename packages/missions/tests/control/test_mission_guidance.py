"""Guidance that missions on an orbit recommend, and agents that have learnt nothing, which fly it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.tasks import Dock, Hold, Rendezvous
from rans_missions.tasks.orbital import OrbitalMission

from rans import (
    Conditions,
    ThrusterConditions,
    Timing,
)
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import impulses, won
from rans.model.actuators import Pulsed
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import fly_in_drake

DEPUTY = load_spacecraft("afrl-deputy")
CHASER = load_spacecraft("vbar-chaser")


def coarse(task: OrbitalMission) -> Timing:
    """One substep: orbits are exact with any number, and these craft turn slowly."""
    return replace(task.timing, substeps=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "craft", "count"),
    [
        # By the shortest deadlines: below the speed limit, and from all sides around the ball.
        (Dock(deadline=(600.0, 600.0)), DEPUTY, 64),
        (Hold(deadline=(600.0, 600.0)), CHASER, 12),
        # Whoever takes the cheapest transfer leaves the cone from a tenth to a half of the starts.
        (Rendezvous(deadline=(4000.0, 4000.0)), load_spacecraft("arpod-chaser"), 4),
    ],
    ids=["dock", "hold", "rendezvous"],
)
def test_it_arrives_within_all_limits_and_drake_flies_the_same(task, craft, count):
    ours, drake = (
        flying(craft, task, MissionGuidance(craft, task), starts, coarse(task))
        for flying, starts in (
            (fly, scenarios(task, craft, 7, count)),
            (fly_in_drake, scenarios(task, craft, 7, 1)),
        )
    )
    assert won(ours).all()
    assert won(drake).all()
    np.testing.assert_allclose(impulses(drake), impulses(ours)[:1], rtol=1e-5)


def test_noise_of_thrusts_is_as_uncertain_as_their_range():
    """A uniform distribution over s sqrt(3) on either side of the mean has the standard deviation s."""
    task = Dock()
    deviation = 0.1
    ends = (1.0 - deviation * math.sqrt(3.0), 1.0 + deviation * math.sqrt(3.0))
    flying = scenarios(task, DEPUTY, 7, 4)
    commands = []
    for thrusters in (ThrusterConditions(noise=deviation), ThrusterConditions(thrust=ends)):
        guidance = MissionGuidance(DEPUTY, task, conditions=Conditions(thrusters=thrusters))
        guidance.reset(4)
        commands.append(
            [guidance.act(flying.start, flying.goal, np.zeros((4, 0))) for _ in range(3)]
        )
    # Searches for the best arrival are exact to the root of the rounding only.
    np.testing.assert_allclose(commands[0], commands[1], rtol=0.0, atol=1e-5)


def test_burns_are_rounded_down_to_whole_pulses():
    """Of starts so far below the speed limit that the reserve below it makes no difference."""
    pulsed = replace(DEPUTY, actuators=Pulsed(counts=100))
    task = Dock(deadline=(2000.0, 2000.0), start_speed=(0.0, 0.1))
    starts = scenarios(task, DEPUTY, 3, 100)
    wanted, given = (
        100.0 * MissionGuidance(craft, task).act(starts.start, starts.goal, np.zeros((100, 0)))
        for craft in (DEPUTY, pulsed)
    )
    np.testing.assert_allclose(given, np.round(given), atol=1e-9)
    assert np.all(given <= wanted)
    assert np.all(wanted - given < 1.0)


def test_what_a_page_computes_is_what_it_flies():
    guidance = MissionGuidance(DEPUTY, Dock())
    starts = scenarios(Dock(), DEPUTY, 1, 5)
    guidance.reset(5)
    given = guidance.act(starts.start, starts.goal, np.zeros((5, 1)))
    np.testing.assert_array_equal(np.transpose(guidance.command(starts.start, starts.goal)), given)
