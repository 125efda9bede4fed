"""Replays of failed flights in float64: many in NumPy, the worst in Drake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from rans.extend import (
    Controller,
    Draws,
    Failure,
    Flight,
    Setup,
    fly_draws,
    is_installed,
    last_fifth,
    leaves,
    seed_words,
    worst_errors,
)

Judge = Literal["numpy", "drake"]

CANDIDATES = 256
"""Number of failed flights of a kind that are flown again in NumPy, from which the worst are chosen."""


@dataclass(frozen=True)
class Replayed:
    """Replay of one failed flight."""

    number: int
    """Number of its scenario."""
    kind: Failure
    """Kind of failure in the campaign."""
    again: dict[Judge, Failure | None]
    """Kind of failure in each engine; None: it does not fail."""
    excess: float
    """Largest error of the last fifth in NumPy, in tolerances; infinite if a state is not finite."""
    errors: dict[str, float]
    """Largest of each error over the last fifth in NumPy, SI."""
    outside: float
    """Share of the last fifth outside the tolerances, in NumPy."""
    ending: str
    """Motion at the end; see `ending`."""

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.base.files.write_json`."""
        return asdict(self) | {
            "kind": self.kind.name,
            "again": {
                judge: failure.name if failure else None for judge, failure in self.again.items()
            },
        }


@dataclass(frozen=True)
class Replays:
    """Replays of failed flights: of each kind the worst, and the first, which are a random sample."""

    found: list[Replayed]
    """Replayed flights, kind by kind, the worst first."""
    tried: int = 0
    """Number of flights that were flown again in NumPy."""
    failed: int = 0
    """Number of these that failed again, in any way."""


def replays(
    controller: Controller,
    setup: Setup,
    seed: int,
    numbers: Mapping[Failure, Sequence[int]],
    most: int,
) -> Replays:
    """Fly failed flights again.

    Args:
        controller: agent.
        setup: setup of the campaign.
        seed: seed of the campaign.
        numbers: numbers of its failed flights, by kind.
        most: number of the worst flights of each kind, and of the first ones, that Drake replays.
    """
    # All candidates fly once more in the fast engine.
    kinds = [(number, kind) for kind, some in numbers.items() for number in some[:CANDIDATES]]
    if not kinds or not most:
        return Replays([])
    flight = fly_draws(controller, setup, drawing(seed, [number for number, _ in kinds]))
    again = failure_kinds(flight)
    (excess, largest) = worst_errors(flight)
    # Of each kind the worst flights and the first ones, a sample that does not depend on their size.
    chosen: list[int] = []
    for kind in numbers:
        own = [k for k, (_, of) in enumerate(kinds) if of == kind]
        ranked = sorted(own, key=lambda k: -excess[k])
        chosen += dict.fromkeys(ranked[:most] + own[:most])
    # Verdicts of the engines about the chosen flights.
    verdicts: dict[Judge, list[Failure | None]] = {"numpy": [again[k] for k in chosen]}
    if is_installed("pydrake"):
        own = drawing(seed, [kinds[k][0] for k in chosen])
        verdicts["drake"] = failure_kinds(fly_draws(controller, setup, own, "drake"))
    inside = np.asarray(flight.task.reached(flight.states, flight.goals))[
        -last_fifth(len(flight.commands)) :
    ]
    results = [
        Replayed(
            *kinds[k],
            again={judge: some[at] for judge, some in verdicts.items()},
            excess=float(excess[k]),
            errors={name: float(x[k]) for name, x in largest.items()},
            outside=float(1.0 - inside[:, k].mean()),
            ending=ending(flight, k),
        )
        for at, k in enumerate(chosen)
    ]
    return Replays(results, len(kinds), sum(result is not None for result in again))


def drawing(seed: int, numbers: Sequence[int]) -> Draws:
    """Random numbers of scenarios of a seed."""
    return Draws(*seed_words(seed), np.array(numbers, dtype=np.int32), 0, np.float64)


def failure_kinds(flight: Flight) -> list[Failure | None]:
    """Kind of failure of each of N flights; None: it was solved."""
    return [Failure(kind) if kind else None for kind in flight.verdict.failure().tolist()]


def ending(flight: Flight, k: int) -> str:
    """Motion of flight k over its last fifth in words: whether its commands repeat, or it drifts.

    Commands are compared exactly: a cycle of on/off valves repeats bit for bit.
    """
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
