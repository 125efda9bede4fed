"""A comparison as one HTML page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from rans.errors import counted
from rans.evaluation.compare.front import Front
from rans.evaluation.compare.run import Comparison
from rans.files import environment
from rans.flight import Flight, fly
from rans.show.figures import comparison_figures as figures
from rans.show.figures.front_figure import front_figure
from rans.show.pages.page import Finding, Page, Picture, Section, Table, header
from rans.show.pages.report import comparison_section
from rans.show.tables import comparison_tables as tables
from rans.show.tables import front_tables

TEXT = (
    "All fly the same craft from the same starts at the same rate. Arrival is the first instant in the goal "
    "set: within the task's tolerances and, for a pose or position, at rest (5 cm/s, 5 degrees/s). Nothing is "
    "said of later instants: a flight is at rest for good if it is in the goal set at all of them too. "
    "Settling is when the errors enter their tolerances for good. Thrust-time is force times open time, summed "
    "over the thrusters. A flight that never gets there counts as infinitely late. Medians and means stand with "
    "95 % bootstrap intervals over starts, settled and failed with Wilson's, latency with the middle 90 % of the "
    "actions. Certified bounds hold for every on/off controller at this rate; relaxed optima may throttle, "
    "know the future and are only locally optimal."
)
"""The protocol in short; docs/protocol.md has all of it."""

_FRONT = (
    "Time is the mean of when flights are first at rest in the goal set (one that never is counts with the "
    "whole episode), impulse the mean thrust-time of the whole episode. Positions of a trade-off are joined by "
    "straight lines. A trade-off dominates whoever spends more than the line at the same time and takes longer "
    "than the line with the same impulse, if at both places the line is as accurate and as often there."
)
_FRONT_BOUNDS = (
    " Bounds are means over {starts}. A bar is the least impulse of being at rest in the goal set at this "
    'instant, the same from each start, and nothing spent afterwards. "Over its bound" divides by the least '
    'impulse of being there when the flight was, start by start: "until there" is the same event above and '
    "below; the whole episode has to hold the pose as well, which is in no bound."
)


def page(comparison: Comparison, command: str = "") -> Page:
    """Whatever the comparison holds, failures on top, and the command that made it."""
    sections = [_summary(comparison)]
    contest = comparison.contest
    if comparison.entries:
        errors = Picture.of(
            figures.final_error_curves(comparison.entries),
            "Distribution of final errors over all starts.",
        )
        if comparison.front:
            sections.append(_front(comparison, comparison.front))
        sections += [
            _plane(comparison),
            *_gaps(comparison),
            _starts(comparison),
            Section("Final errors", pictures=[errors]),
            _returns(comparison),
            *_differences(comparison),
        ]
    if comparison.relaxed:
        columns = (
            "objective",
            "solved",
            "arrival, s",
            "settling, s",
            "thrust-time, N s",
            "return",
            "largest replay error, m",
            "solve time, s",
        )
        sections.append(
            Section(
                "Relaxed optima",
                "Flown in Drake before they are reported; medians.",
                [Table(columns, tables.relaxed_rows(comparison))],
            )
        )
    return Page(
        f"Comparison: {contest.title()}",
        sections,
        header(
            {
                "command": command,
                "task": type(contest.task).__name__,
                "spacecraft": contest.craft.name,
                "motion by": contest.engine,
                "environment": environment(),
            }
        ),
    )


def _summary(comparison: Comparison) -> Section:
    board = tables.scoreboard(comparison)
    findings = [*comparison_section(tables.outcome(comparison, board)).findings]
    if comparison.certified_starts():
        findings.append(Finding("No flight beats a certified bound.", not comparison.impossible()))
    headings = dict.fromkeys(key for row in board.values() for key in row)
    rows = [[key, *(row[key].text() for row in board.values())] for key in headings]
    made = [[e.name, e.contestant.knows, e.contestant.tuning] for e in comparison.entries]
    found = (
        [
            Table(("score", *board), rows, "Scores over all starts"),
            Table(("contestant", "knows", "tuning"), made, "What it took"),
        ]
        if rows
        else []
    )
    return Section("Contestants", TEXT, found, findings=findings)


def _front(comparison: Comparison, front: Front) -> Section:
    """The figure, everybody's place in it, and who dominates whom."""
    starts = front.starts()
    text = _FRONT + (_FRONT_BOUNDS.format(starts=counted(len(starts), "start")) if starts else "")
    picture = Picture.of(
        front_figure(front, comparison.curve), "Time first at rest against impulse."
    )
    findings = [Finding(sentence) for sentence in front_tables.sentences(front)]
    if starts:
        findings.append(
            Finding("No flight beats the certified front.", not list(front.impossible()))
        )
    return Section(
        "Front of time and impulse", text, [Table(*front_tables.table(front))], [picture], findings
    )


