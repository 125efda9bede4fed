"""Closed-loop steps per second of very many flights, of which nothing is kept but what became of them."""

from __future__ import annotations

from collections.abc import Iterator

import torch

from rans.compile.cuda.flight import Products
from rans.episode import Setup
from rans.fast.engine import Engine
from rans.fast.flights import Flights
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import architecture_of
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


def flight_rates(craft: Spacecraft, count: int, clock: Clock) -> Iterator[Measurement]:
    """Of go-to-pose agents before training: whatever their weights, arithmetic takes as long.

    Args:
        craft: what flies.
        count: flights in one call.
        clock: times them on its device; on a CPU they are one process's.
    """
    products: tuple[Products, ...] = ("bf16", "bf16x3", "bf16x6") if clock.on_gpu else ("bf16x3",)
    for units in _UNITS[craft.dimension]:
        settings = PPOSettings(layers=(units, units), zoom=16.0)
        given = architecture_of(Engine(craft, _TASK, 1), settings)
        network = Network.stacked(
            given, [given.initial(0, _DUTY)[0]], torch.device("cpu"), torch.float32
        )
        for way in products:
            flights = Flights(network, Setup(craft, _TASK, Timing()), clock.device, products=way)
            seconds, warm_up = clock.time(lambda flights=flights: flights.fly(0, count, 0))
            (how,) = flights.fly(0, 1, 0).ways
            steps = count * flights.world.timing.episode_steps
            yield Measurement(
                "flights",
                f"{craft.name}, {units}x{units}, {how}",
                steps / seconds / 1e6,
                "M steps/s",
                warm_up,
                f"{count:,} flights with a policy in the loop",
            )
