"""A comparison in numbers: rows for the page, the terminal and the JSON file.

Keys of `to_json` and headings of scores are an interface: campaigns, reports and pages read them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, astuple
from typing import Any

import numpy as np

from rans.base.errors import counted
from rans.base.files import environment
from rans.base.table import Table
from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.contest import Entry, Spending
from rans.evaluation.compare.run import Comparison, Relaxed
from rans.evaluation.measure.aggregate import estimated
from rans.evaluation.measure.metrics import further_samples
from rans.evaluation.measure.statistics import Bootstrap, Estimate, figure, share
from rans.show.palette import series_style
from rans.tasks.base import Task
from rans.tasks.quantities import QUANTITIES

Scores = dict[str, Estimate]
"""By heading, unit included."""

_IMPULSE = "impulse of the episode, N s"
"""Heading of the impulse that every contestant has."""

RETURN = "return, % of relaxed optimum"
"""Heading of the share of what is possible in the task's own reward."""
_DETAILS = (
    "first in the goal set",
    "impulse until then",
    "impulse over the bound",
    RETURN,
)
"""Beginnings of the names of scores that `short_table` leaves out, as it does errors."""


def measures(task: Task) -> dict[str, Callable[[Entry], np.ndarray]]:
    """Measures that are compared start by start, by heading.

    Missions that end have other measures: when they succeed without breaking a limit, and what they spend. Values
    are (N,).

    Headings are those of pages and files.
    """
    if task.can_be_won:
        return {
            "time of success, s": lambda entry: entry.success,
            _IMPULSE: lambda entry: entry.thrust,
            "return": lambda entry: entry.returns,
        }
    return {
        "settling time, s": lambda entry: entry.settling,
        "first in the goal set, s": lambda entry: entry.arrival,
        "impulse until then, N s": lambda entry: entry.arrival_thrust,
        _IMPULSE: lambda entry: entry.thrust,
        "return": lambda entry: entry.returns,
    }


def scores(
    entry: Entry,
    bootstrap: Bootstrap,
    optimum: np.ndarray | None = None,
    mission: Spending | None = None,
) -> Scores:
    """Medians where a flight may never get there, means elsewhere; for the optimum see `best_returns`."""
    if entry.ends:
        result = _mission_scores(entry, bootstrap)
    else:
        result = _goal_scores(entry, bootstrap)
    if mission is not None:
        ratios = mission.ratios(entry)
        result[f"{mission.spending} over the bound"] = _mean(ratios)
        worst = float(ratios.max(initial=-math.inf)) if len(ratios) else math.nan
        result[f"{mission.spending} over the bound, worst"] = Estimate(worst, worst, worst)
    if optimum is not None:
        solved = np.isfinite(optimum)
        ratio = Bootstrap(int(solved.sum())).ratio(entry.returns[solved], optimum[solved])
        result[RETURN] = ratio.scaled(100.0)
    return result


def _mission_scores(entry: Entry, bootstrap: Bootstrap) -> Scores:
    """Scores of a mission, without errors at the end, because its flights end at different times."""
    result = {"mission won, %": share(entry.won).scaled(100.0), **_broken(entry)}
    result |= _further_scores(entry, bootstrap)
    result["time of success, s"] = bootstrap.median(entry.success)
    spent = entry.thrust[entry.won]
    result["impulse of successes, N s"] = _mean(spent)
    result[_IMPULSE] = bootstrap.mean(entry.thrust)
    return result


def _further_scores(entry: Entry, bootstrap: Bootstrap) -> Scores:
    """Key metrics of installed packages (`rans.evaluation.measure.metrics.FURTHER`)."""
    return {
        f"{sample.name}, {sample.unit}" if sample.unit else sample.name: estimated(
            sample, bootstrap
        )
        for sample in further_samples(entry.flight)
        if sample.key
    }


def _mean(values: np.ndarray) -> Estimate:
    """Mean of some flights; NaN if there are none."""
    return Bootstrap(len(values)).mean(values) if len(values) else Estimate(*(math.nan,) * 3)


