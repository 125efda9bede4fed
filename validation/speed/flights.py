"""Closed-loop steps per second of very many flights, of which nothing is kept but what became of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch

from rans.episode.step import Setup
from rans.fast.engine import Engine
from rans.fast.flights import Flights
from rans.fast.learn.beginning import architecture_of
from rans.fast.learn.config import PPOSettings
from rans.fast.machine_code import Products
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.tasks import GoToPose
from validation.speed.measurement import Clock, Measurement

_UNITS = {2: (64, 128, 256), 3: (128,)}
"""Of both layers, by dimension."""
_DUTY = 0.03
"""Share of thrusters that an untrained policy opens, so that nothing spins up."""
_TASK = GoToPose(fail_distance=1e6, fail_spin=1e6)
"""Whoever fails would fly no further, and take less time."""
_FEWEST = 64
"""Flights of the first call: a warp or two of a GPU, too few for any device."""
_GROWTH = 4
"""Each call has so many times the flights of the one before."""
_GAIN = 1.1
"""A device that flies less than a tenth faster with `_GROWTH` times the flights is full."""


def flight_rates(craft: Spacecraft, count: int, clock: Clock) -> Iterator[Measurement]:
    """Of go-to-pose agents before training: whatever their weights, arithmetic takes as long.

    Args:
        craft: what flies.
        count: most flights in one call; fewer fly as fast where the device is full before (`enough`).
        clock: times them on its device; on a CPU they are one process's.
    """
    products: tuple[Products, ...] = ("bf16", "bf16x3", "bf16x6") if clock.on_gpu else ("bf16x3",)
    for units in _UNITS[craft.dimension]:
        settings = PPOSettings(layers=(units, units), zoom=16.0)
        given = architecture_of(Engine(craft, _TASK, 1), settings)
        network = Network.copied(
            given, given.initial(0, _DUTY)[0], torch.device("cpu"), torch.float32
        )
        for way in products:
            flights = Flights(network, Setup(craft, _TASK, Timing()), clock.device, products=way)
            (how,) = flights.fly(0, 1, 0).ways
            flown = enough(
                lambda n, flights=flights: clock.once(lambda: flights.fly(0, n, 0)), count, clock
            )
            seconds, warm_up = clock.time(lambda flights=flights, n=flown: flights.fly(0, n, 0))
            steps = flown * flights.world.timing.episode_steps
            yield Measurement(
                "flights",
                f"{craft.name}, {units}x{units}, {how}",
                steps / seconds / 1e6,
                "M steps/s",
                warm_up,
                f"{flown:,} flights with a policy in the loop",
            )


def enough(took: Callable[[int], float], most: int, clock: Clock) -> int:
    """Number of flights that fills a device, so that their rate is the device's and not that of one call.

    It grows until more flights are no faster each and one call takes as long as a repeat of the clock.

    Args:
        took: seconds of one call of so many flights.
        most: the largest number to return.
        clock: its repeats have a least time.
    """
    count = min(_FEWEST, most)
    took(count)  # compiles
    seconds = took(count)
    while count < most:
        larger = min(_GROWTH * count, most)
        longer = took(larger)
        gain = (larger / longer) / (count / seconds)
        if gain < _GAIN and seconds >= clock.seconds:
            break
        count, seconds = larger, longer
    return count
