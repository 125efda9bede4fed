"""Search for the smallest disturbance that makes an agent fail."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr

from rans.extend import (
    Conditions,
    ConfigError,
    Controller,
    Failure,
    Flight,
    Progress,
    Setup,
    World,
    fly_draws,
    unseen,
    worst_errors,
)
from rans.model.random import generator
from rans_assurance.assure.chances import Chances, Chosen, Sized, sized
from rans_assurance.assure.replay import Judge, ending, failure_kinds, has_drake, picked
from rans_assurance.scope import drawn_texts

_LARGEST = 2.0
"""Largest size that is searched."""
_ROUNDS = 20
_COUNT = 2048
FLIGHTS = _ROUNDS * _COUNT
"""Number of flights of a search."""
_BEST = 0.1
"""Share of a round to which the next round's distribution is fitted."""
_KEPT = 0.3
_NARROWEST = 0.05
_CANDIDATES = 64
_DRAKE = 8
"""Number of the smallest failures that are flown again in Drake."""

Sizes = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Scores (N,) of normal numbers (D, N), numbers (N,) of episodes and sizes (N,): the largest error of the last
fifth in tolerances, from 1 on a flight is not solved; infinite where it failed (`rans.verdict`)."""


@dataclass(frozen=True)
class Candidate:
    """A flight that failed in a search."""

    size: float
    z: np.ndarray
    """Standard normal numbers (D,) of its draws."""
    number: int
    """Number of the episode, from which the random numbers of sensors follow."""


@dataclass(frozen=True)
class Breaking:
    """The smallest disturbance that was found to make the agent fail."""

    conditions: Conditions
    """Conditions that are the unit of the size."""
    size: float
    """Size of the disturbance; 1 is the full range of the conditions."""
    again: dict[Judge, Failure | None]
    """Kind of failure in each engine."""
    excess: float
    """Largest error of the last fifth in NumPy, in tolerances."""
    ending: str
    drew: dict[str, str]
    """Values of its draws, by name."""
    units: list[float]
    """Uniform numbers of its draws, for `Chances.draws`."""
    number: int
    """Number of the episode, from which the random numbers of sensors follow."""
    flight: Flight
    """The flight in NumPy."""


@dataclass(frozen=True)
class Searched:
    """Result of a search."""

    world: str
    """Name or file of the conditions."""
    largest: float
    """Largest size that was searched."""
    flights: int
    failed: int
    """Number of flights that failed."""
    breaking: Breaking | None
    """Smallest disturbance that makes the agent fail again in float64; None: there is none."""

    @property
    def summary(self) -> str:
        """Result of the search in one sentence, for the page and the terminal."""
        if self.breaking is None:
            return (
                f"no disturbance was found up to {self.largest:g} times the size of {self.world} that "
                f"makes it fail, in {self.flights:,} flights"
            )
        return (
            f"the smallest disturbance found that makes it fail is {self.breaking.size:.3g} times the "
            f"size of {self.world}, in {self.flights:,} flights; a smaller one is not ruled out"
        )

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.files.write_json`.

        "up to" and "size" are multiples of the conditions that "unit" names. "excess" is in tolerances. "drew" has
        the draws in words, and "units" the uniform numbers from 0 to 1 that `Chances.draws` makes them of.
        """
        result = self.breaking
        return {
            "unit": self.world,
            "up to": self.largest,
            "flights": self.flights,
            "failed": self.failed,
            "text": self.summary,
            "smallest": result
            and {
                "size": result.size,
                "drew": result.drew,
                "excess": result.excess,
                "ending": result.ending,
                "units": result.units,
                "number": result.number,
                "again": {
                    judge: kind.name if kind else None for judge, kind in result.again.items()
                },
            },
        }


def check_search(world: str, conditions: Conditions, controller: Controller) -> None:
    """Refuse a search that cannot be, before anything flies.

    Args:
        world: name of the conditions, for the message.
        conditions: conditions whose ranges would be the unit of disturbances.
        controller: what would fly.

    Raises:
        ConfigError: they are a mixture or nominal, which have no size, or the controller is slow.
    """
    if getattr(controller, "slow", False):
        raise ConfigError(
            f"the search for the worst case flies {FLIGHTS:,} times, which takes {controller.name} "
            "too long."
        )
    if conditions.others or conditions.or_none is None:
        raise ConfigError(
            f"--search {world} gives no unit of disturbance: it must be conditions that are no "
            "mixture and not perfect, such as lab."
        )