def _broken(entry: Entry) -> Scores:
    """Share of flights that broke a limit, of a task with limits."""
    broken = entry.flight.violated() if entry.flight.margins else None
    return {} if broken is None else {"limit broken, %": share(broken).scaled(100.0)}


def _goal_scores(entry: Entry, bootstrap: Bootstrap) -> Scores:
    """Scores of a task that lasts to the end of the episode, by headings with units."""
    result = {"solved, %": share(np.isfinite(entry.settling)).scaled(100.0), **_broken(entry)}
    for name, of in measures(entry.flight.task).items():
        if name not in (_IMPULSE, "return"):
            result[name] = bootstrap.median(of(entry))
    result[_IMPULSE] = bootstrap.mean(entry.thrust)
    for name, error in entry.errors.items():
        factor, unit = QUANTITIES[name].display
        result[f"{name} error, {unit}"] = bootstrap.mean(factor * error)
    return result | _further_scores(entry, bootstrap)


def scoreboard(comparison: Comparison) -> dict[str, Scores]:
    """The scores of every contestant over all starts."""
    bootstrap = Bootstrap(comparison.contest.episodes)
    optimum = best_returns(comparison)
    mission = comparison.mission
    return {entry.name: scores(entry, bootstrap, optimum, mission) for entry in comparison.entries}


def score_table(comparison: Comparison) -> Table:
    """The scores with their intervals, a column a contestant."""
    board = scoreboard(comparison)
    keys = dict.fromkeys(key for row in board.values() for key in row)
    rows = [
        (key, *(row[key].text() if key in row else None for row in board.values())) for key in keys
    ]
    colours = {entry.name: series_style(k)[0] for k, entry in enumerate(comparison.entries)}
    return Table(("score", *board), rows, "Scores over all starts", colours=colours)


def short_table(comparison: Comparison) -> Table:
    """A row a contestant, then a relaxed optimum, with the scores that decide, without intervals."""
    board = scoreboard(comparison)
    keys = dict.fromkeys(key for row in board.values() for key in row)
    chosen = [key for key in keys if not (key.startswith(_DETAILS) or " error, " in key)]
    rows = [
        (name, *(figure(row[key].value) if key in row else None for key in chosen))
        for name, row in board.items()
    ]
    for optimum in _bound_summary(comparison):
        values = {
            "solved, %": 100.0 * optimum["solved"] / optimum["starts"],
            "settling time, s": optimum["median_settling_time"],
            _IMPULSE: optimum["mean_impulse"],
        }
        rows.append(
            (
                optimum["contestant"],
                *(None if values.get(key) is None else figure(values[key]) for key in chosen),
            )
        )
    note = "Relaxed: thrusters may open partly, and the future is known." * bool(comparison.relaxed)
    return Table(("contestant", *chosen), rows, comparison.contest.title(), note, right=chosen)


def best_returns(comparison: Comparison) -> np.ndarray | None:
    """Returns of the relaxed reward optimum, (N,), NaN where none was found; None if nowhere."""
    for rows in comparison.relaxed.values():
        totals = np.array([row.total for row in rows])
        if rows[0].objective == "reward" and np.isfinite(totals).any():
            return totals
    return None


def differences(comparison: Comparison) -> dict[str, Scores]:
    """Median over starts of everybody's score less that of the first contestant from the same start."""
    first = comparison.entries[0]
    measured = measures(comparison.contest.task).items()
    bootstrap = Bootstrap(comparison.contest.episodes)
    return {
        entry.name: {name: bootstrap.difference(of(entry), of(first)) for name, of in measured}
        for entry in comparison.entries[1:]
    }


