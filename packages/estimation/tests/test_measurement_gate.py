"""Missed and wild readings are replaced by what the engine's own motion brings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from rans import GoToPose, Spacecraft, Timing
from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World, step
from rans.fast.learn.config import FilterSettings
from rans.policy.architecture import Architecture
from rans.tasks.derived import layout
from rans.tasks.observation_terms import AngularVelocity, VectorInW
from tests.support.engines import FLYER, PLATFORM, both_crafts
from tests.support.training import tiny_learner

COUNT = 32
SEED = 5
TASK = GoToPose()
TIMING = Timing()


def policy(craft: Spacecraft) -> Architecture:
    """One filter that trusts the craft as designed, behind a gate."""
    return tiny_learner(craft, filters=FilterSettings((0.1,))).network.architecture


def columns_of(craft: Spacecraft, kind: type) -> slice:
    """Where in a reading this kind's first block stands."""
    start = 0
    for block in layout(TASK, craft.dimension).body.blocks:
        if issubclass(block.kind, kind):
            return slice(start, start + block.width)
        start += block.width
    raise LookupError(kind)


def flown(craft: Spacecraft, steps: int, often: float = 0.03) -> Iterator[tuple[np.ndarray, Any]]:
    """True columns in B of every step, and the random command that answers them."""
    random = np.random.default_rng(1)
    world = World(Setup(craft, TASK, TIMING))
    chosen = scenarios(TASK, craft, SEED, COUNT)
    now = world.begin(chosen.start, chosen.goal)
    body = layout(TASK, craft.dimension)
    for _ in range(steps):
        seen = body.in_body(world.observe(now))
        command = tuple((random.random((len(craft.thrusters), COUNT)) < often).astype(float))
        yield np.array([np.broadcast_to(np.asarray(x, float), COUNT) for x in seen]), command
        now = step(world, now, command).episode


def gated(agent: Architecture, readings: Iterator[tuple[np.ndarray, Any]]) -> list[np.ndarray]:
    """What counts of each reading."""
    memory: Sequence[Any] = [np.zeros(COUNT)] * agent.filtering
    result = []
    for read, command in readings:
        (_, columns), *_ = agent.filtered([*read, *memory])
        result.append(np.array(columns))
        memory = agent.next_filter_memory([*read, *memory, *command])
    return result


@both_crafts
def test_noisy_readings_that_nobody_missed_count_as_they_are(craft):
    random = np.random.default_rng(2)
    readings = [
        (read + random.normal(0.0, 0.01, read.shape), command) for read, command in flown(craft, 40)
    ]
    np.testing.assert_array_equal(
        gated(policy(craft), iter(readings)), [read for read, _ in readings]
    )


@pytest.mark.parametrize(("craft", "what"), [(PLATFORM, "all"), (FLYER, "spin")])
def test_a_missed_reading_is_what_motion_brings(what, craft):
    """Three periods in a row, in the middle of thrust."""
    where = slice(None) if what == "all" else columns_of(craft, AngularVelocity)
    held = dict[int, np.ndarray]()

    def read():
        last = np.zeros(0)
        for k, (now, command) in enumerate(flown(craft, 40, often=0.2)):
            now = now.copy()
            if k in (20, 21, 22):
                now[where] = last[where]
            last = now
            held[k] = now
            yield now, command

    truth = [now for now, _ in flown(craft, 40, often=0.2)]
    found = gated(policy(craft), read())
    error, believed = (
        np.abs(x - truth[22])[columns_of(craft, AngularVelocity)] for x in (found[22], held[22])
    )
    # Gyroscopic torque is left out of what is expected: a few hundredths of rad/s in space in three periods.
    assert error.max() < 0.05 < 0.3 < believed.max()
    velocity = columns_of(craft, VectorInW)
    # Turning is kept to first order within a period.
    assert np.abs(found[22] - truth[22])[velocity].max() < 0.02
    np.testing.assert_allclose(
        found[23], truth[23], rtol=0, atol=1e-9
    )  # rounding of what repeats itself


@both_crafts
def test_a_wild_reading_is_not_believed_and_one_that_stays_is(craft):
    spin = columns_of(craft, AngularVelocity)

    def read(wild):
        for k, (now, command) in enumerate(flown(craft, 40)):
            now = now.copy()
            now[spin] += (1000.0 + 1e-3 * k) * (k in wild)
            yield now, command

    truth = [now for now, _ in flown(craft, 40)]
    once = gated(policy(craft), read([20]))
    assert np.abs(once[20] - truth[20]).max() < 0.02
    np.testing.assert_allclose(
        once[21], truth[21], rtol=0, atol=1e-9
    )  # rounding of what repeats itself
    stays = gated(policy(craft), read(range(20, 40)))
    assert np.abs(stays[21] - truth[21]).max() < 0.05
    # The gate opens by two each time: from 5 x 0.3 rad/s at least, 1,000 pass it after ten readings at most.
    assert np.abs(stays[39] - truth[39])[spin].min() > 999.0


def test_a_perfect_sensor_may_repeat_itself():
    """A craft at rest reads the same for ever, although a wild reading had its filter expect otherwise."""
    rest, _ = next(iter(flown(PLATFORM, 1)))
    spin = columns_of(PLATFORM, AngularVelocity)
    rest[spin] = 0.0
    shut = tuple(np.zeros(COUNT) for _ in PLATFORM.thrusters)
    wild = rest.copy()
    wild[spin] = 1.0  # within the gate: believed
    readings = [rest] * 5 + [wild] + [rest] * 20
    found = gated(policy(PLATFORM), iter([(x, shut) for x in readings]))
    np.testing.assert_array_equal(found[-10:], [rest] * 10)
