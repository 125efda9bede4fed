"""How far flights by value are from the certified front: ``python -m campaigns front [--starts 9]``.

The front of a start is the least impulse of any on/off controller by the number of control periods until it is in
the goal set. The factor of a flight is the number by which its time and its impulse may both be divided until they
are on the front, which is linear between two numbers of periods. Lower bounds stand for the front, so that no
factor is too small. A start takes about six minutes of one processor.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache

import numpy as np
from rans_bounds.problem import SearchEffort
from rans_bounds.starts import bound, question

from campaigns.command import ended
from rans.api.agent import load_agent
from rans.episode.flight import Flight
from rans.episode.scenario import EVALUATION_SEED, scenario
from rans.evaluation.compare.bounds import Event
from rans.evaluation.measure.metrics import arrival_times

_TRADE_OFFS = [x / 12 for x in range(13)]
_NAME = "value:go-to-pose-priced-2d@floating-platform#"


def factor(time: float, impulse: float, period: float, least: Callable[[int], float]) -> float:
    """Factor of a flight, s and N s, to the front of least impulse (N s) by the number of control periods.

    The impulse of the flight, reduced as its time is, is below the front at one number of periods and not at the
    next.
    """

    def above(count: int) -> float:
        return impulse * count * period / time - least(count)

    count = max(1, round(time / period / 1.05))
    while above(count) > 0.0:
        count -= 1
    while above(count + 1) <= 0.0:
        count += 1
    low = above(count)
    part = -low / (above(count + 1) - low) if math.isfinite(low) else 1.0
    return time / (period * (count + part))


def factors(start: int, flights: list[tuple[float, float]]) -> list[float]:
    """Factors of flights, (s, N s), from a start."""
    agent = load_agent(f"{_NAME}0")
    task = agent.task.for_evaluation()
    begun = scenario(task, agent.craft.dimension, EVALUATION_SEED, start)
    period = agent.timing.control_period

    @cache
    def least(count: int) -> float:
        event = Event("arrival", count * period)
        asked = question(agent.craft, task, period, event, SearchEffort(), begun)
        return bound(start, asked).best

    return [factor(*flight, period, least) for flight in flights]


def _until_arrival(flight: Flight) -> list[tuple[float, float]]:
    """Time (s) and impulse (N s) until each flight is first in the goal set."""
    period = flight.timing.control_period
    forces = np.array([thruster.force for thruster in flight.craft.thrusters])
    arrival = arrival_times(flight)
    periods = np.arange(len(flight.commands))[:, None] * period
    spent = (flight.commands @ forces * period * (periods < arrival - period / 2)).sum(axis=0)
    return list(zip(arrival.tolist(), spent.tolist(), strict=True))


def main(arguments: list[str]) -> int:
    """Fly and print the factors of every trade-off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=9)
    count = parser.parse_args(arguments).starts
    flown = [_until_arrival(load_agent(f"{_NAME}{x:.4f}").fly(count)) for x in _TRADE_OFFS]
    with ProcessPoolExecutor() as pool:
        found = np.array([*pool.map(factors, range(count), zip(*flown, strict=True))])
    for trade_off, flights, column in zip(_TRADE_OFFS, flown, found.T, strict=True):
        time, impulse = np.mean(flights, axis=0)
        text = f"#{trade_off:.2f}: {time:.2f} s, {impulse:.2f} N s"
        print(f"{text}, factor {column.mean():.3f}, at most {column.max():.3f}")  # noqa: T201
    print(f"{count} starts, all trade-offs: {found.mean():.3f}, at most {found.max():.3f}")  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(ended("python -m campaigns front", lambda: main(sys.argv[1:])))