def _signs(comparison: Comparison) -> dict[tuple[str, str], tuple[int, int]]:
    """Signs of the differences in time and impulse of every two contestants: -1 where the first surely has less.

    It is 1 where it surely has more, else 0. Sure is what the 95 % intervals of the differences from the same
    starts leave no doubt of, which takes at least six starts; of fewer there is none.
    """
    if comparison.contest.episodes < _FEWEST:
        return {}
    bootstrap = Bootstrap(comparison.contest.episodes)

    def sign(ours: np.ndarray, theirs: np.ndarray) -> int:
        difference = bootstrap.difference(ours, theirs)
        return int(difference.low > 0.0) - int(difference.high < 0.0)

    return {
        (one.name, other.name): (
            sign(_times(one), _times(other)),
            sign(one.thrust, other.thrust),
        )
        for one, other in itertools.permutations(comparison.entries, 2)
    }


def dominations(comparison: Comparison) -> list[tuple[str, str]]:
    """Pairs of contestants of which the first is surely quicker and cheaper than the second, and always arrives."""
    reliable = {entry.name for entry in comparison.entries if np.isfinite(_times(entry)).all()}
    signs = _signs(comparison).items()
    return [pair for pair, sign in signs if sign == (-1, -1) and pair[0] in reliable]


def recommended(comparison: Comparison) -> str:
    """Name of the contestant that `verdict` says to take; "" if there is none."""
    first = next(iter(verdict(comparison)), "")
    return next((one.name for one in comparison.entries if f"Take {_figures(one)}" in first), "")


def verdict(comparison: Comparison) -> list[str]:
    """What to take, in at most three sentences, by time, impulse and lost flights; none with one contestant.

    Only who solves every flight is recommended or dominates others.
    """
    episodes = comparison.contest.episodes
    entries = comparison.entries
    if len(entries) < 2:
        return []
    if episodes < _FEWEST:
        return [
            f"Nobody is shown to be quicker or cheaper than another from {counted(episodes, 'start')}: at 95 % "
            f"that takes {_FEWEST} or more."
        ]
    solved = {entry.name: np.isfinite(_times(entry)) for entry in entries}
    losing = {name: one for name, one in solved.items() if not one.all()}
    lost = ", ".join(f"{name} ({100.0 * one.mean():.3g} %)" for name, one in losing.items())
    unsolved = [f"Not all flights solved, and so not recommended: {lost}."] if losing else []
    reliable = [entry for entry in entries if entry.name not in losing]
    if not reliable:
        return [f"Nobody solves all of {counted(episodes, 'start')}: {lost}."]
    # Of those whom nobody dominates, the one that dominates more, then the one that is no slower than more others
    # and cheaper, then the least product of time and impulse.
    pairs = dominations(comparison)
    beaten = {loser for _, loser in pairs}
    beats = {entry.name: [other for one, other in pairs if one == entry.name] for entry in entries}
    signs = _signs(comparison)
    # An agent at another trade-off is no rival.
    as_quick = {
        one.name: [
            other
            for other in reliable
            if other.name.partition("#")[0] != one.name.partition("#")[0]
            and signs.get((one.name, other.name)) == (0, -1)
        ]
        for one in reliable
    }
    best = min(
        (entry for entry in reliable if entry.name not in beaten),
        key=lambda entry: (
            -len(beats[entry.name]),
            -len(as_quick[entry.name]),
            np.median(_times(entry)) * entry.thrust.mean(),
        ),
    )
    relations = []
    if beats[best.name]:
        relations.append(f"quicker and cheaper than {_names(beats[best.name])}")
    for other in as_quick[best.name]:
        ratio = best.thrust.mean() / other.thrust.mean()
        relations.append(
            f"not significantly slower than {other.name}, at {ratio:.2f} of its impulse"
        )
    text = "; ".join(relations) or "nobody is shown to be quicker and cheaper (95 %)"
    # Who is quicker, and who is cheaper, if time or impulse alone counts.
    ends = {
        "quickest": min(reliable, key=lambda entry: float(np.median(_times(entry)))),
        "cheapest": min(reliable, key=lambda entry: float(entry.thrust.mean())),
    }
    others = [f"{word} {_figures(one)}" for word, one in ends.items() if one is not best]
    ranked = [f"If one counts alone: {', '.join(others)}."] if others else []
    return [f"Take {_figures(best)}: {text}.", *ranked, *unsolved]


