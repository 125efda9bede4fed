"""Bounds of final approaches: ranges of arrivals, guidance that flies, and a flight through the corridor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from rans_missions.control.corridor import Corridor
from rans_missions.convex.approach import (
    PortMeeting,
    bound_of_range,
    flight_entering,
    least_to_approach,
)
from rans_missions.convex.rendezvous import (
    least_impulse,
    rendezvous,
    state_of,
)
from rans_missions.script import Script
from rans_missions.tasks import FinalApproach

from rans.episode.drawing import columns
from rans.episode.flight import Flight, fly
from rans.episode.scenario import each, scenarios
from rans.evaluation.measure.metrics import impulses
from rans.model.spacecraft_file import load_spacecraft

CHASER = load_spacecraft("vbar-chaser")
TASK: Any = FinalApproach(spawn_distance=(14.0, 16.0)).for_evaluation()
TIMING = replace(TASK.timing, episode_steps=65)
"""325 s, of which a craft is inside the cone for 225 s at least."""
STARTS = scenarios(TASK, CHASER, seed=5, count=8)
LAST = 650
"""Checks of an episode."""


class Begun(NamedTuple):
    """What begins at one start."""

    meeting: PortMeeting
    state: np.ndarray


@pytest.fixture(scope="module")
def begun() -> list[Begun]:
    return [
        Begun(PortMeeting.at_port(CHASER, TASK, TIMING, one.goal), state_of(one))
        for one in each(STARTS)
    ]


@pytest.fixture(scope="module")
def guided() -> Flight:
    return fly(CHASER, TASK, Corridor(CHASER, TASK), STARTS, TIMING)


def test_guidance_was_as_near_and_as_slow_as_the_bound_assumes(begun, guided):
    assert guided.verdict.solved.all()
    places, speeds = columns(guided.states.p), columns(guided.states.v)
    for k, (meeting, _) in enumerate(begun):
        end = int(guided.lengths[k])
        for periods in range(1, 1 + (len(meeting.away) - 1) // TIMING.checks):
            at = end - periods
            port = meeting.path[at * TIMING.checks]
            # The arrival is at a check of the last period: at most so many checks later.
            ago = periods * TIMING.checks
            assert np.linalg.norm(places[at, k] - port[:3]) <= meeting.away[ago]
            assert np.linalg.norm(speeds[at, k] - port[3:]) <= meeting.hurry[ago]


def test_no_range_of_arrivals_costs_more_than_an_arrival_in_it(begun):
    for meeting, state in begun[:3]:
        of_range = bound_of_range(meeting, state, 500, 560)
        assert of_range > 0.0
        assert all(of_range <= bound_of_range(meeting, state, k, k) for k in (500, 530, 560))


def test_no_guidance_spends_less_than_the_bound(begun, guided):
    """Nor is the bound below that of a rendezvous with the port, which knows no corridor."""
    spent = impulses(guided)
    for k, (meeting, state) in enumerate(begun[:2]):
        bound, end = least_to_approach(meeting, state)
        free = rendezvous(replace(meeting, limits=()), state, TIMING.control_period * 65)
        assert 0.99 * free.lower <= bound < spent[k]
        assert end <= LAST


def test_the_corridor_is_in_the_bound():
    """From 68 m a meeting after 20 minutes costs 30 N s, and one through the corridor more than twice as much."""
    task: Any = FinalApproach().for_evaluation()
    one = next(iter(each(scenarios(task, CHASER, seed=2023, count=1))))
    meeting = PortMeeting.at_port(CHASER, task, task.timing, one.goal)
    free = least_impulse(meeting, state_of(one), 2400)
    assert free is not None
    assert bound_of_range(meeting, state_of(one), 2400, 2400) > 2.0 * free.impulse


@pytest.mark.slow
def test_a_flight_through_the_corridor_docks_in_the_engine(begun):
    """Flown from its start it keeps every limit, and does not spend less than its bound."""
    meeting, state = begun[0]
    found = flight_entering(meeting, state, LAST, 1)
    assert found is not None
    commands = np.zeros((TIMING.episode_steps, 1, 6))
    commands[: len(found.commands), 0] = found.commands
    flight = fly(CHASER, TASK, Script(commands), scenarios(TASK, CHASER, 5, 1), TIMING)
    assert flight.verdict.solved.all()
    assert bound_of_range(meeting, state, LAST, LAST) <= impulses(flight)[0] * (1.0 + 1e-9)
