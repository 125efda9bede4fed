"""Search over on/off pulses: what it begins with, how it judges a miss, and that it finds a way from one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rans_missions.improve import pulses
from rans_missions.improve.following import MANNERS, Following
from rans_missions.improve.pulses import rounded, shortfall
from rans_missions.improve.search import improve
from rans_missions.script import Script

from rans import GoToPosition, Timing
from rans.episode.flight import Flight, fly
from rans.episode.scenario import Scenario, scenarios
from rans.episode.step import Setup
from rans.evaluation.measure.metrics import impulses
from rans.model.spacecraft_file import load_spacecraft

CRAFT = load_spacecraft("floating-platform")
NEAR = 0.3
"""Distance of the starts from the goal, m: six tolerances."""
TASK = GoToPosition(evaluation_distance=(NEAR, NEAR)).for_evaluation()
SETUP = Setup(CRAFT, TASK, Timing(episode_steps=30))


def starts(count: int) -> Scenario:
    return scenarios(TASK, CRAFT, 2023, count)


def flown(commands: np.ndarray) -> Flight:
    return fly(CRAFT, TASK, Script(commands), starts(commands.shape[1]), SETUP.timing)


@given(st.integers(0, 10_000), st.floats(0.01, 1.0))
def test_pulses_stay_and_their_sums_keep_to_those_of_the_commands(seed, offset):
    """A pulse comes where the sum of commands passes a whole number plus the offset."""
    random = np.random.default_rng(seed)
    pulses = (random.random((40, 3)) < 0.2).astype(float)
    np.testing.assert_array_equal(rounded(pulses, offset), pulses)
    throttled = random.random((40, 3)) * random.random(3)
    found = rounded(throttled, offset)
    assert set(np.unique(found)) <= {0.0, 1.0}
    away = np.cumsum(found, axis=0) - np.cumsum(throttled, axis=0)
    assert -offset - 1e-6 <= away.min()
    assert away.max() <= 1.0 - offset + 1e-6


def test_a_miss_is_measured_in_tolerances_of_the_worst_instant_at_the_end():
    """A craft that rests at six tolerances misses by five, and one that drifts past its goal by more at the end."""
    coast = np.zeros((30, 1, CRAFT.thruster_count))
    assert shortfall(flown(coast))[0][0] == pytest.approx(NEAR / TASK.position_tolerance - 1.0)
    pushed = coast.copy()
    pushed[0, 0] = 1.0
    flight = flown(pushed)
    last = flight.errors()["position"][-6:, 0]
    assert shortfall(flight)[0][0] == pytest.approx(last.max() / TASK.position_tolerance - 1.0)


def test_changes_of_pulses_do_what_they_say():
    """A change takes at most one pulse away, and adds at most one where there was none."""
    random = np.random.default_rng(3)
    flight = (random.random((30, 4)) < 0.1).astype(float)
    for off, on in pulses._changes(flight, random):
        assert off < 0 or flight.flat[off] == 1.0
        assert on < 0 or flight.flat[on] == 0.0
        expected = flight.ravel().copy()
        expected[[place for place in (off,) if place >= 0]] = 0.0
        expected[[place for place in (on,) if place >= 0]] = 1.0
        np.testing.assert_array_equal(
            pulses._changed(flight, np.array([[off, on]])).ravel(), expected
        )


def test_sets_of_changes_lead_to_the_goal_where_effects_add_up():
    """Two of the changes shift a flight to its goal together, and none does alone."""
    random = np.random.default_rng(4)
    count = 300
    effects = random.normal(size=(count, 1, 2))
    was = np.array([[[6.0, 0.0]]])
    effects[17] = [[-3.0, 4.0]]
    effects[203] = [[-3.0, -4.0]]
    flown = [
        pulses._Flown(
            spent=np.full(len(ends), 1.0),
            missed=np.ones(len(ends)),
            when=np.zeros(len(ends), int),
            ends=ends,
            margins=np.ones((len(ends), 1)),
        )
        for ends in (was, was + effects)
    ]
    places = np.arange(2 * count).reshape(count, 2)
    found = pulses._sets(1.0, flown[0], flown[1], places)
    assert any({17, 203} == set(map(int, one)) for one in found)
    assert all(len(set(map(int, one))) == len(one) for one in found)


def test_pulses_follow_a_throttled_flight():
    """A tenth of the thrust one way for two seconds, and back: a coast misses it by twice as much at least."""
    along = np.array(CRAFT.wrenches)[:, 0]
    throttled = np.zeros((30, 1, CRAFT.thruster_count))
    throttled[:10, 0, along > 0.0] = 0.1
    throttled[18:28, 0, along < 0.0] = 0.1
    flight = flown(throttled)
    followed = fly(CRAFT, TASK, Following(CRAFT, flight, MANNERS[0]), starts(1), SETUP.timing)
    assert set(np.unique(followed.commands)) == {0.0, 1.0}
    away, coasted = (
        np.max((one.states.p - flight.states.p).norm())
        for one in (followed, flown(0.0 * throttled))
    )
    assert 2.0 * away < coasted


def test_a_search_finds_pulses_from_a_flight_that_misses_its_goal(monkeypatch):
    """From a coast at rest, six tolerances away."""
    monkeypatch.setattr(pulses, "COPIES", 128)
    coast = np.zeros((30, 1, CRAFT.thruster_count))
    found = improve(SETUP, starts(1), [Script(coast)], rounds=4)
    assert np.isnan(found.before[0])
    assert set(np.unique(found.commands)) <= {0.0, 1.0}
    flight = flown(found.commands)
    assert np.asarray(flight.verdict.solved).all()
    np.testing.assert_allclose(impulses(flight), found.after, rtol=1e-9)
    # A push and one back are the least with which a craft at rest comes to rest elsewhere.
    assert found.after[0] >= 2.0 * 0.2 - 1e-9
