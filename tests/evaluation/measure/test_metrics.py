from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rans.evaluation.measure.aggregate import Metrics, measure
from rans.evaluation.measure.metrics import (
    arrival_times,
    impulses,
    on_times,
    settling_times,
    staying_times,
    worst_errors,
)
from rans.files import plain
from rans.flight import Flight, fly
from rans.model.actuators import Actuators, Pulsed, Throttle
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.scenario import scenarios
from rans.tasks import GoToPose
from tests.support.evaluation_flights import TrackNothing, flight_of, two_episodes
from tests.support.played import Played

# Distances at random, among them many close to the tolerance of 5 cm.
distances = hnp.arrays(
    float,
    st.tuples(st.integers(2, 12), st.integers(1, 4)),
    elements=st.sampled_from([0.001, 0.015, 0.03, 0.049, 0.051, 0.3]),
)


def test_stay_is_lost_beyond_seven_and_a_half_times_the_threshold() -> None:
    """Thresholds of 2 cm and 15 cm: stays; leaves; was far only before; never comes close."""
    distance = np.transpose(
        [[1.0, 0.01, 0.14], [1.0, 0.01, 0.16], [1.0, 0.5, 0.01], [0.1, 0.1, 0.1]]
    )
    assert measure(flight_of(distance, 0.0))["stay 15 cm"].value == 50.0


def test_the_goal_set_by_hand() -> None:
    """Below 5 cm: first at 0.5 s, then lost at 1 s; lost at the end; and never left again."""
    leaves = [1.0, 0.04, 0.06, 0.04, 0.01]
    ends_outside = [1.0, 0.04, 0.04, 0.04, 0.06]
    stays = [1.0, 0.04, 0.04, 0.01, 0.01]
    measured = measure(flight_of(np.transpose([leaves, ends_outside, stays]), 0.0))
    assert measured["first in the goal set"].value == 0.5
    assert measured["stays in the goal set"].value == pytest.approx(100 / 3)


def test_a_flight_that_failed_does_not_stay() -> None:
    """Beyond 8 m the task is lost, whatever follows."""
    flight = flight_of(np.transpose([[9.0, 9.0, 0.01, 0.01]]), 0.0)
    assert arrival_times(flight).tolist() == [1.0]
    assert staying_times(flight).tolist() == [math.inf]


@given(distances)
def test_staying_times_agree_with_a_search(distance: np.ndarray) -> None:
    """Of a craft that never moves nor turns at any instant, rest is being near."""
    flight = flight_of(distance, 0.0)
    assert staying_times(flight).tolist() == settling_times(flight).tolist()
    assert (staying_times(flight) >= arrival_times(flight)).all()


def test_the_last_fifth_of_spins_is_that_of_all_else() -> None:
    """Of 25 steps the last 5 instants count: a spin of 1 rad/s at the first of these alone is 0.2 in the mean."""
    flight = flight_of(np.full((26, 1), 0.01), 0.0)
    spin = np.zeros((26, 1))
    spin[21] = 1.0
    spinning = replace(flight, states=replace(flight.states, w=spin))
    assert measure(spinning)["spin at rest"].value == pytest.approx(0.2)


