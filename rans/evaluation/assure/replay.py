"""Failed flights again, step by step in float64: many by our equations in NumPy, the worst in Drake."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from rans.episode import Setup
from rans.evaluation.fly.episodes import fly_draws
from rans.evaluation.measure.metrics import worst_errors
from rans.flight import Controller, Flight
from rans.model.fields import leaves, map_leaves
from rans.model.random import Draws, seed_words
from rans.verdict import Failure, last_fifth

Judge = Literal["numpy", "drake"]

CANDIDATES = 256
"""Failed flights of a kind that are flown again in NumPy, to find the worst of them."""


@dataclass(frozen=True)
class Replayed:
    """One failed flight, flown again."""

    number: int
    """Number of its scenario."""
    kind: Failure
    """How it failed in the campaign."""
    again: dict[Judge, Failure | None]
    """How it fails for each judge; None: it does not."""
    excess: float
    """The largest error of the last fifth in NumPy, in tolerances; infinite if it was lost."""
    errors: dict[str, float]
    """The largest of each error over the last fifth in NumPy, SI."""
    outside: float
    """Share of the last fifth outside of the tolerances, in NumPy."""
    ending: str
    """What it does in the end, see `ending`."""

    def to_json(self) -> dict[str, Any]:
        """For `rans.files.write_json`."""
        return asdict(self) | {
            "kind": self.kind.name,
            "again": {judge: found.name if found else None for judge, found in self.again.items()},
        }


@dataclass(frozen=True)
class Replays:
    """Failed flights, flown again: of each kind the worst, and the first, as good as drawn by lot."""

    found: list[Replayed]
    """Kind by kind, the worst first."""
    flight: Flight | None
    """Theirs, in NumPy and in this order; None: of none."""
    tried: int = 0
    """How many were flown again in NumPy."""
    failed: int = 0
    """How many of these failed again, in whatever way."""

    def refuted(self, judge: Judge) -> list[int]:
        """Numbers of flights that do not fail for this judge."""
        return [one.number for one in self.found if judge in one.again and one.again[judge] is None]

    def judges(self) -> list[Judge]:
        """For whom they were flown."""
        return [*self.found[0].again] if self.found else []


def has_drake() -> bool:
    """Whether Drake is installed."""
    return importlib.util.find_spec("pydrake") is not None


def replays(
    controller: Controller,
    setup: Setup,
    seed: int,
    numbers: Mapping[Failure, Sequence[int]],
    worst: int,
    sample: int,
) -> Replays:
    """Fly failed flights again.

    Args:
        controller: the agent.
        setup: as in the campaign.
        seed: of the campaign.
        numbers: of its failed flights, by kind.
        worst: how many of the worst of each kind Drake is given.
        sample: how many of the first.
    """
    kinds = [(number, kind) for kind, some in numbers.items() for number in some[:CANDIDATES]]
    if not kinds or not worst + sample:
        return Replays([], None)
    flight = fly_draws(controller, setup, drawing(seed, [number for number, _ in kinds]))
    again = failures(flight)
    (excess, largest) = worst_errors(flight)
    chosen: list[int] = []
    for kind in numbers:
        own = [k for k, (_, of) in enumerate(kinds) if of == kind]
        ranked = sorted(own, key=lambda k: -excess[k])
        chosen += dict.fromkeys(ranked[:worst] + own[:sample])
    told: dict[Judge, list[Failure | None]] = {"numpy": [again[k] for k in chosen]}
    if has_drake():
        own = drawing(seed, [kinds[k][0] for k in chosen])
        told["drake"] = failures(fly_draws(controller, setup, own, "drake"))
    inside = np.asarray(flight.task.reached(flight.states, flight.goals))[
        -last_fifth(len(flight.commands)) :
    ]
    results = [
        Replayed(
            *kinds[k],
            again={judge: some[at] for judge, some in told.items()},
            excess=float(excess[k]),
            errors={name: float(x[k]) for name, x in largest.items()},
            outside=float(1.0 - inside[:, k].mean()),
            ending=ending(flight, k),
        )
        for at, k in enumerate(chosen)
    ]
    return Replays(
        results, picked(flight, chosen), len(kinds), sum(one is not None for one in again)
    )


def drawing(seed: int, numbers: Sequence[int]) -> Draws:
    """What these scenarios of a seed draw with."""
    return Draws(*seed_words(seed), np.array(numbers, dtype=np.int32), 0, np.float64)


def picked(flight: Flight, episodes: Sequence[int]) -> Flight:
    """Some episodes of a flight."""

    def some(x: Any) -> Any:
        return x[..., list(episodes)] if np.ndim(x) else x

    return replace(
        flight,
        states=map_leaves(some, flight.states),
        goals=map_leaves(some, flight.goals),
        commands=flight.commands[:, list(episodes)],
    )


def failures(flight: Flight) -> list[Failure | None]:
    """How each of N flights failed to solve its task; None: it was solved."""
    return [Failure(kind) if kind else None for kind in flight.verdict.failure().tolist()]


def ending(flight: Flight, k: int) -> str:
    """What flight k does over its last fifth: whether its commands repeat, or it drifts."""
    commands = flight.commands[-last_fifth(len(flight.commands)) :, k]
    if not np.isfinite(leaves(flight.states)[0][-1, k]):
        return "is lost"
    if not commands.any():
        return "drifts with shut valves"
    lags = range(1, len(commands) // 2 + 1)
    cycle = next((lag for lag in lags if np.array_equal(commands[lag:], commands[:-lag])), 0)
    return (
        "fires without a cycle"
        if not cycle
        else "fires steadily"
        if cycle == 1
        else f"repeats every {cycle} steps"
    )