def searched(
    world: str,
    conditions: Conditions,
    controller: Controller,
    setup: Setup,
    seed: int,
    progress: Progress = unseen,
) -> Searched:
    """Search over starts and conditions within bounds; flights that fail are flown again for confirmation.

    Args:
        world: name of the conditions.
        conditions: conditions whose ranges are the unit; draws of these and of the start are searched.
        controller: agent or any controller.
        setup: setup of the flights.
        seed: seed of the search.
        progress: reports flights.
    """
    chances = Chances.of(setup._replace(conditions=sized(conditions)))

    def score(z: np.ndarray, number: np.ndarray, size: np.ndarray) -> np.ndarray:
        # A state that is no longer finite continues and may overflow.
        with np.errstate(all="ignore"):
            own = chances.draws(ndtr(z), number, size)
            flight = fly_draws(controller, chances.setup, own)
            return np.where(flight.verdict.failed, np.inf, worst_errors(flight)[0])

    largest = min(_LARGEST, room(conditions))
    result = smallest(score, len(chances.places), largest, generator(seed), progress)
    return Searched(
        world,
        largest,
        FLIGHTS,
        len(result),
        _confirmed(chances, conditions, controller, result[:_CANDIDATES]),
    )


def room(conditions: Conditions) -> float:
    """Largest size of a disturbance that leaves mass, inertia and thrust well above zero."""
    body = conditions.body
    thrusters = conditions.thrusters
    least = min(
        Sized.of(x, 1.0)[0] for x in (body.mass, body.inertia, thrusters.thrust, thrusters.pressure)
    )
    return 0.9 / (1.0 - least) if least < 1.0 else math.inf


def smallest(
    score: Sizes,
    dimensions: int,
    largest: float,
    random: np.random.Generator,
    progress: Progress,
) -> list[Candidate]:
    """Failed flights by size, from the cross-entropy method (Rubinstein and Kroese, 2004).

    The distribution of each round is fitted to the best tenth of the one before: flights that fail, the smallest
    first, then those with the highest scores.
    """
    mean = np.zeros((dimensions + 1, 1))
    spread = np.ones((dimensions + 1, 1))
    results: list[Candidate] = []
    for _ in range(_ROUNDS):
        z = mean + spread * random.standard_normal((dimensions + 1, _COUNT))
        size = largest * ndtr(z[-1])
        # Of episodes that no campaign flies.
        number = random.integers(2**31, size=_COUNT, dtype=np.int32)
        scores = score(z[:-1], number, size)
        price = np.where(scores >= 1.0, size, largest * (2.0 - np.minimum(scores, 1.0)))
        order = np.argsort(price, kind="stable")
        results += [
            Candidate(float(size[k]), z[:-1, k], int(number[k]))
            for k in np.flatnonzero(scores >= 1.0)
        ]
        best = z[:, order[: int(_BEST * _COUNT)]]
        mean = _KEPT * mean + (1.0 - _KEPT) * best.mean(axis=1, keepdims=True)
        spread = np.maximum(
            _NARROWEST, _KEPT * spread + (1.0 - _KEPT) * best.std(axis=1, keepdims=True)
        )
        progress(_COUNT)
    return sorted(results, key=lambda failure: failure.size)


def _confirmed(
    chances: Chances, conditions: Conditions, controller: Controller, result: list[Candidate]
) -> Breaking | None:
    """Smallest candidate that fails again in NumPy, and in Drake if any does; None: there is none.

    ``result`` comes sorted by size, since the first that fails again is taken.
    """
    if not result:
        return None
    flight = fly_draws(controller, chances.setup, _draws(chances, result))
    still = [k for k, kind in enumerate(failure_kinds(flight)) if kind is not None]
    if not still:
        return None
    again: dict[Judge, list[Failure | None]] = {
        "numpy": [failure_kinds(flight)[k] for k in still[:_DRAKE]]
    }
    if has_drake():
        own = _draws(chances, [result[k] for k in still[:_DRAKE]])
        again["drake"] = failure_kinds(fly_draws(controller, chances.setup, own, "drake"))
    at = next(
        (k for k, kind in enumerate(again.get("drake", again["numpy"])) if kind is not None), 0
    )
    best = still[at]
    return Breaking(
        conditions=conditions,
        size=result[best].size,
        again={judge: kinds[at] for judge, kinds in again.items()},
        excess=float(worst_errors(flight)[0][best]),
        ending=ending(flight, best),
        drew=drew(chances, _draws(chances, [result[best]])),
        units=ndtr(result[best].z).tolist(),
        number=result[best].number,
        flight=picked(flight, [best]),
    )


def _draws(chances: Chances, some: list[Candidate]) -> Chosen:
    return chances.draws(
        ndtr(np.stack([failure.z for failure in some], axis=1)),
        np.array([failure.number for failure in some], dtype=np.int32),
        np.array([failure.size for failure in some]),
    )


def drew(chances: Chances, draws: Chosen) -> dict[str, str]:
    """What one flight drew, in words: its start, and every setting that its conditions let vary."""
    world = World(chances.setup)
    start, goal = world.scenario(draws.first * 0, draws)
    world.begin(start, goal, draws.first * 0, draws)
    return {
        "start": f"{_size(start.p.columns()):.3g} m from the goal",
        **dict(drawn_texts(chances.setup.conditions or Conditions(), draws.noted)),
    }


def _size(columns: Any) -> float:
    return math.hypot(*(float(np.ravel(x)[0]) for x in columns))