@given(distances)
def test_settling_times_agree_with_a_search(distance: np.ndarray) -> None:
    flight = flight_of(distance, 0.0)
    for path, found in zip(distance.T, settling_times(flight), strict=True):
        candidates = [k for k in range(len(path)) if (path[k:] < 0.05).all()]
        # Who enters in the last fifth alone is not solved, and has no settling time.
        held = (path[-max(1, (len(path) - 1) // 5) :] < 0.05).all()
        assert found == (0.5 * candidates[0] if held else math.inf)


@given(distances)
def test_order_of_shares(distance: np.ndarray) -> None:
    measured = measure(flight_of(distance, 0.0))
    value = {row.name: row.value for row in measured.rows}
    assert 0.0 <= value["PT1"] <= value["PT2"] <= value["PT5"] <= 100.0
    assert value["reach 1 cm"] <= value["reach 2 cm"]
    assert value["solved"] <= value["solved in the mean"]
    for row in measured.rows:
        assert row.low <= row.high


@pytest.mark.parametrize(("inside", "solved"), [(5, 100.0), (4, 0.0)])
def test_last_fifth_of_25_steps_is_5(inside: int, solved: float) -> None:
    distance = np.ones((26, 1))
    distance[-inside:] = 0.01
    assert measure(flight_of(distance, 0.0))["solved"].value == solved


def test_return_of_resting_at_the_goal() -> None:
    # 1 + 1 and twice 1/2 are 3 a step; 1e-9: rounding of the heading error (1e-16 rad) and ten sums.
    assert measure(flight_of(np.zeros((11, 3)), 0.0))["return"].value == pytest.approx(
        30.0, abs=1e-9
    )


def test_an_episode_that_fails_and_recovers_is_neither_settled_nor_solved() -> None:
    distance = np.full((6, 4), 0.01)
    distance[2, 1] = 8.5  # the task fails beyond 8 m
    measured = measure(flight_of(distance, 0.0))
    assert measured["failed"].value == 25.0
    assert measured["solved"].value == 75.0


def test_shared_supply_halves_two_open_thrusters() -> None:
    commands = np.zeros((4, 1, 8))
    commands[:, 0, :2] = 1.0
    alone = flight_of(np.ones((5, 1)), 0.0, commands)
    craft = alone.craft
    shared = Flight(
        Spacecraft(
            craft.name, 2, craft.mass, craft.inertia, craft.thrusters, thrust_sharing="split"
        ),
        alone.task,
        alone.timing,
        alone.states,
        alone.goals,
        commands,
        "by hand",
    )
    # Two thrusters of 1 N open for 2 s: 4 thruster-seconds; the shared supply gives 1 N in all.
    assert (on_times(alone)[0], impulses(alone)[0]) == (4.0, 4.0)
    assert (on_times(shared)[0], impulses(shared)[0]) == (4.0, 2.0)


def test_a_task_without_pose_is_not_credited_with_one() -> None:
    flight = flight_of(np.ones((6, 2)), 0.0, speed=(0.06, 0.08), spin=0.05, task=TrackNothing())
    measured = measure(flight)
    names = {row.name for row in measured.rows}
    assert not names & {"PT5", "OT5", "position error", "reach 1 cm"}
    # The first moves at 10 cm/s; 0.05 rad/s is 2.9 degrees/s; the second episode rests.
    assert measured["VT5"].value == 50.0
    assert measured["ST5"].value == 100.0
    assert measured["ST2"].value == 50.0
    assert measured["velocity error"].value == pytest.approx(5.0, abs=1e-9)


def test_json_round_trip_with_infinite_values() -> None:
    measured = measure(two_episodes())
    text = json.dumps(plain(measured.to_json()), allow_nan=False)
    assert Metrics.from_json(json.loads(text)) == measured


def test_nan_states_are_never_successes() -> None:
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
def test_grades_of_holding_a_speed(name: str, value: float) -> None:
    """6 cm/s and 5.7 degrees/s all the time."""
    flight = flight_of(np.ones((11, 1)), 0.0, speed=(0.06, 0.0), spin=-0.1, task=TrackNothing())
    assert measure(flight)[name].value == pytest.approx(value)


def test_the_strictest_grade_of_a_spin_is_five_degrees() -> None:
    """0.07 rad/s are 4.0 degrees/s; only 2 degrees/s are missed, which is no grade."""
    flight = flight_of(np.ones((11, 1)), 0.0, spin=0.07, task=TrackNothing())
    assert measure(flight)["solved to 2 cm/s 5 deg/s"].value == 100.0


def test_solved_in_the_mean_by_hand() -> None:
    """The last two of ten steps are 4 and 7 cm away, 5.5 cm in the mean, and 4 and 5.9 cm, 4.95 cm."""
    distance = np.full((11, 2), 0.04)
    distance[-1] = 0.07, 0.059
    assert measure(flight_of(distance, 0.0))["solved in the mean"].value == 50.0


def test_duty_at_rest_is_that_of_the_last_fifth() -> None:
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
def test_effort_is_of_what_valves_give_not_of_commands(
    actuators: Actuators, openings: int, seconds: float
) -> None:
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


def test_spatial_flight() -> None:
    craft = load_spacecraft("free-flyer")
    task = GoToPose(spawn_distance=(3.0, 4.0))

    every_second = Played(np.tile([1.0, 0.0], (10, 5, 8)))
    measured = measure(
        fly(craft, task, every_second, scenarios(task, craft, 0, 5), Timing(episode_steps=10))
    )
    assert measured["duty"].value == 50.0
    assert measured["on-time"].value == pytest.approx(8 * 10 * 0.2)
    assert measured["PT5"].value == 0.0


def test_the_worst_of_a_state_that_was_lost_is_infinite() -> None:
    """Of 10 steps the last two count: up to 4 of 5 cm, and 2.5 of 5 degrees; the second is lost at last."""
    distance = np.full((11, 2), 9.0)
    distance[-2:] = [[0.02, 0.01], [0.04, np.nan]]
    shares, worst = worst_errors(flight_of(distance, 2.5))
    assert shares.tolist() == pytest.approx([0.8, math.inf])
    assert worst["position"].tolist() == pytest.approx([0.04, math.inf])
    assert worst["attitude"].tolist() == pytest.approx([math.radians(2.5)] * 2)
    shares, _ = worst_errors(flight_of(distance, 4.5))
    assert shares.tolist() == pytest.approx([0.9, math.inf])