def _plane(comparison: Comparison) -> Section:
    text = (
        (
            "Left of the line no controller's median can be. The bars are medians of what each start needs "
            "at least to be there at the marked time: from no start does less suffice, but who is quick from "
            "some starts and late from others may have a median below a bar. The dotted line only guides the "
            "eye."
        )
        if comparison.certified_starts()
        else ""
    )
    picture = Picture.of(
        figures.plane(comparison), "Time and thrust-time to the goal set, with 95 % intervals."
    )
    return Section("Time and thrust", text, pictures=[picture])


def _gaps(comparison: Comparison) -> Iterator[Section]:
    gaps = tables.gaps(comparison)
    if not gaps:
        return
    starts = comparison.certified_starts()
    bounds = []
    for event in comparison.events():
        lower, upper = (bound.values for bound in comparison.bounds(event))
        best = float(np.median(upper))
        closed = (upper <= lower + 1e-9).sum()
        proven = None if event.kind != "arrival" else f"{closed} of {len(lower)}"
        bounds.append(
            [event.text, float(np.median(lower)), best if np.isfinite(best) else None, proven]
        )
    text = (
        f"From {counted(len(starts), 'start')}, times the certified lower bound of the same event: 1 "
        "cannot be beaten. Who settles must first be slow enough to stay, and the bound of settling is "
        "of that moment; that of arrival for good is the greater one of arrival and settling. Thrust-time by "
        "a time is all that is spent until then by flights that have been in the goal set by then, in brackets "
        "how many; it is infinite for the others."
    )
    first, *_, last = events = comparison.events()
    middle = [event for event in events if event.kind != "arrival"]
    shown = [event.text for event in (first, *middle, last)]
    yield Section(
        "Gaps to the certified bounds",
        text,
        [
            Table(
                ("event", *tables.gap_names(gaps)),
                tables.gap_rows(gaps),
                "Median multiple of the bound",
            ),
            Table(
                ("question", "certified bound, median", "best found, median", "proven optimal"),
                bounds,
                "The bounds (s and N s)",
            ),
        ],
        [
            Picture.of(
                figures.gap_histograms(gaps, shown), "Flights from each start over the bound."
            )
        ],
    )


def _starts(comparison: Comparison) -> Section:
    """The median and the worst start of the first contestant, with the controls found where there are."""
    candidates = comparison.certified_starts() or list(range(comparison.contest.episodes))
    ranking = sorted(candidates, key=lambda k: comparison.entries[0].arrival[k])
    chosen = dict.fromkeys((ranking[(len(ranking) - 1) // 2], ranking[-1]))
    pictures = [
        Picture.of(figures.side_by_side([*_flights(comparison, k)]), f"Start {k}.") for k in chosen
    ]
    text = (
        f"The median and the slowest start of {comparison.entries[0].name}, everybody side by side."
    )
    return Section("Paths", text, pictures=pictures)


def _flights(comparison: Comparison, k: int) -> Iterator[tuple[str, Flight, int]]:
    contest = comparison.contest
    for entry in comparison.entries:
        yield entry.name, entry.flight, k
    last = comparison.horizons()[-1]
    for answer in comparison.certified:
        if answer.start == k and answer.commands is not None and answer.horizon in (None, last):
            name = (
                "least time found"
                if answer.horizon is None
                else f"least thrust by {last:g} s found"
            )
            steps = iter(np.array(answer.commands, dtype=float)[:, None])
            script: Any = SimpleNamespace(
                name=name, reset=lambda _: None, act=lambda *_, left=steps: next(left)
            )
            until = replace(contest.timing, episode_steps=len(answer.commands))
            yield name, fly(contest.craft, contest.task, script, contest.start(k), until), 0


def _returns(comparison: Comparison) -> Section:
    text = (
        "Latency is the processor time of one action for one observation, median and middle 90 % over "
        "the first fifth of a few flights."
    )
    title = "Latency"
    optimum = tables.best_returns(comparison)
    if optimum is not None:
        title = "Return and latency"
        known = np.isfinite(optimum)
        text += (
            f" The return is the task's own reward, from {known.sum()} of "
            f"{counted(len(known), 'start')}; 100 % is its relaxed optimum from there, which may "
            "throttle; the mean of the former over the mean of the latter."
        )
    picture = Picture.of(figures.shares_and_latency(tables.scoreboard(comparison)), f"{title}.")
    return Section(title, text, pictures=[picture])


def _differences(comparison: Comparison) -> Iterator[Section]:
    between = tables.differences(comparison)
    if not between:
        return
    first = comparison.entries[0].name
    rows = [
        [name, *(estimate.text("+.3g") for estimate in row.values())]
        for name, row in between.items()
    ]
    yield Section(
        "Paired differences",
        f"Everybody less {first} from the same start: median over starts, "
        f"with its interval; 0 where neither gets there, never where only {first} does, -never "
        f"where only {first} does not.",
        [Table(("contestant", *tables.measures(comparison.contest.task)), rows)],
    )
