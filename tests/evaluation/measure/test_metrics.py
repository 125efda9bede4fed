import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from rans import GoToPose
from rans.base.errors import ConfigError
from rans.base.files import plain
from rans.evaluation.measure.aggregate import Metrics, measure
from rans.evaluation.measure.metrics import (
    FURTHER,
    Sample,
    arrival_times,
    impulses,
    settling_times,
    staying_times,
    worst_errors,
)
from rans.model.actuators import Pulsed, Throttle
from tests.support.evaluation_flights import TrackNothing, flight_of, two_episodes

# Distances at random, among them many close to the tolerance of 5 cm.
distances = hnp.arrays(
    float,
    st.tuples(st.integers(2, 12), st.integers(1, 4)),
    elements=st.sampled_from([0.001, 0.015, 0.03, 0.049, 0.051, 0.3]),
)


def test_stay_is_lost_beyond_seven_and_a_half_times_the_threshold():
    """Thresholds of 2 cm and 15 cm: stays; leaves; was far only before; never comes close."""
    distance = np.transpose(
        [[1.0, 0.01, 0.14], [1.0, 0.01, 0.16], [1.0, 0.5, 0.01], [0.1, 0.1, 0.1]]
    )
    assert measure(flight_of(distance, 0.0))["stay 15 cm"].value == 50.0


def test_the_goal_set_by_hand():
    """Below 5 cm: first at 0.5 s, then lost at 1 s; lost at the end; and never left again."""
    leaves = [1.0, 0.04, 0.06, 0.04, 0.01]
    ends_outside = [1.0, 0.04, 0.04, 0.04, 0.06]
    stays = [1.0, 0.04, 0.04, 0.01, 0.01]
    measured = measure(flight_of(np.transpose([leaves, ends_outside, stays]), 0.0))
    assert measured["first in the goal set"].value == 0.5
    assert measured["stays in the goal set"].value == pytest.approx(100 / 3)


def test_a_flight_that_failed_does_not_stay():
    """Beyond 8 m the task is lost, whatever follows."""
    flight = flight_of(np.transpose([[9.0, 9.0, 0.01, 0.01]]), 0.0)
    assert arrival_times(flight).tolist() == [1.0]
    assert staying_times(flight).tolist() == [math.inf]


