"""Campaigns: flights are counted until a look of the plan ends them."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, cast

from rans.extend import (
    Controller,
    Failure,
    FlightStatistics,
    Network,
    Setup,
    Stages,
    unseen_stages,
)
from rans.fast.flights import Flights
from rans_assurance.assure.bounds import CampaignPlan, Decision, ProbabilityBound, lower, upper
from rans_assurance.assure.fleet import ControllerFleet

LISTED = 10_000
"""Largest number of failed flights whose numbers are kept."""


@dataclass
class Campaign:
    """Flights of a plan so far: scenarios 0 to ``flights - 1`` of a seed."""

    plan: CampaignPlan
    seed: int
    flights: int = 0
    events: dict[Failure, int] = field(default_factory=lambda: dict.fromkeys(Failure, 0))
    """Number of failed flights of every kind."""
    listed: list[tuple[int, Failure]] = field(default_factory=list)
    """Numbers and kinds of failed flights, in ascending order, of which the first `LISTED` are kept."""
    ways: set[str] = field(default_factory=set)
    """Ways in which the flights were computed."""
    seconds: float = 0.0

    @property
    def failures(self) -> int:
        """Number of failures of all kinds."""
        return sum(self.events.values())

    @property
    def decision(self) -> Decision:
        """Decision at the last look that was reached."""
        return self.plan.decision(self.failures, self.flights) if self.at_look else "open"

    @property
    def at_look(self) -> bool:
        """Whether the number of flights is that of a look of the plan, and not of an interrupt."""
        return any(stage.flights == self.flights for stage in self.plan.looks)

    @property
    def over(self) -> bool:
        """Whether the campaign has ended."""
        return self.flights >= self.plan.flights or self.decision != "open"

    def bound(self, kind: Failure | None = None) -> ProbabilityBound:
        """Bounds on the probability of one kind of failure, or of any; each end has the confidence of the plan.

        An interrupted campaign has the levels of the next look. They are right if the interrupt was not made
        because of the counts.
        """
        stage = self.plan.look(self.flights)
        events = self.failures if kind is None else self.events[kind]
        return ProbabilityBound(
            events,
            self.flights,
            lower(events, self.flights, stage.low_level),
            upper(events, self.flights, stage.high_level),
        )

    def fly(
        self,
        policy: Network | Controller,
        setup: Setup,
        device: str,
        stages: Stages = unseen_stages,
    ) -> None:
        """Fly until the plan ends; flights until an interrupt are kept.

        Args:
            policy: a network, or any controller, which flies in NumPy on the CPU.
            setup: spacecraft, task with its starts, and timing.
            device: torch device.
            stages: reports flights until each analysis, since the last one that is made is not known before.
        """
        fleet: Flights | ControllerFleet
        if hasattr(policy, "act"):
            fleet = ControllerFleet(cast("Controller", policy), setup, LISTED)
        else:
            fleet = Flights(cast("Network", policy), setup, device, listed=LISTED)
        while not self.over:
            stage = next(stage for stage in self.plan.looks if stage.flights > self.flights)
            number = self.plan.looks.index(stage) + 1
            ways = len(self.plan.looks)
            name = "flights" if ways == 1 else f"flights, analysis {number} of at most {ways}"
            progress = stages(name, stage.flights)
            progress(self.flights)
            began = time.monotonic()
            count = stage.flights - self.flights
            with closing(fleet.parts(self.flights, count, self.seed)) as parts:
                for part in parts:
                    self.add(part)
                    self.seconds += time.monotonic() - began
                    progress(part.flights)
                    began = time.monotonic()

    def add(self, flown: FlightStatistics) -> None:
        """Add the statistics of the next flights."""
        self.flights += flown.flights
        for kind in Failure:
            self.events[kind] += flown.failures[kind]
        pairs = zip(flown.numbers.tolist(), map(Failure, flown.kinds.tolist()), strict=True)
        self.listed = [*self.listed, *pairs][:LISTED]
        self.ways |= flown.ways

    def numbers(self, kind: Failure) -> list[int]:
        """Numbers of the listed flights with this kind of failure, in ascending order."""
        return [number for number, failure in self.listed if failure == kind]

    def to_json(self) -> dict[str, Any]:
        """Content of "campaign" in the JSON file."""
        return {
            "flights": self.flights,
            "seed": self.seed,
            "seconds": self.seconds,
            "ways": sorted(self.ways),
            "failures": {kind.name: count for kind, count in self.events.items()},
            "listed": {kind.name: self.numbers(kind) for kind in Failure},
        }
