"""Verdict on a flight: definitions of held, solved, settled and failed, as one fold over the outcomes of its steps.

A flight has the instants 0 (its start) to T (the end of its last step); step k leads to instant k. These terms have
the same meaning in metrics, selection, assurance, stress, comparison and validation:

over
    The task ended the episode (`rans.episode.step.Outcome.terminated`) by failure or success. Steps after that, of
    drivers that continue for the full time, do not change the verdict.
inside
    At an instant: the flight is not over, and every error is within the task's tolerance
    (`rans.episode.step.Outcome.reached`).
violated
    A margin of the task's constraints was negative at a check before the flight was over.
failed
    The flight is over and not won: at the end of a step the task declared a failure, the state was lost (NaN,
    infinite, or one that no craft reaches), or a constraint was violated that ends episodes.
won
    `rans.tasks.base.Task.done` was true at a check before any failure. Only missions can be won; a mission settles
    at the end of the step in which it is won.
held
    Inside at every instant of the last fifth: the last T // 5 instants, at least one.
solved
    Held, or for a mission won, and nothing violated. Such a flight has not failed. Every flight that is not solved
    counts as one `Failure`: lost, else violated, else the kind in which it ended.
settled
    Solved. Such a flight settled at the first instant since which it was inside without interruption, which may be
    its start, instant 0. A flight that is inside at the end alone has no settling time.

Everything is a pure function over fields (`rans.model.fields`): the same source evaluates batches of torch (also in
CUDA graphs) and NumPy, and is traced into the programs that fly whole episodes on a CPU and a GPU.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from functools import reduce
from operator import add
from typing import Protocol

from rans.episode.step import Episode, Outcome
from rans.model.dynamics import mean_thrust
from rans.model.fields import Field, where
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.tasks.base import Task
from rans.tasks.derived import is_constrained


class Failure(IntEnum):
    """Kind of failure of a flight that did not solve its task.

    Of several, ``NOT_FINITE`` is the one that counts, then ``VIOLATED``; any two others exclude each other.
    """

    NOT_FINITE = 1
    """The state became NaN or infinite, or one that no craft reaches; the flight ends there."""
    TERMINATED = 2
    """The task declared a failure; the flight ends there."""
    LEFT = 3
    """The flight was within all tolerances and left them at a step of the last fifth."""
    UNSETTLED = 4
    """The flight was outside the tolerances at every step of the last fifth."""
    LATE = 5
    """The flight entered the tolerances for good only in the last fifth."""
    VIOLATED = 6
    """A margin of the task's constraints was negative."""
    UNFINISHED = 7
    """The mission was not won before the time was up."""

    @property
    def meaning(self) -> str:
        """Description for tables."""
        return _MEANINGS[self]


_MEANINGS = {
    Failure.NOT_FINITE: "its state became NaN, infinite, or one that no craft reaches",
    Failure.TERMINATED: "the task declared it failed",
    Failure.LEFT: "left the tolerances in the last fifth",
    Failure.UNSETTLED: "outside the tolerances all of the last fifth",
    Failure.LATE: "within the tolerances for good only in the last fifth",
    Failure.VIOLATED: "violated a constraint",
    Failure.UNFINISHED: "time was up before the mission was won",
}


def kinds_of_failure(task: Task) -> tuple[Failure, ...]:
    """Kinds of failure that flights of a task can have, depending on its success and constraints."""
    kind = type(task)
    lasts = kind.done is Task.done
    possible = [Failure.NOT_FINITE, Failure.TERMINATED]
    possible += [Failure.LEFT, Failure.UNSETTLED, Failure.LATE] if lasts else [Failure.UNFINISHED]
    if is_constrained(task):
        possible.append(Failure.VIOLATED)
    return tuple(sorted(possible))