def _figures(entry: Entry) -> str:
    """Name of a contestant, its median time and mean impulse."""
    return f"{entry.name} ({np.median(_times(entry)):.3g} s, {entry.thrust.mean():.3g} N s)"


_FEWEST = 6
"""Fewest starts whose differences show a sign at 95 %: where either sign is as likely, n of them all have the same
one with a probability of 2^(1-n), which is 6.3 % of five and 3.1 % of six."""


def _times(entry: Entry) -> np.ndarray:
    """When each flight has done its task, s, (N,); infinite: never."""
    return entry.success if entry.ends else entry.settling


def _names(names: Sequence[str]) -> str:
    *before, last = names
    return f"{', '.join(before)} and {last}" if before else last


def gaps(comparison: Comparison) -> dict[str, dict[str, np.ndarray]]:
    """Scores over certified bounds, by event and contestant, from the event's certified starts; 1 cannot be beaten.

    Every score is divided by the bound of its own event. A flight counts at a horizon if it has been in the
    goal set by then (`Entry.thrust_by`), and is infinite if not. Starts whose bound is infinite (nobody can be
    there) or 0 are left out.
    """
    events = comparison.events()
    return {e.text: _ratios(comparison, e) for e in events if comparison.certified_starts(e)}


def _ratios(comparison: Comparison, event: Event) -> dict[str, np.ndarray]:
    """Contestants' and the best found amounts of an event over its certified lower bound, (starts,), 1 at best."""
    lower, upper = comparison.bounds(event)
    possible = np.isfinite(lower) & (lower > 0)
    starts = np.array(comparison.certified_starts(event))[possible]
    lower = lower[possible]
    result = {entry.name: entry.amounts(event)[starts] / lower for entry in comparison.entries}
    best = upper[possible] / lower
    return result | ({"best found": best} if np.isfinite(best).any() else {})


def gap_table(gaps: dict[str, dict[str, np.ndarray]], title: str) -> Table:
    """A row a contestant: median multiples of each event's bound, and from how many starts it was there."""
    names = dict.fromkeys(name for ratios in gaps.values() for name in ratios)
    rows = [(name, *(_middle(one.get(name)) for one in gaps.values())) for name in names]
    return Table(("contestant", *gaps), rows, title)


def _middle(ratios: np.ndarray | None) -> str | None:
    if ratios is None or not ratios.size:
        return None
    return f"{figure(float(np.median(ratios)))} ({np.isfinite(ratios).sum()} of {len(ratios)})"


def relaxed_table(comparison: Comparison) -> Table:
    """A row for each relaxed optimum: from how many starts it was solved, and medians."""
    rows = []
    for name, optima in comparison.relaxed.items():
        solved = [optimum for optimum in optima if optimum.solved]
        middle = [_median(solved, key) for key in ("arrival", "settling", "thrust", "total")]
        worst = max((optimum.replay_error for optimum in solved), default=None)
        late = sum(optimum.too_early for optimum in optima)
        count = f"{len(solved)} of {len(optima)}" + (f"; {late} not searched" if late else "")
        rows.append((name, count, *middle, worst, _median(solved, "seconds")))
    medians = ("at the goal, s", "settling time, s", "impulse, N s", "return")
    columns = ("objective", "solved", *medians, "largest replay error, m", "solve time, s")
    return Table(columns, rows, "Relaxed optima: medians")


def _median(rows: list[Relaxed], key: str) -> float | None:
    values = [value for value in (getattr(row, key) for row in rows) if not math.isnan(value)]
    return float(np.median(values)) if values else None


