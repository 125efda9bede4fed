"""Comparisons: flights of contestants, optima and bounds, of which every finished part is kept.

Failures are sentences beside results, and an interrupt leaves every finished part.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from rans.display import NotebookRepr
from rans.errors import ConfigError, RansError, counted, installing, is_installed
from rans.evaluation.compare import entrants, relaxed
from rans.evaluation.compare.bounds import Amounts, Bound, Event, certificates
from rans.evaluation.compare.contest import Contest, Contestant, Entry, Spending
from rans.evaluation.compare.relaxed import Relaxed
from rans.evaluation.fly.controllers import default_opponents
from rans.evaluation.problems import bounding
from rans.files import first_line
from rans.model.spacecraft import check_rigid
from rans.optimal.trajectory.allocation import check_relaxation
from rans.optimal.trajectory.arrival import check_goal
from rans.optimal.trajectory.objectives import MinimumTime
from rans.progress import Progress, Stages, unseen_stages
from rans.verdict import last_fifth

_SLOW = ("mpc", "convex", "optimal")
"""Controllers that solve an optimal control problem at every step, and the bounds."""

_HORIZONS = (1.2, 1.6, 2.0, 3.0, 4.0, math.inf)
"""Multiples of `Comparison.least_time` by which the least impulse is certified; none is later than the end of the
episode. The floating platform's are 6, 8, 10, 15, 20 and 25 s; at 1.2 each craft tried arrives from each start."""

_RELAXED = (2.0, 4.0)
"""Those by which the relaxed optimum is computed too, if the comparison has them."""

TYPICAL = (2.0,)
"""The one by which most controllers arrive, for comparisons that do not ask for the whole curve of impulses."""

_TYPICAL_STARTS = 64
"""Starts whose median least time is that of a typical one, however few are compared; they take milliseconds."""

_UNBOUNDED = 0.2
"""Part of an episode that stands for the least time where no bound of it is known: as of the floating platform."""


