"""Missed and wild readings: what filters with a gate take in their place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from rans.episode import Setup, World, step
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.architecture import Architecture
from rans.policy.filter_bank import Filters
from rans.randomization.conditions import Conditions, SensorConditions, SensorsConditions
from rans.scenario import draws, scenarios
from rans.tasks import GoToPose
from rans.tasks.base import observation
from rans.tasks.derived import layout
from tests.support.engines import both_crafts

COUNT = 64
SEED = 5
GATE = 5.0
TIMING = Timing()
TASK = GoToPose(fail_distance=1e3, fail_spin=1e3)


class Seen(NamedTuple):
    """Columns in B of one control period, (columns, N)."""

    told: np.ndarray
    """As sensors have it."""
    counted: np.ndarray
    """As filters take it."""
    true: np.ndarray


def flown(
    craft: Spacecraft,
    sensors: SensorsConditions,
    steps: int,
    often: float = 0.1,
    off: Callable[[int], float] = lambda _: 0.0,
) -> Iterator[Seen]:
    """A flight under random commands, each thruster open so often, with readings of x that are off (m)."""
    seen = layout(TASK, craft.dimension)
    bank = Filters.of(craft, TASK, TIMING.control_period, (0.01,), (0.0,), (2.0,), GATE)
    agent = Architecture(seen, len(craft.thrusters), filters=bank)
    conditions = Conditions(sensors=sensors)
    chosen = scenarios(TASK, craft, SEED, COUNT)
    own = draws(SEED, COUNT)
    world = World(Setup(craft, TASK, TIMING, conditions.or_none))
    now = world.begin(chosen.start, chosen.goal, 0, own)
    memory: Sequence[Any] = [np.zeros(COUNT)] * agent.filtering
    random = np.random.default_rng(SEED)
    for number in range(steps):
        reading = world.sensed(now, own)
        x, *others = reading.p.columns()
        reading = replace(reading, p=type(reading.p)(x + off(number), *others))
        told = wide(seen.in_body(observation(TASK, reading, now.goal)))
        (_, counted), *_ = agent.filtered((*told, *memory))
        true = wide(seen.in_body(observation(TASK, now.state, now.goal)))
        yield Seen(np.array(told), np.array(counted), np.array(true))
        command = tuple((random.random((len(craft.thrusters), COUNT)) < often).astype(float))
        memory = agent.next_filter_memory((*told, *memory, *command))
        now = step(world, now, command, own).episode


def wide(columns: Sequence[Any]) -> list[np.ndarray]:
    return [np.broadcast_to(np.asarray(x, float), COUNT) for x in columns]


def error(columns: Sequence[np.ndarray], flight: Sequence[Seen]) -> float:
    return float(
        np.sqrt(np.mean([(x - one.true) ** 2 for x, one in zip(columns, flight, strict=True)]))
    )


@both_crafts
def test_what_was_missed_is_expected(craft: Spacecraft) -> None:
    noisy = SensorConditions(noise=0.005, dropout=0.4)
    flight = list(flown(craft, SensorsConditions(noisy, noisy, noisy, noisy), 40))
    told, counted = ([getattr(one, name) for one in flight] for name in ("told", "counted"))
    # Readings that are up to several periods old err by what the craft moved; one filter's guess by less.
    assert error(counted, flight) < 0.6 * error(told, flight)
    changed = np.array(told[1:]) != np.array(told[:-1])
    came = np.array(counted[1:]) == np.array(told[1:])
    # What was expected after several missed periods may be so far off that the next reading seems wild.
    assert came[changed].mean() > 0.95, "what sensors told anew counts"


@pytest.mark.slow
@both_crafts
def test_perfect_sensors_are_believed(craft: Spacecraft) -> None:
    """Also where nothing moves, so that every reading is the one before."""
    for often in (0.0, 0.3):
        apart = [
            np.abs(one.told - one.counted).max(axis=0)
            for one in flown(craft, SensorsConditions(), 40, often)
        ]
        # A command whose effect on a quantity is nothing at all looks as if that had been missed.
        assert np.mean(np.array(apart) > 1e-3) < 0.01


@pytest.mark.slow
@both_crafts
def test_wild_readings_count_once_they_stay(craft: Spacecraft) -> None:
    noisy = SensorConditions(noise=0.005)

    def off(number: int) -> float:
        return 10.0 if number == 10 or number >= 20 else 0.0

    flight = flown(craft, SensorsConditions(noisy, noisy, noisy, noisy), 40, off=off)
    apart = np.array([np.linalg.norm(one.told - one.counted, axis=0) for one in flight])
    assert (apart[[10, 20]] > 9.0).all()
    assert (apart[11:20] == 0.0).all()
    # The gate is 0.5 to 0.8 m, and twice as wide for every reading in a row that it kept out.
    assert (apart[26:] == 0.0).all()
