"""A comparison from beginning to end: what is finished is there at every moment, whatever fails."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rans.errors import ConfigError, RansError, counted
from rans.evaluation.compare import relaxed, roster
from rans.evaluation.compare.bounds import (
    Amounts,
    Bound,
    Event,
    goal_set,
    no_certificate,
    staying_set,
)
from rans.evaluation.compare.certified import certify
from rans.evaluation.compare.contest import Contest, Contestant, Entry
from rans.evaluation.compare.front import Front, certify_front
from rans.evaluation.compare.relaxed import Relaxed
from rans.evaluation.fly.controllers import BESIDE
from rans.files import first_line
from rans.optimal.certificate.hull import staying_time
from rans.optimal.trajectory.arrival import check_goal
from rans.shown import Shown
from rans.tasks.goal_set import aims

_HORIZONS = (0.24, 0.32, 0.4, 0.6, 0.8, 1.0)
"""Shares of an episode at which the least thrust-time is certified: 6, 8, 10, 15, 20 and 25 s of 25 s."""

_FRONT = (*(0.2 * 1.08**k for k in range(21)), 1.0)
"""Those at which the front is drawn: so close that what lies between hardly counts (`Front.epsilon`)."""

_RELAXED = (0.4, 0.8)
"""Those of them for which the relaxed optimum is found too."""

Track = Callable[[str, int], Callable[..., object]]
"""Called with what begins and how many steps it has; what it returns is called after each, or after
several with their number."""


@dataclass
class Comparison(Shown):
    """Everything found so far."""

    contest: Contest
    entries: list[Entry] = field(default_factory=list)
    """Contestants in their order; the first is the one that others are compared with."""
    curve: list[Entry] = field(default_factory=list)
    """LQRs of other weights."""
    relaxed: dict[str, list[Relaxed]] = field(default_factory=dict)
    """Optima from every start, by objective."""
    certified: list[Bound] = field(default_factory=list)
    front: Front | None = None
    """Time against impulse, where it was asked for."""
    notes: list[str] = field(default_factory=list)
    """What does not exist here, and why."""
    failures: list[str] = field(default_factory=list)
    """What went wrong, a sentence each."""

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(entry.name for entry in self.entries) or 'nobody'}>"

    def names(self) -> set[str]:
        """Of the contestants."""
        return {entry.name for entry in self.entries}

    def horizons(self, shares: Sequence[float] = _HORIZONS) -> tuple[float, ...]:
        """Times at which thrust is compared, s: whole control periods."""
        timing = self.contest.timing
        steps = {max(1, round(share * timing.episode_steps)) for share in shares}
        return tuple(k * timing.control_period for k in sorted(steps))

    def certified_starts(self) -> list[int]:
        """Numbers of the starts of which every bound is known."""
        counts = [c.start for c in self.certified]
        return [k for k in sorted(set(counts)) if counts.count(k) == len(self.events())]

    def events(self) -> list[Event]:
        """What is bounded: the times of arrival at rest and of settling, and thrust-time by each horizon."""
        return [
            Event(),
            Event("settling"),
            *(Event(horizon=horizon) for horizon in self.horizons()),
        ]

    def bounds(self, event: Event) -> tuple[Amounts, Amounts]:
        """Lower and upper bounds of the certified starts for one event."""
        answers = {c.start: c for c in self.certified if c.event == event}
        rows = [answers[k] for k in self.certified_starts()]
        lower, upper = np.array([(c.best, c.upper) for c in rows]).reshape(-1, 2).T
        if event.kind == "settling" and rows:
            lower = np.minimum(lower, self._last_watched())
        return Amounts(event, lower), Amounts(event, upper)

    def _last_watched(self) -> float:
        """Until when a flight that settles is watched long enough for the bound to hold, s.

        Whoever enters the tolerances in the last moment of an episode may be too fast to stay there.
        """
        craft = self.contest.craft
        task = self.contest.task
        period = self.contest.timing.control_period
        return max(
            0.0,
            self.contest.duration - staying_time(craft, staying_set(craft, task, period), period),
        )

    def impossible(self) -> list[str]:
        """Flights below a certified bound: each would prove an error of ours."""
        return [
            f"{entry.name} beats the certified bound from start {k}: the certificate or a flight is "
            "wrong."
            for entry in (*self.entries, *self.curve)
            for k in self._beaten(entry)
        ]

    def _beaten(self, entry: Entry) -> list[int]:
        starts = np.array(self.certified_starts(), dtype=int)
        low = [entry.amounts(event)[starts].below(self.bounds(event)[0]) for event in self.events()]
        return [int(k) for k in starts[np.any(low, axis=0)]]


def fill(
    comparison: Comparison,
    contestants: Mapping[str, Contestant],
    beside: Sequence[str] = BESIDE,
    certified: int = 4,
    cache: Path | None = None,
    track: Track = lambda *_: lambda *_: None,
    workers: int | None = None,
) -> None:
    """Fly everyone and find what is possible; failures are noted and the rest goes on.

    Args:
        comparison: is filled step by step, so that an interrupt leaves what was finished.
        contestants: see `rans.evaluation.compare.roster.enlisted`; the first gave the contest.
        beside: names of controllers, and "optimal".
        certified: starts whose bounds are certified.
        cache: see `certify`.
        track: shows progress.
        workers: processes, by default one per processor.
    """
    for spec, one in contestants.items():
        with _noted(comparison, spec):
            comparison.entries.append(_entry(comparison, one, track, workers))
    for name in dict.fromkeys(name for name in beside if name != "optimal"):
        with _noted(comparison, name):
            simple = roster.simple_controller(name, comparison.contest)
            if simple.name not in comparison.names():  # nobody flies twice
                comparison.entries.append(_entry(comparison, simple, track, workers))
            comparison.curve += [
                _entry(comparison, one, track, workers)
                for one in roster.swept(name, comparison.contest)
            ]
    if "optimal" in beside and (reason := _nothing_claimed(comparison.contest)):
        comparison.notes.append(reason)
    elif "optimal" in beside:
        _find_relaxed(comparison, track, workers)
        _find_certified(comparison, certified, cache, track, workers)
        comparison.failures += comparison.impossible()


def trace(
    comparison: Comparison,
    between: Mapping[str, Contestant],
    seconds: float,
    cache: Path | None = None,
    track: Track = lambda *_: lambda *_: None,
    workers: int | None = None,
) -> None:
    """After `fill`: fly the positions of knobs that are no contestants, and certify the front.

    The bounds take about so many seconds, see `certify_front`.
    """
    front = Front(comparison.contest, comparison.horizons(_FRONT), [*comparison.entries])
    comparison.front = front
    for spec, one in between.items():
        with _noted(comparison, spec):
            front.entries.append(_entry(comparison, one, track, workers))
    if not front.lines():
        comparison.notes.append("Nobody has a knob to turn: the front has points, but no line.")
    if reason := _nothing_claimed(comparison.contest) or _uncertified(comparison.contest):
        comparison.notes += [] if reason in comparison.notes else [reason]
        return
    with _noted(comparison, "the certified front"):
        certify_front(
            front, seconds, cache, workers, track("certified front", len(front.questions()))
        )
    comparison.failures += front.impossible()
    if not front.starts():
        comparison.notes.append(
            f"No start has all bounds of the front after {seconds:g} s: give it a larger --budget."
        )


def _nothing_claimed(contest: Contest) -> str:
    """Why neither optima nor bounds are claimed; nothing if they are."""
    if contest.conditions is not None:
        return "Optima and bounds are those of a perfect world; under these conditions none is claimed."
    try:
        check_goal(contest.task)
    except ConfigError as reason:
        return f"Neither optima nor bounds are claimed: {reason}"
    return ""


def _uncertified(contest: Contest) -> str:
    """Why no bound is certified; nothing if one can be."""
    try:
        goal_set(contest.task)
    except ConfigError as reason:
        return f"No bound is certified: {reason}"
    return ""


def _entry(
    comparison: Comparison, contestant: Contestant, track: Track, workers: int | None
) -> Entry:
    step = track(f"flying {contestant.name}", comparison.contest.episodes)
    flight, stopped = comparison.contest.fly(contestant.controller, workers, step)
    if stopped:
        comparison.failures.append(
            f"{contestant.name}: its solver stopped {stopped} times; the plan before was flown on."
        )
    return Entry(contestant, flight, comparison.contest.latencies(contestant.controller))


@contextlib.contextmanager
def _noted(comparison: Comparison, what: str) -> Iterator[None]:
    """A failure becomes a sentence."""
    try:
        yield
    except RansError as error:
        comparison.failures.append(str(error))
    except Exception as error:  # solvers and other people's code raise anything
        comparison.failures.append(f"{what} failed: {type(error).__name__}: {first_line(error)}.")


def _find_relaxed(comparison: Comparison, track: Track, workers: int | None) -> None:
    contest = comparison.contest
    for objective in relaxed.objectives(contest, comparison.horizons(_RELAXED)):
        step = track(f"relaxed optimum: {objective.name}", contest.episodes)
        with _noted(comparison, objective.name):
            found = relaxed.solve(contest, objective, workers, step)
            comparison.relaxed[objective.name] = found
            lost = [one.status for one in found if not one.solved]
            if lost:
                comparison.failures.append(
                    f"{objective.name}: no trajectory from {len(lost)} of {counted(len(found), 'start')} "
                    f"({'; '.join(sorted(set(lost)))})."
                )


def _find_certified(
    comparison: Comparison, count: int, cache: Path | None, track: Track, workers: int | None
) -> None:
    contest = comparison.contest
    events = comparison.events()
    if reason := _uncertified(contest):
        comparison.notes.append(reason)
        return
    count = min(count, contest.episodes)
    missing = no_certificate(contest.craft, aims(contest.task), contest.timing.control_period)
    if missing:
        comparison.notes.append(
            f"No tight certificate exists: {missing} The bounds shown let translation "
            "and rotation use all thrusters each, and hold for throttled thrust too."
        )
    step = track("certified bounds", count * len(events))
    with _noted(comparison, "certified bounds"):
        for answer in certify(contest, count, events, cache, workers, step):
            comparison.certified.append(answer)