@given(distances)
def test_settling_times_agree_with_a_search(distance):
    flight = flight_of(distance, 0.0)
    for path, found in zip(distance.T, settling_times(flight), strict=True):
        candidates = [k for k in range(len(path)) if (path[k:] < 0.05).all()]
        # Who enters in the last fifth alone is not solved, and has no settling time.
        held = (path[-max(1, (len(path) - 1) // 5) :] < 0.05).all()
        assert found == (0.5 * candidates[0] if held else math.inf)


@pytest.mark.parametrize(("inside", "solved"), [(5, 100.0), (4, 0.0)])
def test_last_fifth_of_25_steps_is_5(inside, solved):
    distance = np.ones((26, 1))
    distance[-inside:] = 0.01
    assert measure(flight_of(distance, 0.0))["solved"].value == solved


def test_an_episode_that_fails_and_recovers_is_neither_settled_nor_solved():
    distance = np.full((6, 4), 0.01)
    distance[2, 1] = 8.5  # the task fails beyond 8 m
    measured = measure(flight_of(distance, 0.0))
    assert measured["failed"].value == 25.0
    assert measured["solved"].value == 75.0


def test_json_round_trip_with_infinite_values():
    measured = measure(two_episodes())
    text = json.dumps(plain(measured.to_json()), allow_nan=False)
    assert Metrics.from_json(json.loads(text)) == measured


@pytest.mark.parametrize(
    ("metrics", "said"),
    [
        (lambda _: [_gust(0.5)], r"'gust' must .* \(2,\), got shape \(\) "),
        (lambda _: [_gust([0.5])], r"got shape \(1,\)"),
        (lambda _: [_gust(["a", "b"])], "got shape .* type <U1"),
        (lambda _: [_gust(None)], "type object"),
        (lambda _: _gust([1.0, 2.0]), "Sample, got"),
        (len, "TypeError"),
    ],
)
def test_a_metric_of_a_package_is_asked_for_a_number_an_episode(metrics, said, monkeypatch):
    monkeypatch.setattr(FURTHER, "own", {"mine": metrics})
    with pytest.raises(ConfigError, match=f"group of metrics 'mine' cannot be used.*{said}"):
        measure(two_episodes())


def test_a_metric_of_a_package_may_be_a_list_and_not_finite(monkeypatch):
    monkeypatch.setattr(FURTHER, "own", {"mine": lambda _: [_gust([math.nan, 1.0])]})
    assert math.isnan(measure(two_episodes())["gust"].value)


def _gust(values: Any) -> Sample:
    return Sample("motion", "gust", "of the wind", "m/s", values)


def test_nan_states_are_never_successes():
    distance = np.full((6, 2), 0.01)
    distance[3:, 1] = np.nan
    measured = measure(flight_of(distance, 0.0))
    assert measured["solved"].value == 50.0
    assert math.isnan(measured["position error"].value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("solved to 10 cm/s 20 deg/s", 100.0),
        ("solved to 5 cm/s 10 deg/s", 0.0),
        ("solved to 2 cm/s 5 deg/s", 0.0),
        ("velocity error", 6.0),
        ("spin error", math.degrees(0.1)),
        ("speed", 0.06),
        ("spin", 0.1),
    ],
)
def test_grades_of_holding_a_speed(name, value):
    """6 cm/s and 5.7 degrees/s all the time."""
    flight = flight_of(np.ones((11, 1)), 0.0, speed=(0.06, 0.0), spin=-0.1, task=TrackNothing())
    assert measure(flight)[name].value == pytest.approx(value)


def test_solved_in_the_mean_by_hand():
    """The last two of ten steps are 4 and 7 cm away, 5.5 cm in the mean, and 4 and 5.9 cm, 4.95 cm."""
    distance = np.full((11, 2), 0.04)
    distance[-1] = 0.07, 0.059
    assert measure(flight_of(distance, 0.0))["solved in the mean"].value == 50.0


def test_duty_at_rest_is_that_of_the_last_fifth():
    """Ten steps: 8 thrusters open in the seventh and eighth, 2 of 8 in the last."""
    commands = np.zeros((10, 1, 8))
    commands[6:8] = 1.0
    commands[9, 0, :2] = 1.0
    measured = measure(flight_of(np.ones((11, 1)), 0.0, commands))
    assert measured["duty at rest"].value == 12.5
    assert measured["duty"].value == 22.5
    assert measured["openings"].value == 10.0  # the first two close in between


@pytest.mark.parametrize(
    ("actuators", "openings", "seconds"),
    [
        # 0.2 is two counts, one too short; 0.6 ends within its period; 0.96 is all ten counts, and goes on from 1.
        (Pulsed(counts=10, least=3), 4, 0.6 + 0.6 + 1.0 + 1.0 + 1.0),
        # A command below half of the least shuts the thruster: it is lit in periods three to six, and eight.
        (Throttle(least=0.5), 2, 0.6 + 0.6 + 1.0 + 0.96 + 1.0),
        (Throttle(least=0.1), 2, 0.2 + 0.6 + 0.6 + 1.0 + 0.96 + 1.0),
    ],
)
def test_effort_is_of_what_valves_give_not_of_commands(actuators, openings, seconds):
    """One thruster of eight with another duty cycle or level in each of eight periods."""
    commands = np.zeros((8, 1, 8))
    commands[:, 0, 3] = 0.0, 0.2, 0.6, 0.6, 1.0, 0.96, 0.0, 1.0
    flight = flight_of(np.ones((9, 1)), 0.0, commands)
    flight = replace(flight, craft=replace(flight.craft, actuators=actuators))
    measured = measure(flight)
    period = flight.timing.control_period
    force = flight.craft.thrusters[3].force
    assert measured["openings"].value == openings
    assert measured["on-time"].value == pytest.approx(seconds * period)
    assert measured["impulse"].value == pytest.approx(force * seconds * period)
    assert measured["duty"].value == pytest.approx(100.0 * seconds / 64.0)


def test_the_worst_of_a_state_that_was_lost_is_infinite():
    """Of 10 steps the last two count: up to 4 of 5 cm, and 2.5 of 5 degrees; the second is lost at last."""
    distance = np.full((11, 2), 9.0)
    distance[-2:] = [[0.02, 0.01], [0.04, np.nan]]
    shares, worst = worst_errors(flight_of(distance, 2.5))
    assert shares.tolist() == pytest.approx([0.8, math.inf])
    assert worst["position"].tolist() == pytest.approx([0.04, math.inf])
    assert worst["attitude"].tolist() == pytest.approx([math.radians(2.5)] * 2)
    shares, _ = worst_errors(flight_of(distance, 4.5))
    assert shares.tolist() == pytest.approx([0.9, math.inf])


def test_effort_ends_with_a_success():
    """Two thrusters of 1 N are open throughout; the second flight is won after three of ten periods of 0.5 s."""
    commands = np.zeros((10, 2, 8))
    commands[:, :, :2] = 1.0
    flight = flight_of(np.ones((11, 2)), 0.0, commands)
    won = replace(flight, lengths=np.array([10, 3]))
    assert impulses(won).tolist() == pytest.approx([10.0, 3.0])


class Walled(GoToPose):
    def constraints(self, state: Any, goal: Any) -> dict[str, Any]:
        return {"wall": 3.0 - state.p.x}

    def done(self, state: Any, goal: Any) -> Any:
        return state.p.x > 9.0


def test_percentiles_of_a_margin_are_of_its_lower_end():
    """The least margins of 1,000 flights are 1 to 1,000: 99 % keep 10 or more, 90 % keep 100."""
    margins = np.tile(np.random.default_rng(1).permutation(1000) + 1.0, (4, 1))
    margins[:2] += 50.0
    flight = replace(
        flight_of(np.ones((5, 1000)), 0.0, task=Walled()),
        margins={"wall": margins},
        lengths=np.full(1000, 4),
        done=np.zeros(1000, bool),
    )
    measured = measure(flight)
    found = [measured[f"wall {part} %"].value for part in ("50", "90", "99")]
    assert found == pytest.approx([500.0, 100.0, 10.0], abs=1.0)
