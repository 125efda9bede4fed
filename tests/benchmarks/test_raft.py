"""RAFT's protocol: what counts as held, what is recoverable, and when faults begin."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.raft import (
    INJECTED,
    Faults,
    degraded,
    drawn,
    flown,
    recoverable,
    succeeded,
)
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.faults import fault_sets

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


def test_faults_in_flight_begin_after_ten_seconds() -> None:
    faults = degraded(4, 8, 8, 0.0, np.random.default_rng(0))
    flight, period = flown("pretrained:go-to-pose-2d", faults, seed=5, after=INJECTED)
    begins = round(INJECTED / period)
    speed = np.hypot(flight.states.v.x, flight.states.v.y)
    assert np.ptp(speed[begins:], axis=0).max() < 1e-12  # nothing pushes any longer
    assert np.ptp(speed[: begins + 1], axis=0).min() > 0.1
