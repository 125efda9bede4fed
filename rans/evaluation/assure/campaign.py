"""Flights counted until a look of the plan ends it, kept when somebody interrupts, and gone on with."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from typing import Any, cast

from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.assure.bounds import Bound, Decision, Plan, lower, upper
from rans.evaluation.assure.fleet import ControllerFleet
from rans.fast.distributed import ALONE, Processes
from rans.fast.flights import Flights
from rans.flight import Controller
from rans.flight_statistics import FlightStatistics
from rans.policy.network import Network
from rans.progress import Progress, unseen
from rans.verdict import Failure

_PIECES = {"cpu": 2**17, "cuda": 2**26}
"""Flights of one of several processes between two moments at which all learn of all."""
LISTED = 10_000
"""Failed flights whose numbers are kept."""


@dataclass
class Campaign:
    """What was flown of a plan: scenarios 0 to ``flights - 1`` of a seed."""

    plan: Plan
    seed: int
    flights: int = 0
    events: dict[Failure, int] = field(default_factory=lambda: dict.fromkeys(Failure, 0))
    """How many flights failed, of every kind."""
    listed: list[tuple[int, Failure]] = field(default_factory=list)
    """Failed flights by number, rising, with their kinds; of many only the first."""
    ways: set[str] = field(default_factory=set)
    """What computed the flights."""
    seconds: float = 0.0

    @property
    def failures(self) -> int:
        """Number of failures of all kinds."""
        return sum(self.events.values())

    @property
    def decision(self) -> Decision:
        """At the last look that was reached."""
        return self.plan.decision(self.failures, self.flights) if self.at_look else "open"

    @property
    def at_look(self) -> bool:
        """Whether so many flights are a look of the plan, not where somebody interrupted."""
        return any(look.flights == self.flights for look in self.plan.looks)

    @property
    def over(self) -> bool:
        """Whether there is nothing left to fly."""
        return self.flights >= self.plan.flights or self.decision != "open"

    def bound(self, kind: Failure | None = None) -> Bound:
        """Bound on the probability of one kind of failure, or of any, with the plan's confidence on either side.

        An interrupted campaign has the levels of the look that it was on its way to: right where nobody
        interrupted because of what they saw.
        """
        look = self.plan.look(self.flights)
        events = self.failures if kind is None else self.events[kind]
        return Bound(
            events,
            self.flights,
            lower(events, self.flights, look.low_level),
            upper(events, self.flights, look.high_level),
        )

    def fly(
        self,
        policy: Network | Controller,
        setup: Setup,
        device: str,
        progress: Progress = unseen,
        keep: Callable[[], object] = lambda: None,
        processes: Processes = ALONE,
    ) -> None:
        """Fly on until the plan ends; whatever was flown before is kept, also when somebody interrupts.

        Args:
            policy: a network of one member, or any controller, which flies in NumPy on the CPU.
            setup: what flies, with the starts to fly from.
            device: torch device.
            progress: reports flights.
            keep: called after every part.
            processes: those that share the flights, and all learn of all.
        """
        fleet: Flights | ControllerFleet
        if hasattr(policy, "act"):
            fleet = ControllerFleet(cast("Controller", policy), setup, LISTED)
        else:
            fleet = Flights(cast("Network", policy), setup, device, listed=LISTED)
        while not self.over:
            look = next(one for one in self.plan.looks if one.flights > self.flights)
            began = time.monotonic()
            with closing(_parts(fleet, self.flights, look.flights, self.seed, processes)) as parts:
                for part in parts:
                    self.add(part)
                    self.seconds += time.monotonic() - began
                    progress(part.flights)
                    keep()
                    began = time.monotonic()

    def add(self, flown: FlightStatistics) -> None:
        """Take in the flights that come next."""
        self.flights += flown.flights
        for kind in Failure:
            self.events[kind] += flown.failures[kind]
        pairs = zip(flown.numbers.tolist(), map(Failure, flown.kinds.tolist()), strict=True)
        self.listed = [*self.listed, *pairs][:LISTED]
        self.ways |= flown.ways

    def numbers(self, kind: Failure) -> list[int]:
        """Numbers of the listed flights that failed in this way, rising."""
        return [number for number, found in self.listed if found == kind]

    def to_json(self) -> dict[str, Any]:
        """For `rans.files.write_json`."""
        return {
            "flights": self.flights,
            "seed": self.seed,
            "seconds": self.seconds,
            "ways": sorted(self.ways),
            "failures": {kind.name: count for kind, count in self.events.items()},
            "listed": {kind.name: self.numbers(kind) for kind in Failure},
        }

    def go_on_from(self, before: Mapping[str, Any]) -> None:
        """Begin where `to_json` ended."""
        try:
            self.flights = before["flights"]
            self.seconds = before["seconds"]
            self.ways = set(before["ways"])
            self.events = {kind: before["failures"].get(kind.name, 0) for kind in Failure}
            self.listed = sorted(
                (n, kind) for kind in Failure for n in before["listed"].get(kind.name, ())
            )
        except (KeyError, TypeError) as error:
            raise ConfigError(
                f"what was flown before is damaged: it lacks {error}; begin anew with --restart."
            ) from error


def _parts(
    fleet: Flights | ControllerFleet, first: int, end: int, seed: int, processes: Processes
) -> Generator[FlightStatistics]:
    """Statistics of scenarios ``first`` to ``end - 1``, in this order, of all processes together."""
    if processes.size == 1:
        yield from fleet.parts(first, end - first, seed)
        return
    piece = _PIECES[fleet.device.type] * processes.size
    for begin in range(first, end, piece):
        place, count = processes.part(min(piece, end - begin))
        own = fleet.fly(begin + place, count, seed) if count else None
        yield reduce(add, filter(None, processes.from_all(own)))
