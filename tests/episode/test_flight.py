"""Flights: bookkeeping by hand, and motion where the answer is known in closed form."""

from __future__ import annotations

import csv
import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from rans import LQR, ConfigError, Timing
from rans.episode.flight import Flight, begin_flight, fly, outran
from rans.episode.scenario import scenarios
from rans.evaluation.measure.metrics import returns
from rans.model.accuracy import fastest
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, Transition, observation_width
from tests.support.evaluation_flights import flight_of


@dataclass
class Recorded:
    """Opens the same thrusters all the time and remembers what it was shown."""

    thrusters: int
    opened: tuple[int, ...] = ()
    resets: list[int] = field(default_factory=list)
    seen: list[np.ndarray] = field(default_factory=list)
    told: list[tuple[Any, Any]] = field(default_factory=list)
    name: str = "recorded"

    def __copy__(self) -> Any:
        return self  # what it keeps is read after the flight

    def reset(self, count: int) -> None:
        self.resets.append(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self.seen.append(observation)
        self.told.append((state, goal))
        command = np.zeros((len(observation), self.thrusters))
        command[:, list(self.opened)] = 1.0
        return command


def test_the_books_of_a_flight(shipped):
    count = 5
    timing = Timing(episode_steps=4)
    task = GoToPose(thrust_weight=0.01)
    pilot = Recorded(len(shipped.thrusters), (0, 1, 2))
    starts = scenarios(task, shipped, seed=1, count=count)
    flight = fly(shipped, task, pilot, starts, timing)
    assert pilot.resets == [count]
    width = observation_width(GoToPose(), shipped.dimension)
    assert [x.shape for x in pilot.seen] == [(count, width)] * 4
    assert {x.dtype for x in pilot.seen} == {np.dtype(np.float32)}
    assert (flight.controller, flight.engine) == ("recorded", "fast")
    np.testing.assert_allclose(flight.times, [0.0, 0.2, 0.4, 0.6, 0.8], rtol=1e-15)
    assert flight.errors()["position"].shape == (5, count)
    paid = flight.rewards()["thrust"]
    np.testing.assert_allclose(paid, np.full((4, count), -0.03), rtol=1e-15)  # three open thrusters
    for step, (state, goal) in enumerate(pilot.told):
        assert goal is flight.goals
        for told, flown in zip(leaves(state), leaves(flight.states), strict=True):
            assert np.array_equal(told, flown[step])
    for start, flown in zip(leaves(starts.start), leaves(flight.states), strict=True):
        assert np.array_equal(start, flown[0])


@dataclass(frozen=True)
class Alive(GoToPose):
    """Pays a plain number for every step."""

    def reward(self, transition: Transition) -> dict[str, Any]:
        return {**super().reward(transition), "alive": 0.5}


def test_a_reward_may_be_a_plain_number():
    craft = load_spacecraft("floating-platform")
    starts = scenarios(GoToPose(), craft, 0, 3)
    with_it, without = (
        fly(craft, task, Recorded(8), starts, Timing(episode_steps=4))
        for task in (Alive(), GoToPose())
    )
    np.testing.assert_allclose(returns(with_it) - returns(without), 4 * 0.5, rtol=1e-13)


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
def test_what_is_no_longer_a_number_has_failed_and_stops_there():
    """The second of three spacecraft is commanded with infinity in the third period."""

    class Overflowing(Recorded):
        def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
            command = super().act(state, goal, observation)
            command[1, 0] = math.inf if len(self.seen) == 3 else 0.0
            return command

    craft = load_spacecraft("floating-platform")
    task = GoToPose()
    pilot = Overflowing(8)
    starts = scenarios(task, craft, 1, 3)
    with pytest.warns(UserWarning, match="1 of 3 flights of floating-platform left every path"):
        flight = fly(craft, task, pilot, starts, Timing(episode_steps=5))
    assert flight.failed().tolist() == [False, True, False]
    gone = [[False, late, False] for late in (False, False, False, True, True, True)]
    shown = leaves(pilot.told[4][0])
    for flown, told, start in zip(leaves(flight.states), shown, leaves(starts.start), strict=True):
        assert np.isnan(flown).tolist() == gone
        assert told[1] == start[1]  # the controller sees its start, not what is no number


PLANAR = load_spacecraft("floating-platform")


def test_a_spin_beyond_the_accuracy_is_reported_with_enough_substeps():
    """Within a period of 0.5 s 0.1 rad are turned, or 50."""
    flight = flight_of([[1.0], [1.0]], 0.0, spin=-0.2)
    timing = Timing(0.5, substeps=1)
    assert outran(flight, timing) == []
    (said,) = outran(flight_of([[1.0], [1.0]], 0.0, spin=-100.0), timing)
    assert "by hand spins floating-platform at up to 100 rad/s" in said
    bound = fastest(flight.craft, timing)
    for times, advised in ((1.2, 2), (2.0, 2), (2.1, 3)):
        (said,) = outran(flight_of([[1.0], [1.0]], 0.0, spin=-(times - 1e-9) * bound), timing)
        assert f"timing.substeps to {advised} or more" in said


def test_flights_off_every_path_are_counted():
    """Within 0.2 s the platform gains 0.3 m/s at most: 1 m away from its path is possible, 100 m are not."""
    timing = Timing(0.2)
    rest = [[1.0, 2.0], [1.0, 2.0], [1.0, 2.0]]
    assert outran(flight_of(rest, 0.0), timing) == []
    assert outran(flight_of([*rest[:2], [1.0, 3.0]], 0.0), timing) == []
    for gone in (100.0, 1e25, -100.0):
        flight = flight_of([*rest[:2], [1.0, gone]], 0.0, task=GoToPose(fail_distance=1e30))
        (said,) = outran(flight, timing)
        assert said.startswith("1 of 2 flights of floating-platform left every path")
    # What happens after a failure, or after a success, is not judged.
    won = flight_of([*rest[:2], [1.0, 100.0]], 0.0, task=GoToPose(fail_distance=1e30))
    ends = {"lengths": np.array([2, 1]), "done": np.array([False, True])}
    assert outran(replace(won, **ends), timing) == []
    failed = [[1.0, 50.0], [1.0, 50.0], [1.0, 1e9]]
    assert outran(flight_of(failed, 0.0), timing) == []


def by_lqr() -> Flight:
    """Two episodes of three periods."""
    starts = scenarios(GoToPose(), PLANAR, 7, 2)
    return fly(PLANAR, GoToPose(), LQR(PLANAR, "go-to-pose"), starts, Timing(episode_steps=3))


def test_an_episode_as_a_table_with_units(tmp_path):
    """The second of two episodes, read by the standard library; an open thruster is held from its row on."""
    flight = by_lqr()
    with flight.to_csv(tmp_path / "flight.csv", 1).open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t (s)"]) for row in rows] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    np.testing.assert_allclose(
        [float(row["v_y (m/s)"]) for row in rows], flight.states.v.y[:, 1], atol=1e-8
    )
    held = [[float(row[f"u_{k}"]) for k in range(8)] for row in rows]
    np.testing.assert_array_equal(held[:3], flight.commands[:, 1])
    assert held[3] == [0.0] * 8
    with pytest.raises(ConfigError, match="episode must be >= 0 and < 2, got 2"):
        flight.to_csv(tmp_path / "flight.csv", 2)
    nothing: Any = None
    with pytest.raises(ConfigError, match="a file"):
        flight.to_csv(nothing)