@dataclass
class Comparison(NotebookRepr):
    """Flights, optima and bounds of a comparison, as far as it has come."""

    contest: Contest
    entries: list[Entry] = field(default_factory=list)
    """Entries of the contestants in their order; the others are compared with the first."""
    relaxed: dict[str, list[Relaxed]] = field(default_factory=dict)
    """Optima from every start, by objective."""
    certified: list[Bound] = field(default_factory=list)
    mission: Spending | None = None
    """Lower bounds of what an orbital mission or a landing spends; None: it has none."""
    multiples: Sequence[float] = _HORIZONS
    """Multiples of `least_time` by which impulses are bounded; infinite: the episode's end."""
    notes: list[str] = field(default_factory=list)
    """Sentences about parts that do not exist for this task or craft."""
    failures: list[str] = field(default_factory=list)
    """Sentences about failed parts."""
    grounded: dict[str, list[str]] = field(default_factory=dict)
    """Names of opponents that cannot fly the craft, by the reason."""
    waiting: Sequence[str] = ()
    """Names of opponents that have not flown yet."""
    files: list[Path] = field(default_factory=list)
    """Files that it was written to, the page first."""

    is_partial: bool = False
    """Whether it was interrupted."""
    stage: str = ""
    """What is computed at present; empty: nothing yet."""

    def __repr__(self) -> str:
        return f"<Comparison of {', '.join(entry.name for entry in self.entries) or 'nobody'}>"

    def names(self) -> set[str]:
        """Names of the contestants."""
        return {entry.name for entry in self.entries}

    @cached_property
    def least_time(self) -> float:
        """Least time of this craft from a typical start, s: the scale of all instants that are compared.

        It is the median over starts of a quick bound, and is rounded to half of its leading digit, so that other
        seeds have the same instants.
        """
        contest = replace(self.contest, episodes=_TYPICAL_STARTS)
        try:
            bounds = certificates().least_times(contest)
        except ConfigError:
            bounds = []
        typical = [bound for bound in bounds if 0.0 < bound < math.inf]
        if not typical:
            return _UNBOUNDED * contest.duration
        middle = float(np.median(typical))
        half_digit = 0.5 * 10.0 ** math.floor(math.log10(middle))
        return half_digit * round(middle / half_digit)

    def horizons(self, multiples: Sequence[float] | None = None) -> tuple[float, ...]:
        """Times by which impulses are compared, s, in whole control periods; none is after the episode's end.

        Args:
            multiples: of `least_time`; None: those of the comparison.
        """
        timing = self.contest.timing
        chosen = self.multiples if multiples is None else multiples
        times = (min(multiple * self.least_time, self.contest.duration) for multiple in chosen)
        # A horizon of whole periods needs no further one for its rounding.
        steps = {max(1, math.ceil(time / timing.control_period - 1e-9)) for time in times}
        return tuple(k * timing.control_period for k in sorted(steps))

    def certified_starts(self) -> list[int]:
        """Numbers of the starts whose bounds are all known."""
        counts = [c.start for c in self.certified]
        return [k for k in sorted(set(counts)) if counts.count(k) == len(self.events())]

    def events(self) -> list[Event]:
        """Events that are measured and bounded: arrival and settling, and arrival by each horizon."""
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
            lower = np.minimum(lower, certificates().last_watched(self.contest))
        return Amounts(event, lower), Amounts(event, upper)

    def impossible(self) -> list[str]:
        """Sentences about flights below a certified bound, each of which would prove an error in the package."""
        return [
            f"{entry.name} beats the certified bound from start {k}: the certificate or a flight is "
            "wrong."
            for entry in self.entries
            for k in self._beaten(entry)
        ]

    def _beaten(self, entry: Entry) -> list[int]:
        starts = np.array(self.certified_starts(), dtype=int)
        low = [entry.amounts(event)[starts].below(self.bounds(event)[0]) for event in self.events()]
        return [int(k) for k in starts[np.any(low, axis=0)]]

    def quick_and_slow(self, opponents: Sequence[str] | None) -> tuple[list[str], list[str]]:
        """Opponents that answer in seconds, which fly first, and the slow ones after them; see `fly`."""
        names = [*(default_opponents(self.contest.task) if opponents is None else opponents)]
        slow = next((k for k, name in enumerate(names) if name in _SLOW), len(names))
        return names[:slow], names[slow:]

    def note_interrupt(self, certified: int, kept: bool) -> None:
        """Note the progress of an interrupted comparison.

        Bounds are counted if they are ``kept`` in a file. Without one the note says that none was computed:
        certification may have been far from its turn.
        """
        self.is_partial = True
        stage = f' in the stage "{self.stage}"' if self.stage else ""
        flown = counted(len(self.entries), "contestant")
        count = len(self.certified_starts() if self.mission is None else self.mission.lower)
        asked = min(certified, self.contest.episodes)
        bounds = f"bounds were computed from {count} of {asked} starts"
        if not count:
            bounds = (
                "no start had all its bounds" if self.certified else "no bound had been computed"
            )
        if self.certified and kept:
            every = asked * len(self.events())
            bounds += f"; {len(self.certified)} of {every} bounds are kept for the next run"
        self.notes.insert(0, f"Interrupted{stage}: {flown} had flown, and {bounds}.")

    def fly(
        self,
        contestants: Mapping[str, Contestant],
        opponents: Sequence[str] | None = None,
        certified: int = 4,
        cache: Path | None = None,
        stages: Stages = unseen_stages,
        workers: int | None = None,
        returns: bool = True,
        asked: bool = True,
    ) -> None:
        """Fly all contestants and compute optima and bounds; failures are noted, and the rest goes on.

        After an interrupt the finished parts remain.

        Args:
            contestants: see `rans.evaluation.compare.entrants.enlisted`; the contest is the setup of the first.
            opponents: names of controllers, and "optimal"; None: those of `default_opponents`.
            certified: number of starts whose bounds are certified.
            cache: see `rans.evaluation.compare.bounds.Certificates`.
            stages: reports progress.
            workers: processes, by default one per processor.
            returns: whether the optima of the task's return are computed too, which take longer than all others.
            asked: whether somebody has named the opponents, so that one that cannot fly is a failure.
        """
        if opponents is None:
            opponents = default_opponents(self.contest.task)

        def noted(name: str, total: int | None, /) -> Progress:
            self.stage = name
            return stages(name, total)

        # Contestants first: what opponents and bounds cost is not lost with an interrupt of theirs.
        for spec, contestant in contestants.items():
            with _noted(self, spec):
                self.entries.append(_entry(self, contestant, noted, workers))
        for name in dict.fromkeys(name for name in opponents if name != "optimal"):
            try:
                simple = entrants.simple_controller(name, self.contest)
            except RansError as error:
                self._ground(name, str(error), self.failures if asked else self.notes)
                continue
            with _noted(self, name):
                if simple.name not in self.names():  # A controller flies once.
                    self.entries.append(_entry(self, simple, noted, workers))
        if "optimal" in opponents and (problem := bounding(self.contest)):
            count = min(certified, self.contest.episodes)
            with _noted(self, "certified bounds"):
                if count:
                    problem.bounds(self, count, noted)
        elif "optimal" in opponents and (reason := _nothing_claimed(self.contest)):
            self.notes.append(reason)
        elif "optimal" in opponents:
            _find_relaxed(self, noted, workers, returns)
            _find_certified(self, certified, cache, noted, workers)
            self.failures += self.impossible()

    def _ground(self, name: str, reason: str, sentences: list[str]) -> None:
        """Say that an opponent cannot fly; those of one reason have one sentence."""
        names = self.grounded.setdefault(reason, [])
        said = f"{' and '.join(names)} cannot fly here: {reason}"
        names.append(name)
        sentences[:] = [each for each in sentences if each != said]
        sentences.append(f"{' and '.join(names)} cannot fly here: {reason}")


