"""Everything that is measured, in the order in which it is worth reading."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rans.fast.learn.config import preset
from rans.model.spacecraft import Spacecraft
from rans.tasks import Task
from validation.speed.engine import copy_bandwidth, engine_rate, memory_per_environment
from validation.speed.flights import flight_rates
from validation.speed.latency import latencies
from validation.speed.measurement import Clock, Measurement
from validation.speed.training import LARGE, trainer_rate


@dataclass(frozen=True)
class Effort:
    """How much time to spend."""

    clock: Clock
    compiled: bool | None
    """See `rans.fast.engine.Engine`."""
    calls: int
    """Of an agent."""
    flights: int
    """Most in one call; where fewer fill the device, these are measured."""


def effort(device: str, quick: bool) -> Effort:
    """Enough for figures that repeat within a few per cent on an idle machine, or as little as possible."""
    flights = 2**22 if device != "cpu" else 2**14
    if quick:
        clock = Clock(device, repeats=2, seconds=0.01)
        return Effort(clock, None, calls=50, flights=flights)
    return Effort(Clock(device), True, calls=5000, flights=flights)


def measurements(
    crafts: Sequence[Spacecraft], task_name: str, task: Task, sizes: Sequence[int], spend: Effort
) -> Iterator[Measurement]:
    """Memory, engine, flights, training, agents.

    Args:
        crafts: what flies.
        task_name: gives the trainer's preset.
        task: where to.
        sizes: numbers of environments that the engine steps.
        spend: time and device.
    """
    clock = spend.clock
    bandwidth = copy_bandwidth(clock)
    assert bandwidth.value is not None
    yield bandwidth
    for craft in crafts:
        for num_envs in sizes:
            yield engine_rate(craft, task, num_envs, clock, bandwidth.value, spend.compiled)
            if clock.on_gpu:
                yield engine_rate(craft, task, num_envs, clock, bandwidth.value, generated=False)
        yield memory_per_environment(craft, task, max(sizes), clock)
    for craft in crafts:
        yield from flight_rates(craft, spend.flights, clock)
    for craft in crafts:
        yield trainer_rate(craft, task, preset(task_name, craft.dimension, clock.device), clock)
        if clock.on_gpu:
            yield trainer_rate(craft, task, LARGE, clock)
    for craft in crafts:
        yield from latencies(craft, task, preset(task_name, craft.dimension, "cpu"), spend.calls)
