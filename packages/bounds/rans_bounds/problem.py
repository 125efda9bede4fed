"""Problems of certified bounds, the effort of their search and its results, for the plane and for space."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rans.extend import ConfigError, State, leaves
from rans_bounds.goal_set import GoalSet

POSE = frozenset({"position", "attitude", "velocity", "spin"})
"""Aims of a craft that is to be at rest in a pose."""
_DEFAULT_SET = GoalSet()


def check_finite(start: State, goal: State) -> None:
    """Refuse (`ConfigError`) states with NaN or infinity: nothing compares with them, so all seems proven."""
    for name, state in (("start", start), ("goal", goal)):
        if not np.isfinite(leaves(state)).all():
            raise ConfigError(f"a bound needs a finite {name}, got {state}; did a flight diverge?")


class Unreachable(ConfigError):
    """Proof that no on/off controller is in the goal set at a time."""

    @classmethod
    def after(cls, steps: int, period: float) -> Unreachable:
        """Error for a number of control periods, each in s."""
        return cls(
            f"no on/off controller can reach the goal set in {steps} control periods of "
            f"{period:g} s; the usual cause is too short a time."
        )


class TooManyPoints(ConfigError):
    """The lattice of a problem is too large to search."""


@dataclass(frozen=True)
class SearchEffort:
    """Limits of a search; with less effort gaps are wider, and bounds hold all the same.

    Work is counted in nominal seconds: lattice points, programs and attempts, each worth what a core at
    3 GHz needs for it. Every machine therefore finds the same, however busy it is.
    """

    work: float = 20.0
    """Work for each level of fuel or number of periods, nominal s."""
    nozzle_work: float = 1.0
    """Work for each attempt to find thrusters for a known attitude, nominal s."""
    levels: int = 4
    """Amounts of fuel, or numbers of periods, tried from the first that could not be excluded."""

    def __post_init__(self) -> None:
        if not (self.work > 0 and self.nozzle_work > 0 and self.levels > 0):
            raise ConfigError(f"effort: work, nozzle_work and levels must be > 0, got {self}.")


class Problem(NamedTuple):
    """Start and goal of a craft."""

    start: Any
    """`State` of floats, with any position, velocity and spin."""
    goal: Any
    goal_set: GoalSet = _DEFAULT_SET
    """Balls around the goal in which the craft must be at the end."""
    aims: Collection[str] = POSE
    """Quantities that the set asks for; in the plane the spin always is one of them."""


class Found(NamedTuple):
    """Bound and commands that a `Bounder` found for one problem."""

    lower: float
    """Lower bound for on/off controllers, N s or s."""
    commands: np.ndarray | None
    """(T, thrusters) zeros and ones that end in the goal set, if any were found."""
