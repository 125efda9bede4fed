"""Latency, mass error and sensor noise that an agent tolerates, measured for its export."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rans.episode import Setup
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.stress.effects import effects
from rans.evaluation.stress.outcome import WANTED
from rans.flight import Controller
from rans.model.body import Body
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.parameters import EpisodeParameters, draw
from rans.scenario import draws

SEED = 2028
"""Seed of the starts; no training, selection or evaluation uses it."""
MEASURED = (
    "latency",
    "more mass",
    "less mass",
    "noise of position",
    "noise of attitude",
    "noise of velocity",
    "noise of spin",
)
"""Effects of `rans stress` that a data sheet of a robot answers."""


def measure_margins(controller: Controller, setup: Setup, flights: int) -> dict[str, Any]:
    """Size of each effect up to which an agent holds its goal, everything else as designed.

    All conditions fly in one batch, each with about as many flights as asked for: every episode samples its own.

    Args:
        controller: agent.
        setup: what it is judged in; its conditions do not count.
        flights: flights of each effect's every size.

    Returns:
        By effect: "holds_to", the largest size up to which at every size flown at least 99 % of the flights
        were held (None: not even at the smallest), its "unit", and "held", the share by size. Beside them
        "flights", "nominal" (the share held where everything is as designed) and "seed".
    """
    known = [one for one in effects(setup.craft, setup.timing) if one.name in MEASURED]
    levels = [level for one in known for level in one.levels()]
    every = [Conditions(), *(level.conditions for level in levels)]
    mixed = replace(every[0], others=tuple(every[1:]))
    count = flights * len(every)
    flown = fly_episodes(controller, setup._replace(conditions=mixed), SEED, count, workers=1)
    held = np.asarray(flown.flight.verdict.held)
    numbers = draws(SEED, count)
    drawn = draw(
        mixed, setup.craft, Body.of(setup.craft), setup.timing.episode_steps, numbers.first, numbers
    )
    met = _signatures(drawn, setup, count)
    shares: list[float] = []
    for conditions in every:
        here = np.isclose(met, _signature(conditions), rtol=0.0, atol=1e-6).all(axis=1)
        shares.append(float(held[here].mean()) if here.any() else float("nan"))
    by_level = dict(zip(((one.effect, one.size) for one in levels), shares[1:], strict=True))
    result: dict[str, Any] = {
        "flights": flights,
        "seed": SEED,
        "wanted_share": WANTED,
        "nominal": round(shares[0], 4),
    }
    for one in known:
        of_sizes = [by_level[one.name, size] for size in one.sizes]
        borne = None
        for size, share in zip(one.sizes, of_sizes, strict=True):
            if not share >= WANTED:
                break
            borne = size
        result[one.name] = {
            "unit": one.unit,
            "holds_to": borne,
            "held": {
                f"{size:g}": round(share, 4)
                for size, share in zip(one.sizes, of_sizes, strict=True)
            },
        }
    return result


def _signature(world: Conditions) -> list[float]:
    """What tells one world of a single effect from another: latency, mass and the four kinds of noise."""
    noise = [bounds(sensor.noise)[1] for sensor in world.sensors.each()]
    return [bounds(world.thrusters.latency)[1], bounds(world.body.mass)[1], *noise]


def _signatures(drawn: EpisodeParameters, setup: Setup, count: int) -> np.ndarray:
    """Signatures of the parameters that N episodes drew, (N, 6)."""
    latency = 0.0 if drawn.lag is None else drawn.lag.latency
    mass = drawn.body.mass / setup.craft.mass
    noise: Any = (0.0,) * 4
    if drawn.sensors is not None and drawn.sensors.noise is not None:
        noise = drawn.sensors.noise
    return np.stack([np.broadcast_to(x, count) for x in (latency, mass, *noise)], axis=1)
