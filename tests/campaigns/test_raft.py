"""RAFT's protocol: what counts as held, what is recoverable, and when faults begin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from campaigns.raft import (
    CONTESTANTS,
    INJECTED,
    TASK,
    TIMING,
    Faults,
    degraded,
    drawn,
    flown,
    possible,
    ready,
    recoverable,
    succeeded,
)
from campaigns.raft_oracle import DIRECTIONS, Oracle, balanced_reach, effects
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.model.body import Body
from rans.model.dynamics import wrench
from rans.model.fields import leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.faults import fault_sets
from rans.scenario import scenarios

PLATFORM = load_spacecraft("floating-platform")


def test_held_means_every_instant_of_five_seconds() -> None:
    """At 5 Hz 25 instants: one flight has them, one leaves once in the middle, one comes too late."""
    distance = np.full((60, 3), 1.0)
    distance[10:35, 0] = 0.04
    distance[10:50, 1] = 0.04
    distance[30, 1] = 0.06
    distance[36:, 2] = 0.0
    assert succeeded(distance, 0.2).tolist() == [True, False, False]
    distance[35, 2] = 0.0
    assert succeeded(distance, 0.2).tolist() == [True, False, True]


@pytest.mark.parametrize(("kind", "leak"), [("dead", 0.0), ("stuck-open", 1.0)])
def test_recoverable_pairs_are_those_of_rans_faults(kind: str, leak: float) -> None:
    sets = list(fault_sets(PLATFORM, 2, kind))  # type: ignore[arg-type]
    gain = np.ones((len(sets), 8))
    leaks = np.zeros((len(sets), 8))
    for row, one in enumerate(sets):
        gain[row, list(one.thrusters)] = 0.0
        leaks[row, list(one.thrusters)] = leak
    found = recoverable(PLATFORM, Faults(gain, leaks))
    assert found.tolist() == [one.recoverable for one in sets]
    assert found.sum() == 16  # of 28


def test_a_weak_thruster_is_no_dead_one_and_a_wheel_helps() -> None:
    random = np.random.default_rng(0)
    assert recoverable(PLATFORM, degraded(8, 8, 4, 0.2, random)).all()
    dead = degraded(64, 8, 4, 0.0, random)
    bare = recoverable(PLATFORM, dead)
    with_wheel = recoverable(load_spacecraft("roboran-platform"), dead)
    assert (with_wheel | ~bare).all()  # never less
    assert with_wheel.sum() > bare.sum()


def test_drawn_faults_are_of_the_three_kinds() -> None:
    faults = drawn(500, 8, 3, np.random.default_rng(1))
    failed = (faults.gain < 1.0) | (faults.leak > 0.0)
    assert (failed.sum(axis=1) == 3).all()
    stuck = faults.leak > 0.0
    assert faults.leak[stuck].min() >= 0.1
    assert (faults.gain[stuck] == 0.0).all()
    dead = failed & ~stuck & (faults.gain == 0.0)
    # Of 1,500 failures; four standard deviations of a third are 0.049.
    assert [stuck.sum() / 1500, dead.sum() / 1500] == pytest.approx([0.34, 0.33], abs=0.049)


@pytest.mark.slow
def test_faults_in_flight_begin_after_ten_seconds() -> None:
    faults = degraded(4, 8, 8, 0.0, np.random.default_rng(0))
    craft = load_spacecraft("floating-platform-shared")
    starts = scenarios(TASK, craft, 5, 4)
    who = contestant("pretrained:go-to-position-2d-shared").controller
    flight = flown(craft, who, starts, faults, INJECTED)
    begins = round(INJECTED / TIMING.control_period)
    speed = np.hypot(flight.states.v.x, flight.states.v.y)
    assert np.ptp(speed[begins:], axis=0).max() < 1e-12  # nothing pushes any longer
    assert np.ptp(speed[: begins + 1], axis=0).min() > 0.1


def faults_of(gain: list[float], leak: list[float]) -> Faults:
    return Faults(np.array([gain]), np.array([leak]))


def test_what_is_possible() -> None:
    """Of the platform's eight thrusters those of even and odd numbers turn it opposite ways."""
    craft = load_spacecraft("floating-platform-shared")
    sound = faults_of([1.0] * 8, [0.0] * 8)
    assert possible(craft, sound).tolist() == ["still"]
    torques = np.array(craft.wrench_map)[:, 2]
    one_way = [float(torque > 0.0) for torque in torques]
    assert sum(one_way) == 4
    # What is left turns it one way only: it can neither stop nor keep its spin.
    assert possible(craft, faults_of(one_way, [0.0] * 8)).tolist() == ["neither"]
    # A wheel of 0.1 N m balances a little of it.
    assert possible(load_spacecraft("roboran-platform"), faults_of(one_way, [0.0] * 8)) == "still"
    # Three sound thrusters that turn it both ways, and push to one side only.
    three = [0.0] * 8
    for i in (0, 1, 2):
        three[i] = 1.0
    assert possible(craft, faults_of(three, [0.0] * 8)).tolist() == ["spinning"]


def test_what_the_oracle_knows_is_what_the_craft_does() -> None:
    craft = load_spacecraft("floating-platform-shared")
    faults = drawn(3, 8, 4, np.random.default_rng(3))
    found = effects(craft, faults.gain, faults.leak)
    random = np.random.default_rng(0)
    for row in range(3):
        body = Body.of(craft)
        body = type(body)(
            body.mass,
            body.inertia,
            body.centre,
            tuple(faults.gain[row].tolist()),
            tuple(faults.leak[row].tolist()),
        )
        number = int(random.integers(256))
        opened = [float(number >> i & 1) for i in range(8)]
        given = wrench(craft, opened, body)
        scale = [craft.mass, craft.mass, craft.inertia[2][2]]
        assert found[row, number] == pytest.approx(np.array(leaves(given)) / scale, abs=1e-12)


def test_balanced_reach_by_hand() -> None:
    """Pushes of 1 m/s^2: along x without a turn, upwards with turns either way, downwards with one."""
    square = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0.5], [0, 1.0, -1.0], [0, -1.0, 0.2]])
    reach = balanced_reach(square)
    assert len(reach) == DIRECTIONS
    assert reach[0] == pytest.approx(1.0)
    assert reach[DIRECTIONS // 4] == pytest.approx(
        1.0
    )  # two thirds of one and a third of the other
    # Down with 0.2, made up for by an upward push of -1: (1 * -1 + 0.2 * 1) / 1.2.
    assert reach[3 * DIRECTIONS // 4] == pytest.approx(0.8 / 1.2)
    assert balanced_reach(square, wheel=0.2)[3 * DIRECTIONS // 4] == pytest.approx(1.0)
    assert np.isneginf(balanced_reach(square[2:3])).all()


def test_the_oracle_holds_what_it_can() -> None:
    craft = load_spacecraft("floating-platform-shared")
    faults = drawn(12, 8, 1, np.random.default_rng(8))
    starts = scenarios(TASK, craft, 8, 12)
    flight = flown(craft, Oracle(craft, faults.gain, faults.leak, 0), starts, faults, 0.0)
    held = succeeded(np.asarray(flight.errors()["position"]), TIMING.control_period)
    assert held.mean() > 0.8


def test_an_agent_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"train it with rans train campaigns/raft_recipes/"):
        ready(CONTESTANTS[0], tmp_path, drawn(1, 8, 0, np.random.default_rng(0)), 0.0)
