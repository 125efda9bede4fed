"""Pareto front of time and impulse: which contestant dominates which, and distances from the bounds.

Times are in s and impulses in N s, (N,) by start; who never arrives is infinite, and never left out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rans.evaluation.compare.bounds import Bound, Event
from rans.evaluation.compare.certified import certify_each
from rans.evaluation.compare.contest import Contest, Entry
from rans.evaluation.measure.pareto import epsilon_indicator, hypervolume
from rans.evaluation.measure.statistics import Bootstrap
from rans.optimal.certificate.problem import SearchEffort
from rans.progress import Progress, unseen

_EFFORT = SearchEffort(work=5.0, nozzle_work=0.5, levels=1)
"""Effort for bounds only: controls are searched at the first level of fuel only that cannot be excluded."""
_MOST_STARTS = 64
"""Largest number of starts, whose search takes half an hour on two processors."""


class Point(NamedTuple):
    """Means of a contestant over all starts, or a linear interpolation between two contestants."""

    time: float
    """Time of the first rest in the goal set, s; without one the whole episode counts."""
    impulse: float
    """Impulse of the episode, N s."""
    error: float
    """Mean error of the position, or of the task's first quantity, over the last fifth, SI units."""
    there: float
    """Share of starts from which it comes to rest in the goal set, 0 to 1."""


def point(entry: Entry) -> Point:
    """Means of a contestant over its starts."""
    return Point(*map(float, _figures(entry).mean(axis=0)))


def _figures(entry: Entry) -> np.ndarray:
    """(N, 4), a `Point` for every start."""
    error = next(iter(entry.errors.values()))
    late = np.minimum(entry.arrival, entry.flight.times[-1])
    return np.stack([late, entry.thrust, error, np.isfinite(entry.arrival)], axis=-1)


def least(line: Sequence[Point], what: str, bounded: str, limit: float) -> Point | None:
    """Point of a polygonal line with the least ``what`` where ``bounded`` is at most the limit, or None.

    Points come in the order of the line, since only neighbours are joined.
    """
    points = [candidate for candidate in line if getattr(candidate, bounded) <= limit]
    for left, right in pairwise(line):
        begin = getattr(left, bounded)
        end = getattr(right, bounded)
        if (begin - limit) * (end - limit) < 0:
            fraction = (limit - begin) / (end - begin)
            points.append(
                Point(*(a + fraction * (b - a) for a, b in zip(left, right, strict=True)))
            )
    return min(points, key=lambda point_of_line: getattr(point_of_line, what), default=None)


class Verdict(NamedTuple):
    """Comparison of a line of trade-offs with a point."""

    thrifty: Point | None
    """Point of the line with the least impulse in the point's time; None: the line is never as quick."""
    quick: Point | None
    """Point of the line with the least time for the point's impulse; None: the line always needs more."""
    dominates: bool
    """Whether both are better than the point, and there as accurate, with at least its share of arrivals."""


def judged(line: Sequence[Point], rival: Point) -> Verdict:
    """Compare a line with a point: it dominates with less impulse in its time and less time for its impulse.

    Published verdicts rest on it: errors and arrivals count too, so that less of both is not bought by missing the
    goal.
    """
    thrifty = least(line, "impulse", "time", rival.time)
    quick = least(line, "time", "impulse", rival.impulse)
    if thrifty is None or quick is None:
        return Verdict(thrifty, quick, False)
    better = thrifty.impulse < rival.impulse and quick.time < rival.time
    as_good = all(
        side.error <= rival.error and side.there >= rival.there for side in (thrifty, quick)
    )
    return Verdict(thrifty, quick, better and as_good)


class Multiple(NamedTuple):
    """Impulse over the certified least impulse of rest in the goal set at the flight's time of arrival.

    Means over starts are divided by the mean of the bounds of the same starts.
    """

    episode: float
    """Ratio of the whole episode, which includes the impulse for holding; the bound does not."""
    until: float
    """Ratio until arrival, the event of the bound."""
    bound: float
    """Mean of the bounds, N s."""
    time: float
    """Mean time of arrival of these flights, s."""
    behind: float
    """Mean over the starts of the factor of time and impulse to the front; see `Front.behind`."""
    starts: int