def to_json(comparison: Comparison, text: str) -> dict[str, Any]:
    """Content of compare.json in SI units, of which `rans report` and campaigns read rows by these keys."""
    board = scoreboard(comparison)
    result = outcome(comparison, board)
    return (
        result
        if not comparison.entries
        else result
        | {
            "text": text,
            "engine": comparison.contest.engine,
            "estimates": _estimates(board),
            "dominations": dominations(comparison),
            "differences_from_first": _estimates(differences(comparison)),
            "contestants": {
                e.name: {"knows": e.contestant.knows, "tuning": e.contestant.tuning}
                for e in comparison.entries
            },
            "certified": {
                "starts": comparison.certified_starts(),
                "horizons": comparison.horizons(),
                "events": {event.text: event._asdict() for event in comparison.events()},
                "gaps": {
                    question: {name: ratios.tolist() for name, ratios in result.items()}
                    for question, result in gaps(comparison).items()
                },
            },
            "per_start": {
                "contestants": {e.name: [*_starts(e)] for e in comparison.entries},
                "relaxed": {
                    name: [asdict(row) for row in rows] for name, rows in comparison.relaxed.items()
                },
                "certified": [asdict(bound) for bound in comparison.certified],
                "mission": None if comparison.mission is None else comparison.mission.to_json(),
            },
            "environment": environment(),
        }
    )


def outcome(comparison: Comparison, board: dict[str, Scores]) -> dict[str, Any]:
    """Arrivals and failures of a comparison, as `rans.show.pages.report.comparison_section` reads them."""
    rows = [*_summary(comparison, board), *_bound_summary(comparison)]
    return {
        "title": comparison.contest.title(),
        "summary": rows,
        "is_partial": comparison.is_partial or bool(comparison.waiting),
        "notes": comparison.notes,
        "failures": comparison.failures,
    }


def _estimates(table: dict[str, Scores]) -> dict[str, dict[str, tuple[float, ...]]]:
    return {
        name: {key: astuple(estimate) for key, estimate in row.items()}
        for name, row in table.items()
    }


def _summary(comparison: Comparison, board: dict[str, Scores]) -> Iterator[dict[str, Any]]:
    """Row of each contestant for reports; `outcome` heads the file with them."""
    for entry in comparison.entries:
        times = _times(entry)
        row = board[entry.name]
        yield {
            "contestant": entry.name,
            "kind": "controller",
            "ends": entry.ends,
            "starts": len(times),
            "flown": len(times),
            "solved": int(np.isfinite(times).sum()),
            "median_settling_time": float(np.median(times)),
            "mean_impulse": row[_IMPULSE].value,
            "return_percent": row[RETURN].value if RETURN in row else None,
        }


def _bound_summary(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Relaxed optima as rows of the summary, each over all starts.

    Keys are those of `_summary` where both have them.
    """
    for name, rows in comparison.relaxed.items():
        solved = [row for row in rows if row.solved]
        yield {
            "contestant": f"{name} (relaxed)",
            "kind": "bound",
            "starts": len(rows),
            "flown": len(solved),
            "too_early": sum(row.too_early for row in rows),
            "solved": sum(math.isfinite(row.settling) for row in solved),
            "median_settling_time": _median(solved, "settling"),
            "mean_impulse": float(np.mean([row.thrust for row in solved])) if solved else None,
        }


def _starts(entry: Entry) -> Iterator[dict[str, Any]]:
    """Results of a contestant as data, a row for each start in SI units; what never happened is infinite.

    Keys of compare.json, which campaigns read.
    """
    for k, failed in enumerate(entry.flight.failed()):
        row: dict[str, Any] = {
            "start": k,
            "failed": bool(failed),
            "settling_time": float(entry.settling[k]),
            "arrival": float(entry.arrival[k]),
            "arrival_for_good": float(entry.staying[k]),
            "thrust_to_arrive": float(entry.arrival_thrust[k]),
            "thrust": float(entry.thrust[k]),
            "return": float(entry.returns[k]),
        }
        if entry.ends:
            row |= {
                "won": bool(entry.won[k]),
                "limit_broken": bool(entry.flight.violated()[k]),
                "time_of_success": float(entry.success[k]),
            }
        else:
            row["errors"] = {name: float(error[k]) for name, error in entry.errors.items()}
        yield row