def test_who_reads_states_alone_is_given_no_columns():
    widths = []

    class Reading:
        name = "reading"
        observes = True

        def reset(self, count: int) -> None: ...

        def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
            widths.append(observation.shape)
            return np.zeros((len(observation), 8))

    class Blind(Reading):
        observes = False

    platform = load_spacecraft("floating-platform")
    starts = scenarios(GoToPose(), platform, 7, 3)
    flights = [
        fly(platform, GoToPose(), one, starts, Timing(episode_steps=2))
        for one in (Reading(), Blind())
    ]
    width = observation_width(GoToPose(), 2)
    assert widths == [(3, width)] * 2 + [(3, 0)] * 2
    np.testing.assert_array_equal(flights[0].states.p.x, flights[1].states.p.x)


class Held(NamedTuple):
    part: Any
    name: str = "held"


class Remembering:
    def __init__(self, part: Any = None) -> None:
        self.part = part
        self.counts: list[int] = []

    def reset(self, count: int) -> None:
        self.counts.append(count)


@pytest.mark.parametrize(
    ("hold", "held"),
    [
        (lambda part: part, lambda part: part),
        (lambda part: (part,), lambda part: part[0]),
        (lambda part: (1, Held(part)), lambda part: part[1].part),
        (lambda part: [part], lambda part: part[0]),
        (lambda part: {"a": part}, lambda part: part["a"]),
        (lambda part: deque([part]), lambda part: part[0]),
        (lambda part: part.reset, lambda part: part.__self__),
        (lambda part: Remembering((part,)), lambda part: part.part[0]),
    ],
    ids=["itself", "tuple", "named tuple", "list", "dict", "deque", "method", "part of a part"],
)
def test_flights_share_no_memory_wherever_a_controller_holds_it(hold, held):
    memory = Remembering()
    controller: Any = Remembering(hold(memory))
    flown: list[Any] = [begin_flight(controller, 2) for _ in range(2)]
    one, other = (held(flight.part) for flight in flown)
    one.reset(5)
    assert (one.counts, other.counts, memory.counts) == ([5], [], [])