class Indicators(NamedTuple):
    """Indicators of a set of flights against the certified front."""

    epsilon: float
    """Multiplicative epsilon indicator (`rans.evaluation.measure.pareto.epsilon_indicator`), median over the
    starts; 1 is the front, infinite where no flight arrives."""
    hypervolume: float
    """Dominated area, as a share of that above the certified front, mean over the starts; 1 is the front."""
    first: float
    """Time of the first point of the front, s."""
    last: float
    """Time of its last point, s."""
    starts: int


@dataclass
class Front:
    """Contestants, with all positions of trade-offs, and bounds that are computed within a budget."""

    contest: Contest
    horizons: Sequence[float]
    """Times of the points of the certified front, s."""
    entries: list[Entry] = field(default_factory=list)
    certified: list[Bound] = field(default_factory=list)

    def lines(self) -> dict[str, list[Entry]]:
        """Entries with the positions of an open trade-off, by agent, from fast to thrifty."""
        result: dict[str, list[Entry]] = {}
        for entry in self.entries:
            if entry.contestant.trade_off is not None:
                result.setdefault(entry.name.rpartition("#")[0], []).append(entry)
        return {
            agent: sorted(line, key=lambda entry: entry.contestant.trade_off or 0.0)
            for agent, line in result.items()
            if len(line) > 1
        }

    def others(self) -> list[Entry]:
        """Entries of contestants without an open trade-off."""
        names = {entry.name for line in self.lines().values() for entry in line}
        return [entry for entry in self.entries if entry.name not in names]

    def verdict(self, line: Sequence[Entry], rival: Entry) -> Verdict:
        """Comparison of a line of trade-offs with another entry."""
        return judged([*map(point, line)], point(rival))

    def chance(self, line: Sequence[Entry], rival: Entry) -> float:
        """Share of the resamples of the starts (see `Bootstrap`) in which a line dominates another entry.

        Starts are drawn together for all entries, which keeps the pairs.
        """
        figures = np.hstack([_figures(entry) for entry in (*line, rival)])
        draws = Bootstrap(len(figures)).means(figures).reshape(-1, len(line) + 1, 4).tolist()
        won = [
            judged([Point(*figures) for figures in row[:-1]], Point(*row[-1])).dominates
            for row in draws
        ]
        return sum(won) / len(won)

    def events(self, start: int) -> list[Event]:
        """Events to bound from a start: the least time, the horizons, and the time of each contestant."""
        own = (float(entry.arrival[start]) for entry in self.entries)
        horizons = dict.fromkeys([*self.horizons, *(t for t in own if 0.0 < t < math.inf)])
        return [Event(), *(Event(horizon=t) for t in horizons)]

    def questions(self) -> list[tuple[int, Event]]:
        """Events to bound, start by start."""
        limit = min(self.contest.episodes, _MOST_STARTS)
        return [(k, event) for k in range(limit) for event in self.events(k)]

    def starts(self) -> list[int]:
        """Numbers of the starts whose bounds are all known."""
        bounds = self._known()
        return [
            k
            for k in sorted({k for k, _ in bounds})
            if all((k, event) in bounds for event in self.events(k))
        ]

    def front(self) -> dict[Event, float]:
        """Mean bound over the starts: of the least time, and of impulse by each horizon.

        Only starts whose bounds are all known count, in each of the means.
        """
        bounds = self._known()
        starts = self.starts()
        return (
            {
                event: float(np.mean([bounds[k, event] for k in starts]))
                for event in (Event(), *(Event(horizon=t) for t in self.horizons))
            }
            if starts
            else {}
        )

    def multiple(self, entry: Entry) -> Multiple | None:
        """Ratio of an entry to the bounds at its own times; None if none are known.

        A ratio of sums, not a mean of ratios: a start with a small bound does not decide it.
        """
        bounds = self._known()
        starts = [k for k in self.starts() if 0.0 < entry.arrival[k] < math.inf]
        bound = sum(bounds[k, Event(horizon=float(entry.arrival[k]))] for k in starts)
        if not bound:
            return None
        return Multiple(
            float(entry.thrust[starts].sum() / bound),
            float(entry.arrival_thrust[starts].sum() / bound),
            bound / len(starts),
            float(entry.arrival[starts].mean()),
            float(np.mean([self.behind(entry, k) for k in starts])),
            len(starts),
        )

    def behind(self, entry: Entry, start: int) -> float:
        """Factor f for which it is certified that no flight arrives f times sooner with f times less impulse.

        It is the distance of one flight from the nearest point of the front, as a factor; `indicators` describe
        the rest of the front. It may be a little too large, because the front is known at some times only: a flight
        that arrives less than a period after one of them, and could have waited first, is compared with the bound
        there. From a start that moves no flight can wait, and the factor is infinite.
        """
        begun = self.contest.start(start).start
        if any(np.any(x) for x in (*begun.v.columns(), *begun.spin())):
            return math.inf
        by_horizon = {
            event.horizon or 0.0: bound for (k, event), bound in self._known().items() if k == start
        }
        period = self.contest.timing.control_period
        own = float(entry.arrival[start])
        spent = float(entry.arrival_thrust[start])
        least = by_horizon.pop(0.0)
        behind = [
            max(own / (time + period), spent / bound) for time, bound in by_horizon.items() if bound
        ]
        return min([*behind, own / least] if least else behind, default=math.inf)

    def indicators(self, entries: Sequence[Entry]) -> Indicators | None:
        """Indicators of the flights of some entries against the certified front; None if no front is known.

        From each start the set is that of (arrival, impulse until then) of all these entries. The reference are the
        bounds at the horizons at which arrival is possible. No flight dominates these points, so that the epsilon
        indicator against the true front is no larger. The area is compared with that above the bounds, where the
        front between two horizons is that of the later one, so that the share is no larger either. Its corner is
        the last horizon and twice the impulse of the first one.
        """
        certified = self._known()
        epsilons = []
        ratios = []
        first = math.inf
        for start in self.starts():
            bounds = [(t, certified[start, Event(horizon=t)]) for t in sorted(self.horizons)]
            reference = np.array([(t, b) for t, b in bounds if 0.0 < b < math.inf])
            least = certified[start, Event()]
            if not len(reference) or not 0.0 < least < math.inf:
                continue
            first = min(first, float(reference[0, 0]))
            flown = np.array(
                [(entry.arrival[start], entry.arrival_thrust[start]) for entry in entries]
            )
            epsilons.append(epsilon_indicator(flown, reference))
            corner = np.array([reference[-1, 0], 2.0 * reference[0, 1]])
            since = np.append(min(least, reference[0, 0]), reference[:-1, 0])
            above = np.column_stack([since, reference[:, 1]])
            ratios.append(hypervolume(flown, corner) / hypervolume(above, corner))
        if not epsilons:
            return None
        last = max(self.horizons)
        return Indicators(
            float(np.median(epsilons)), float(np.mean(ratios)), first, last, len(ratios)
        )

    def impossible(self) -> Iterator[str]:
        """Sentences about flights below a bound, each of which would prove an error in the package.

        Tables stand all the same; the sentence asks for a report.
        """
        bounds = self._known()
        for entry in self.entries:
            for k in self.starts():
                own = Event(horizon=float(entry.arrival[k]))
                if (
                    entry.arrival[k] < bounds[k, Event()] - 1e-9
                    or entry.arrival_thrust[k] < bounds.get((k, own), 0.0) - 1e-9
                ):
                    yield (
                        f"{entry.name} beats the certified front from start {k}: the certificate or a "
                        "flight is wrong."
                    )

    def _known(self) -> dict[tuple[int, Event], float]:
        return {
            (certificate.start, certificate.event): certificate.best
            for certificate in self.certified
        }


def certify_front(
    front: Front,
    seconds: float,
    cache: Path | None = None,
    workers: int | None = None,
    progress: Progress = unseen,
) -> None:
    """Compute bounds from one start after the other, for about ``seconds``; 0: none.

    For cache, workers and progress see `rans.evaluation.compare.certified.certify_each`.
    """
    if seconds == 0.0:
        return
    until = time.monotonic() + seconds
    for answer in certify_each(front.contest, front.questions(), _EFFORT, cache, workers, progress):
        front.certified.append(answer)
        if time.monotonic() > until:
            break
