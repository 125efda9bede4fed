"""What proves certified bounds: a package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from rans.base.registry import Registry
from rans.episode.scenario import Scenario
from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.contest import Contest
from rans.model.spacecraft import Spacecraft
from rans.tasks.base import Task


@runtime_checkable
class Certificates(Protocol):
    """Bounds of transfers to a goal that stands still, which a package proves.

    Methods raise `ConfigError` for craft and tasks that no bound covers.
    """

    def check(self, craft: Spacecraft, task: Task, period: float) -> None:
        """Refuse what has no bound, before anything is computed; commands are held for a period, s."""
        ...

    def greatest_force(self, craft: Spacecraft) -> float:
        """An upper bound of the force of all thrusters on B, N."""
        ...

    def least_times(self, contest: Contest) -> list[float]:
        """A quick lower bound of the time to the goal set from every start, s."""
        ...

    def last_watched(self, contest: Contest) -> float:
        """Latest settling time for which the bound holds, s.

        A craft that enters the tolerances later may be too fast to stay, and the episode ends before it leaves.
        """
        ...

    def bound(
        self,
        number: int,
        craft: Spacecraft,
        task: Task,
        period: float,
        event: Event,
        seconds: float,
        start: Scenario,
    ) -> Bound:
        """Bound of one start, whose fields are floats, with so much work (nominal s)."""
        ...

    def add_bounds(
        self,
        bounds: list[Bound],
        craft: Spacecraft,
        task: Task,
        period: float,
        event: Event,
        measure: str,
        seconds: float,
        starts: Scenario,
        costs: Sequence[float],
    ) -> None:
        """Add and print bounds of an event from every start, and for a time those of settling.

        An interrupt leaves those that are finished. Costs are those of trajectories to the same event, of a measure
        with its unit, NaN where there is none; empty: there are no trajectories.
        """
        ...


CERTIFICATES: Registry[Certificates] = Registry(
    "certificate", "rans.certificates", checked=Certificates
)
"""Certified bounds that installed packages prove, by what is bounded."""


def certificates() -> Certificates:
    """Bounds of transfers to a goal that stands still; `ConfigError` if no installed package proves them."""
    return CERTIFICATES["transfer"]
