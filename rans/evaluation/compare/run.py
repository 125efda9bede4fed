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

from rans.base.display import NotebookRepr
from rans.base.errors import ConfigError, RansError, counted, where_raised
from rans.base.files import first_line
from rans.base.progress import Progress, Stages, unseen_stages
from rans.evaluation.compare import entrants
from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.certificates import certificates
from rans.evaluation.compare.contest import Contest, Contestant, Entry, Spending
from rans.evaluation.problems import REFERENCES, bounding

_SLOW = ("mpc", "convex", "optimal")
"""Controllers that solve an optimal control problem at every step, and the bounds."""

_HORIZONS = (1.2, 1.6, 2.0, 3.0, 4.0, math.inf)
"""Multiples of `Comparison.least_time` by which the least impulse is certified; none is later than the end of the
episode. The floating platform's are 6, 8, 10, 15, 20 and 25 s; at 1.2 each craft tried arrives from each start."""

TYPICAL = (2.0,)
"""The one by which most controllers arrive, for comparisons that do not ask for the whole curve of impulses."""

_TYPICAL_STARTS = 64
"""Starts whose median least time is that of a typical one, however few are compared; they take milliseconds."""

_UNBOUNDED = 0.2
"""Part of an episode that stands for the least time where no bound of it is known: as of the floating platform."""