def _nothing_claimed(contest: Contest) -> str:
    """Reason why there are neither optima nor bounds; "" if there are."""
    if contest.conditions is not None:
        return (
            "Optima and bounds hold for nominal conditions; under these conditions none is claimed."
        )
    try:
        check_goal(contest.task)
        check_rigid(contest.craft, "optima and bounds")
    except ConfigError as reason:
        return f"Neither optima nor bounds are claimed: {reason}"
    return ""


def _entry(
    comparison: Comparison,
    contestant: Contestant,
    stages: Stages,
    workers: int | None,
) -> Entry:
    """Fly one contestant from all starts, as an entry of the comparison.

    It adds to `failures`; the caller adds the entry.
    """
    step = stages(f"flying {contestant.name}", comparison.contest.episodes)
    flight = comparison.contest.fly(contestant.controller, workers, step)
    if flight.stopped:
        comparison.failures.append(
            f"{contestant.name}: its solver stopped {flight.stopped} times; the plan before was flown on."
        )
    return Entry(contestant, flight)


@contextlib.contextmanager
def _noted(comparison: Comparison, what: str) -> Iterator[None]:
    """Note an exception as a sentence."""
    try:
        yield
    except RansError as error:
        comparison.failures.append(str(error))
    except Exception as error:  # Solvers and users' code raise anything.
        comparison.failures.append(f"{what} failed: {type(error).__name__}: {first_line(error)}.")


def _find_relaxed(
    comparison: Comparison, stages: Stages, workers: int | None, returns: bool
) -> None:
    """Add optima with partly open thrusters to a comparison, or the reason for which there are none.

    The least time comes first: starts that cannot arrive by a horizon are then known, and not searched.

    Args:
        comparison: changed in place.
        stages: tells how far it is.
        workers: number of processes; None: one for each processor.
        returns: whether the largest return is one of the objectives.
    """
    contest = comparison.contest
    if not is_installed("pydrake"):
        comparison.notes.append(f"Relaxed optima are flown in Drake: {installing('verify')}")
        return
    try:
        check_relaxation(contest.craft)
    except ConfigError as reason:
        comparison.notes.append(f"No optimum is computed: {reason}")
        return
    earliest: list[float] = []
    # Who arrives in the last fifth of an episode has not settled (`rans.verdict`).
    steps = contest.timing.episode_steps
    latest = contest.timing.control_period * (steps - last_fifth(steps))
    chosen = [multiple for multiple in _RELAXED if multiple in comparison.multiples]
    horizons = sorted({min(horizon, latest) for horizon in comparison.horizons(chosen)})
    for objective in relaxed.objectives(contest, horizons, returns):
        step = stages(f"relaxed optimum: {objective.name}", contest.episodes)
        with _noted(comparison, objective.name):
            optima = relaxed.solve(contest, objective, workers, step, earliest)
            comparison.relaxed[objective.name] = optima
            if isinstance(objective, MinimumTime):
                earliest = [optimum.arrival for optimum in optima]
            # What a craft cannot do is a result; what the optimiser cannot find is a failure.
            late = [optimum for optimum in optima if optimum.too_early]
            if late:
                comparison.notes.append(
                    f"{objective.name}: impossible from {len(late)} of {counted(len(optima), 'start')}, "
                    f"whose least time is at least {min(earliest[k.start] for k in late):.3g} s."
                )
            lost = [
                optimum.status for optimum in optima if not (optimum.solved or optimum.too_early)
            ]
            if lost:
                comparison.failures.append(
                    f"{objective.name}: no trajectory from {len(lost)} of {counted(len(optima), 'start')} "
                    f"({'; '.join(sorted(set(lost)))})."
                )


def _find_certified(
    comparison: Comparison, count: int, cache: Path | None, stages: Stages, workers: int | None
) -> None:
    """Add certified bounds of the first starts to a comparison, or the reason for which there are none."""
    contest = comparison.contest
    events = comparison.events()
    count = min(count, contest.episodes)
    note = comparison.notes.append
    with _noted(comparison, "certified bounds"):
        found = certificates().first_starts(contest, count, events, cache, workers, stages, note)
        for answer in found:
            # Answers come as they are found; their order in files must not depend on it.
            comparison.certified.append(answer)
            comparison.certified.sort(key=lambda bound: (bound.start, events.index(bound.event)))
