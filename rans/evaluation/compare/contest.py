"""Setup that all contestants share, and the scores of their flights.

Scores are (N,) by start, in SI units; tables, charts and files take them from here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from rans.base.errors import ConfigError, counted
from rans.base.progress import Progress, unseen
from rans.episode.flight import Controller, Flight
from rans.episode.scenario import Scenario, scenarios
from rans.episode.step import Guard, Setup
from rans.evaluation.compare.bounds import Event, count_of_periods
from rans.evaluation.fly.episodes import EngineName, fly_episodes
from rans.evaluation.measure.metrics import (
    arrival_times,
    final_errors,
    forces,
    in_goal_set,
    returns,
    settling_times,
    staying_times,
    won,
)
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.tasks import Task


@dataclass(frozen=True)
class Contest:
    """Conditions of a comparison: all contestants have the same plant, starts, control rate and goal set."""

    craft: Spacecraft
    task: Task
    """Task with the evaluation starts."""
    timing: Timing
    seed: int
    episodes: int
    """Number of starts N: scenarios 0 to N - 1 of the seed."""
    engine: EngineName = "fast"
    """Engine that computes the motion."""
    conditions: Conditions | None = None
    """Domain randomization, disturbances, faults and sensors; None: everything is nominal."""
    guard: Guard | None = None
    """Safety filter between every contestant and the effectors; None: every command passes."""

    @cached_property
    def starts(self) -> Scenario:
        """All starts, whose fields are float64 arrays (N,)."""
        return scenarios(self.task, self.craft, self.seed, self.episodes)

    @property
    def duration(self) -> float:
        """Duration of an episode, s."""
        return self.timing.episode_steps * self.timing.control_period

    def start(self, k: int) -> Scenario:
        """Start number k alone, with fields (1,)."""
        return map_leaves(lambda x: x[k : k + 1], self.starts)

    @property
    def setup(self) -> Setup:
        """Spacecraft, task, timing, conditions and guard."""
        return Setup(self.craft, self.task, self.timing, self.conditions, self.guard)

    def fly(
        self,
        controller: Controller,
        workers: int | None = None,
        progress: Progress = unseen,
    ) -> Flight:
        """Fly from all starts; see `rans.evaluation.fly.episodes.fly_episodes`."""
        return fly_episodes(
            controller,
            self.setup,
            self.seed,
            self.episodes,
            self.engine,
            workers,
            progress,
        )

    def title(self) -> str:
        """Title in one line: starts, spacecraft, time, task, conditions and engine."""
        world = (
            ""
            if self.conditions is None
            else f"; {self.conditions.description or 'own conditions'}"
        )
        if self.guard is not None:
            world += "; behind a safety filter"
        time = f"{self.duration:g} s"
        if self.task.optimal_problem == "rendezvous":
            deadlines = np.asarray(self.starts.goal.notes.deadline)
            time = f"deadlines of {deadlines.min():,.0f} to {deadlines.max():,.0f} s"
        starts = f"{counted(self.episodes, 'start')} of seed {self.seed}"
        return (
            f"{starts}, {self.craft.name}, {time} at {1.0 / self.timing.control_period:g} Hz{world}"
        )


@dataclass(frozen=True)
class Contestant:
    """A controller with its name, its inputs and the effort of its tuning."""

    name: str
    controller: Controller
    knows: str
    """Inputs: observations, the state, or a model too."""
    tuning: str
    """Effort of its training or tuning."""
    registered: str = ""
    """Name of a controller that the user has named; empty for others."""


class Spending(Protocol):
    """Lower bounds of what a mission spends from the first starts of a comparison, which a package proves."""

    @property
    def spending(self) -> str:
        """What is spent: impulse or propellant."""
        ...

    @property
    def lower(self) -> np.ndarray:
        """(n,) of each start; infinite: there is none."""
        ...

    def ratios(self, entry: Entry) -> np.ndarray:
        """Ratio of what a contestant spends to the bound (> 0) of the same start, for those that succeeded."""
        ...

    def table(self, entries: Sequence[Entry]) -> tuple[tuple[str, ...], list[list[str]]]:
        """Headings, and a row for each start."""
        ...

    def to_json(self) -> dict[str, Any]:
        """Data of compare.json: "spending" and "lower" beside others."""
        ...


@dataclass(frozen=True)
class Entry:
    """Flights of a contestant and their scores; arrays have an entry for every start."""

    contestant: Contestant
    flight: Flight

    @property
    def name(self) -> str:
        """Name of the contestant."""
        return self.contestant.name

    @property
    def ends(self) -> bool:
        """Whether the flights are of a mission that ends with its success."""
        return self.flight.done is not None

    @cached_property
    def won(self) -> np.ndarray:
        """(N,) whether each flight succeeded without breaking a limit."""
        return won(self.flight)

    @cached_property
    def success(self) -> np.ndarray:
        """Time at which each flight of a mission that ends succeeded, (N,) s; infinite if it did not."""
        assert self.flight.lengths is not None
        return np.where(self.won, self.flight.lengths * self._period, np.inf)

    @cached_property
    def settling(self) -> np.ndarray:
        """Time at which each episode settled, (N,) s; infinite if it did not (`rans.episode.verdict`)."""
        return settling_times(self.flight)

    @cached_property
    def at_goal(self) -> np.ndarray:
        """(T + 1, N) whether flights are in the goal set, see `rans.tasks.goal_set.arrived`."""
        return in_goal_set(self.flight)

    @cached_property
    def spent(self) -> np.ndarray:
        """Impulse from the start to every instant, (T + 1, N) N s."""
        total = forces(self.flight)
        return np.vstack([0.0 * total[:1], np.cumsum(total, axis=0)]) * self._period

    @cached_property
    def arrival(self) -> np.ndarray:
        """First time in the goal set, (N,) s; infinite if never."""
        return arrival_times(self.flight)

    @cached_property
    def staying(self) -> np.ndarray:
        """First time from which flights are in the goal set at every instant to the end, (N,) s, or infinite."""
        return staying_times(self.flight)

    @cached_property
    def arrival_thrust(self) -> np.ndarray:
        """Impulse until arrival, (N,) N s; infinite without an arrival."""
        spent = np.take_along_axis(self.spent, self.at_goal.argmax(axis=0)[None], axis=0)[0]
        return np.where(np.isfinite(self.arrival), spent, np.inf)

    def thrust_by(self, horizon: float) -> np.ndarray:
        """Impulse until a horizon (s) of flights in the goal set by then, (N,) N s; else infinite.

        A flight that begins at rest counts if it was in the goal set at any instant up to the horizon: with a wait
        before its first command it would be there at the horizon with the same thrust, so that no bound of being
        there at the horizon is above its impulse. A flight that begins moving cannot wait; it must be in the
        goal set at the horizon itself.
        """
        k = count_of_periods(horizon, self._period)
        arrived = np.where(self._begins_at_rest, self.at_goal[: k + 1].any(axis=0), self.at_goal[k])
        return np.where(arrived, self.spent[k], np.inf)

    @cached_property
    def _begins_at_rest(self) -> np.ndarray:
        """(N,) whether a flight begins with neither velocity nor spin."""
        rates = (*self.flight.states.v.columns(), *self.flight.states.spin())
        return np.all([rate[0] == 0.0 for rate in rates], axis=0)

    def amounts(self, event: Event) -> np.ndarray:
        """Times (s) or impulses (N s) of an event, (N,), which are compared with its bound alone.

        Infinite where the event never comes.
        """
        if event == Event():
            return self.arrival
        if event == Event("settling"):
            return np.where(self._turns_unseen, np.inf, self.settling)
        if event.kind != "arrival" or event.horizon is None:
            raise ConfigError(
                f"impulse by a horizon is scored for arrival only, not for {event.kind}."
            )
        return self.thrust_by(event.horizon)

    @cached_property
    def _turns_unseen(self) -> np.ndarray:
        """(N,) whether the craft ever turns by half a turn or more in a control period, in the plane.

        States one period apart do not show such turns, so that bounds of the settling time do not apply to these.
        """
        spin = self.flight.states.spin()
        return (np.abs(spin[0]).max(axis=0) * self._period >= math.pi) & (len(spin) == 1)

    @cached_property
    def thrust(self) -> np.ndarray:
        """Impulse of the whole episode, (N,) N s."""
        return self.spent[-1]

    @cached_property
    def errors(self) -> dict[str, np.ndarray]:
        """Mean of every error over the last fifth, (N,) SI units."""
        return final_errors(self.flight)

    @cached_property
    def returns(self) -> np.ndarray:
        """Sum of the task's rewards, (N,)."""
        return returns(self.flight)

    @property
    def _period(self) -> float:
        return self.flight.timing.control_period