def last_fifth(steps: int) -> int:
    """Number of steps in the last fifth of a flight: steps // 5, at least one."""
    return max(1, steps // 5)


class Setting(Protocol):
    """Craft, task and timing of a flight: a `World`, a `rans.episode.flight.Setup` or a `Flight`."""

    @property
    def craft(self) -> Spacecraft:
        """Spacecraft of the flight."""
        ...

    @property
    def task(self) -> Task:
        """Task of the flight."""
        ...

    @property
    def timing(self) -> Timing:
        """Control period and number of steps."""
        ...


@dataclass(frozen=True)
class Effort:
    """Return and effort of N flights so far, as fields; nothing is added after a flight is over."""

    gained: Field
    """Return: sum of the rewards."""
    impulse: Field
    """Impulse: force times time summed over thrusters, N s."""
    opened: Field
    """Open thrusters summed over the steps of the last fifth."""

    def after(
        self, setting: Setting, outcome: Outcome, running: Field, lost: Field, late: Field
    ) -> Effort:
        """Effort after one more step.

        Args:
            setting: craft, task and timing.
            outcome: outcome of the step.
            running: whether each flight was not over before the step.
            lost: whether the state was lost; its reward is left out.
            late: whether the step belongs to the last fifth.
        """
        craft = setting.craft
        forces = [
            level * t.force
            for level, t in zip(mean_thrust(craft, outcome.command), craft.thrusters, strict=True)
        ]
        opened = craft.actuators.opened(outcome.command[craft.thruster_commands])
        zero = self.gained * 0.0
        spent = where(running, reduce(add, forces), zero) * setting.timing.control_period
        return Effort(
            gained=self.gained + where(running & ~lost, outcome.reward, zero),
            impulse=self.impulse + spent,
            opened=self.opened + where(running & late, reduce(add, opened), zero),
        )


@dataclass(frozen=True)
class FlightAccumulator:
    """Verdict on N flights so far: begun at their starts and folded over the outcome of every step.

    Each attribute is a field. The docstring of the module defines the terms.
    """

    running: Field
    """Whether the flight is not over."""
    lost: Field
    """Whether the state was lost before the flight was over (`rans.episode.step.Outcome.lost`)."""
    inside: Field
    """Whether the flight is inside now."""
    missed: Field
    """Whether the flight was not inside at an instant of the last fifth."""
    left: Field
    """Whether the flight ceased to be inside at an instant of the last fifth."""
    settled: Field
    """First instant since which the flight is inside without interruption, int."""
    effort: Effort | None = None
    """Return and effort; None: not computed."""
    won: Field | None = None
    """Whether the mission was won; None: the task cannot be won."""
    violated: Field | None = None
    """Whether a constraint was violated; None: the task has none."""

    @classmethod
    def begin(cls, setting: Setting, episode: Episode, effort: bool = False) -> FlightAccumulator:
        """Verdict at the start of flights.

        Args:
            setting: craft, task and timing.
            episode: flights at instant 0.
            effort: whether to compute return and effort.
        """
        never = episode.clock < 0
        zero = episode.clock * 0.0
        task = setting.task
        inside = task.reached(episode.state, episode.goal) | never
        return cls(
            running=~never,
            lost=never,
            inside=inside,
            missed=never,
            left=never,
            settled=where(inside, episode.clock * 0, 1),
            effort=Effort(zero, zero, zero) if effort else None,
            won=None if task.done(episode.state, episode.goal) is None else never,
            violated=never if task.constraints(episode.state, episode.goal) else None,
        )

    def after(self, setting: Setting, outcome: Outcome) -> FlightAccumulator:
        """Verdict after one more step; that of flights that are over does not change."""
        running = self.running
        steps = setting.timing.episode_steps
        instant = setting.timing.step(outcome.episode.clock)
        late = instant > steps - last_fifth(steps)
        lost = running & outcome.lost
        new = self.at(instant, late, outcome.reached, outcome.terminated, lost, outcome.done)
        violated = self.violated
        for margin in outcome.margins.values():
            violated = violated | (running & (margin < 0.0))
        effort = self.effort
        if effort is not None:
            effort = effort.after(setting, outcome, running, lost, late)
        return replace(new, effort=effort, violated=violated)

    def at(
        self,
        instant: Field,
        late: Field,
        reached: Field,
        terminated: Field,
        lost: Field,
        done: Field | None,
    ) -> FlightAccumulator:
        """Verdict at the next instant, without effort and violations.

        Args:
            instant: number of the instant.
            late: whether the instant belongs to the last fifth.
            reached: see `rans.episode.step.Outcome`.
            terminated: see `rans.episode.step.Outcome`.
            lost: whether the state was lost.
            done: whether the mission is won; ignored for tasks that cannot be won.
        """
        inside = reached & self.running & ~terminated
        settled = where(inside, self.settled, instant + 1)
        if self.won is not None:
            settled = where(self.running, where(done, instant, instant + 1), self.settled)
        return replace(
            self.without_instant(terminated, done),
            lost=self.lost | lost,
            inside=inside,
            missed=self.missed | (late & ~inside),
            left=self.left | (late & self.inside & ~inside),
            settled=settled,
        )

    def without_instant(self, terminated: Field, done: Field | None) -> FlightAccumulator:
        """Verdict after a step before the last fifth, sufficient for ``held`` and ``failed``.

        It needs one operation instead of a dozen.
        """
        won = self.won
        if won is not None:
            won = won | (self.running & done)
        return replace(self, running=self.running & ~terminated, won=won)

    def failure(self) -> Field:
        """Number (field) of the `Failure` of flights that have ended, int; 0: solved."""
        if self.won is None:
            outside = where(self.inside, Failure.LATE.value, Failure.UNSETTLED.value)
            lasts = where(self.missed, where(self.left, Failure.LEFT.value, outside), 0)
            kind = where(self.running, lasts, Failure.TERMINATED.value)
        else:
            ended = where(self.won, 0, Failure.TERMINATED.value)
            kind = where(self.running, Failure.UNFINISHED.value, ended)
        if self.violated is not None:
            kind = where(self.violated, Failure.VIOLATED.value, kind)
        return where(self.lost, Failure.NOT_FINITE.value, kind)

    @property
    def held(self) -> Field:
        """Whether flights that have ended held their goals, or won their missions."""
        return self.running & ~self.missed if self.won is None else self.won

    @property
    def solved(self) -> Field:
        """Whether flights that have ended solved their task."""
        return self.held if self.violated is None else self.held & ~self.violated

    @property
    def failed(self) -> Field:
        """Whether flights failed."""
        return ~self.running if self.won is None else ~self.running & ~self.won
