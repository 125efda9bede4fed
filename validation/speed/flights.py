"""Closed-loop steps per second of very many flights, of which nothing is kept but what became of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from torch.nn import functional

from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.evaluation.fly.contestants import contestant
from rans.fast.flights import Flights
from rans.fast.kernels.flight import Products
from rans.fast.learn.network import Network
from validation.speed.measurement import Clock, Measurement

_AGENTS = (("go-to-pose-2d-fast", 64), ("go-to-pose-2d-fast", 128), ("go-to-pose-2d", 256),
           ("go-to-position-3d", 128))
"""Of shipped agents, and how many units each of their two layers is given."""


def flight_rates(dimensions: set[int], count: int, clock: Clock) -> Iterator[Measurement]:
    """Of shipped agents, so that flights are those of somebody who has learnt.

    Args:
        dimensions: of the agents to fly, 2 and 3.
        count: flights in one call.
        clock: times them on its device; on a CPU they are one process's.
    """
    for name, units in _AGENTS:
        run = contestant(f"pretrained:{name}")
        if run.craft.dimension in dimensions:
            ways: tuple[Products, ...] = ("bf16", "bf16x3", "bf16x6") if clock.on_gpu else ("bf16x3",)
            for products in ways:
                yield _rate(run, name, units, products, count, clock)


def _rate(run: LoadedRun, name: str, units: int, products: Products, count: int, clock: Clock) -> Measurement:
    assert isinstance(run.controller, Agent)
    flights = Flights(widened(run.controller.network, units), run.judged, clock.device, products=products)
    seconds, warm_up = clock.time(lambda: flights.fly(0, count, 0))
    (way,) = flights.fly(0, 1, 0).ways
    steps = count * run.timing.episode_steps
    return Measurement("flights", f"{name}, {units}x{units}, {way}", steps / seconds / 1e6, "M steps/s",
                       warm_up, f"{count:,} flights of {run.timing.episode_steps} steps")


def widened(network: Network, units: int) -> Network:
    """The same policy with idle units in its two hidden layers, so that both have so many."""
    given, tensors = network.architecture, dict(network.tensors)
    for name, x in tensors.items():
        rows = units - x.shape[0] if ".trunk." in name else 0
        if x.dim() == 2:
            columns = 0 if name.endswith("trunk.0.weight") else units - x.shape[1]
            tensors[name] = functional.pad(x, (0, columns, 0, rows))
        elif rows:
            tensors[name] = functional.pad(x, (0, rows))
    return Network(replace(given, layers=(units,) * len(given.layers)), tensors)