@dataclass(frozen=True)
class Relaxed:
    """Optimum of one objective from one start, with partly open thrusters; numbers without a solution are NaN."""

    objective: str
    """What is optimal: time, fuel or reward, as ``rans optimal --objective`` has it."""
    start: int
    status: str
    """Result in words."""
    solved: bool
    """Whether there is a trajectory, and the flight in Drake follows it."""
    seconds: float
    """Wall time of the optimiser."""
    arrival: float = math.nan
    """Time of arrival at the exact goal, s."""
    settling: float = math.nan
    """Time from which all errors are within their tolerances, in Drake, s."""
    thrust: float = math.nan
    """Impulse, N s."""
    total: float = math.nan
    """Sum of the task's rewards over the episode, in Drake; NaN if its control period is not the task's."""
    replay_error: float = math.nan
    """Largest distance between the optimised path and the flight in Drake, m."""
    too_early: bool = False
    """Whether it is not searched, as the fastest trajectory found from this start takes longer: no failure, and no
    proof, for that one is a local optimum."""


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

    def certified_starts(self, *events: Event) -> list[int]:
        """Numbers of the starts with a bound of each of these events; where none is named, with any bound."""
        known: dict[int, set[Event]] = {}
        for bound in self.certified:
            known.setdefault(bound.start, set()).add(bound.event)
        return [k for k in sorted(known) if known[k].issuperset(events)]

    def events(self) -> list[Event]:
        """Events that are measured and bounded: arrival and settling, and arrival by each horizon."""
        return [
            Event(),
            Event("settling"),
            *(Event(horizon=horizon) for horizon in self.horizons()),
        ]

    def bounds(self, event: Event) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of one event, s or N s, from its `certified_starts`."""
        answers = {c.start: c for c in self.certified if c.event == event}
        rows = [answers[k] for k in sorted(answers)]
        lower, upper = np.array([(c.best, c.upper) for c in rows]).reshape(-1, 2).T
        if event.kind == "settling" and rows:
            with contextlib.suppress(ConfigError):  # A task's own bounds need no certificates.
                lower = np.minimum(lower, certificates().last_watched(self.contest))
        return lower, upper

    def impossible(self) -> list[str]:
        """Sentences about flights below a certified bound, each of which would prove an error in the package."""
        return [
            f"{entry.name} beats the certified bound from start {k}: the certificate or a flight is "
            "wrong."
            for entry in self.entries
            for k in self._beaten(entry)
        ]

    def _beaten(self, entry: Entry) -> list[int]:
        beaten: set[int] = set()
        for event in self.events():
            starts = np.array(self.certified_starts(event), dtype=int)
            lower, _ = self.bounds(event)
            # Below by more than rounding.
            beaten.update(starts[entry.amounts(event)[starts] < lower - 1e-9].tolist())
        return sorted(beaten)

    def quick_and_slow(self, names: list[str]) -> tuple[list[str], list[str]]:
        """Opponents that answer in seconds, which fly first, and the slow ones after them; see `fly`."""
        slow = next((k for k, name in enumerate(names) if name in _SLOW), len(names))
        return names[:slow], names[slow:]

    def note_interrupt(self, certified: int) -> None:
        """Note the progress of an interrupted comparison, of whose starts so many were to be bounded."""
        self.is_partial = True
        stage = f' in the stage "{self.stage}"' if self.stage else ""
        flown = counted(len(self.entries), "contestant")
        complete = self.certified_starts(*self.events())
        count = len(complete if self.mission is None else self.mission.lower)
        asked = min(certified, self.contest.episodes)
        bounds = f"{count} of {asked} starts had all their bounds"
        self.notes.insert(0, f"Interrupted{stage}: {flown} had flown, and {bounds}.")

    def fly(
        self,
        contestants: Mapping[str, Contestant],
        opponents: Sequence[str],
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
            opponents: names of controllers, and "optimal".
            certified: number of starts whose bounds are certified.
            cache: JSON file that keeps bounds.
            stages: reports progress.
            workers: processes, by default one per processor.
            returns: whether the optima of the task's return are computed too, which take longer than all others.
            asked: whether somebody has named the opponents, so that one that cannot fly is a failure.
        """

        def noted(name: str, total: int | None, /) -> Progress:
            self.stage = name
            return stages(name, total)

        # Contestants first: what opponents and bounds cost is not lost with an interrupt of theirs.
        for spec, contestant in contestants.items():
            with self.noting(spec):
                self.entries.append(_entry(self, contestant, noted, workers))
        for name in dict.fromkeys(name for name in opponents if name != "optimal"):
            try:
                simple = entrants.simple_controller(name, self.contest)
            except RansError as error:
                self._ground(name, str(error), self.failures if asked else self.notes)
                continue
            with self.noting(name):
                if simple.name not in self.names():  # A controller flies once.
                    self.entries.append(_entry(self, simple, noted, workers))
        if "optimal" not in opponents:
            return
        try:
            problem = bounding(self.contest)
        except RansError as error:
            self.notes.append(f"No bound is certified: {error}")
            return
        if problem is None and self.contest.conditions is not None:
            self.notes.append(
                "Optima and bounds hold for nominal conditions; under these conditions none is claimed."
            )
        else:
            references = REFERENCES if problem is None else {"certified bounds": problem.bounds}
            said = len(self.notes) + len(self.failures)
            for name in references:
                with self.noting(name):
                    references[name](
                        self,
                        certified=certified,
                        cache=cache,
                        stages=noted,
                        workers=workers,
                        returns=returns,
                    )
            self._drop_unmeasured()
            self.failures += self.impossible()
            is_bounded = self.certified or self.mission is not None
            if problem and certified and not is_bounded and len(self.notes + self.failures) == said:
                self.notes.append(
                    f"No bound is known: the package of the optimal problem {self.contest.task.optimal_problem} "
                    "says that it bounds these starts, and gave neither a bound nor a reason."
                )

    def _drop_unmeasured(self) -> None:
        """Say which bounds are of no start or event of the comparison, and leave them out."""
        starts = range(self.contest.episodes)
        events = self.events()
        for bound in [*self.certified]:
            if bound.start not in starts or bound.event not in events:
                self.certified.remove(bound)
                self.failures.append(
                    f"{bound} is compared with nothing: it must be of a start < {len(starts)} and an event of "
                    "Comparison.events()."
                )

    @contextlib.contextmanager
    def noting(self, what: str) -> Iterator[None]:
        """Note an exception of some work as a sentence."""
        try:
            yield
        except RansError as error:
            self.failures.append(f"{error}{where_raised(error)}")
        except Exception as error:  # Solvers and users' code raise anything.
            self.failures.append(f"{what} failed: {type(error).__name__}: {first_line(error)}.")

    def _ground(self, name: str, reason: str, sentences: list[str]) -> None:
        """Say that an opponent cannot fly; those of one reason have one sentence."""
        names = self.grounded.setdefault(reason, [])
        said = f"{' and '.join(names)} cannot fly here: {reason}"
        names.append(name)
        sentences[:] = [each for each in sentences if each != said]
        sentences.append(f"{' and '.join(names)} cannot fly here: {reason}")


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
