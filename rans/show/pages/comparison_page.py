"""A comparison as one HTML page.

It draws what `rans.show.tables` computes and computes nothing itself, so that page, terminal and JSON agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.base.errors import Late, counted, is_installed
from rans.base.files import environment, write_json
from rans.base.table import Table
from rans.base.terminal import doing
from rans.episode.flight import fly
from rans.evaluation.compare.bounds import Event
from rans.evaluation.compare.run import Comparison
from rans.evaluation.measure.statistics import Estimate
from rans.show.pages.chart import Chart
from rans.show.pages.comparison_charts import margin_charts, plane_chart
from rans.show.pages.page import Fact, Page, Picture, Section, header
from rans.show.pages.race import Race, Track, gallery, has_place
from rans.show.pages.report import comparison_section, layout_picture
from rans.show.palette import FOUND
from rans.show.tables import comparison_tables as tables

if TYPE_CHECKING:
    from rans.show.figures import chart_figure
else:  # with Matplotlib, without which a page has no pictures
    chart_figure = Late("rans.show.figures.chart_figure")

TEXT = (
    "All fly the same craft from the same starts at the same rate. The settling time is that from which a flight "
    "stays within all tolerances to the end. The goal set has the states within all tolerances that are, for a "
    "pose or position, also slow (5 cm/s, 5 degrees/s); a flight may leave it again. Impulse is force times "
    "open time, summed over the thrusters. A flight that never gets there counts as infinitely late. "
    "The return is the task's own reward, of starts with a relaxed optimum as a share of its return. "
    "Medians and means stand with 95 % bootstrap intervals over starts, solved with Wilson's. "
    "Certified bounds hold for every on/off controller at this rate; relaxed optima may throttle, know the future "
    "and are only locally optimal."
)
"""The protocol in short; docs/protocol.md has all of it."""

_MISSION_TEXT = (
    "All fly the same craft from the same starts at the same rate, until the mission succeeds or fails. A flight "
    "that succeeds without breaking a limit wins; one that does not counts as infinitely late. Impulse is force "
    "times open time, summed over the thrusters. Bounds hold for every flight from the same start that succeeds "
    "by its deadline, with any control law. Shares have Wilson's 95 % intervals, the others bootstrap intervals "
    "over starts."
)
"""How to read a comparison of missions, which end with their success."""


def page(comparison: Comparison, command: str = "") -> Page:
    """Whatever the comparison holds, failures on top, and the command that made it."""
    contest = comparison.contest
    sections = [_summary(comparison)]
    if comparison.entries:
        # A replay, and what answers "against what", stand before the tables.
        race = _race(comparison)
        replay = [] if race is None else [Section("Replay", race=race, first=True)]
        sections = [
            *replay,
            *_plane(comparison),
            *sections,
            *_mission(comparison),
            *_gaps(comparison),
            *_differences(comparison),
            Section("Spacecraft", pictures=[layout_picture(contest.craft)]),
        ]
    if comparison.relaxed:
        text = "Flown in Drake before they are reported."
        sections.append(Section("Relaxed optima", text, [tables.relaxed_table(comparison)]))
    about = {
        "command": command,
        "task": type(contest.task).__name__,
        "spacecraft": contest.craft.name,
        "motion by": contest.engine,
        "environment": environment(),
    }
    title = f"Comparison: {contest.title()}"
    return Page(title, sections, header(about))


def write(
    comparison: Comparison, folder: Path, about: dict[str, Any], is_over: bool = True
) -> None:
    """Write a comparison into a folder: its numbers first, then page and chart, which take seconds.

    Args:
        comparison: what was flown.
        folder: folder of the results.
        about: see `rans.evaluation.fly.evidence.about`.
        is_over: whether page and chart are written too.
    """
    numbers = folder / "compare.json"
    result = _headline(comparison) | tables.to_json(comparison, TEXT)
    write_json(numbers, result | {"about": about}, beside=())
    comparison.files = [numbers]
    if not is_over:
        return
    with doing("drawing the page; Ctrl-C leaves it out", in_log=False):
        page(comparison, about["command"]).write(folder / "compare.html")
        comparison.files.insert(0, folder / "compare.html")
        if is_installed("matplotlib") and (chart := time_and_impulse(comparison)):
            comparison.files += chart_figure.save_chart(chart, folder / "compare")


def _mission(comparison: Comparison) -> Iterator[Section]:
    """Margins of missions with constraints, and what is spent beside its bounds, where these are known."""
    entries = comparison.entries
    result = []
    if (bounds := comparison.mission) is not None:
        title = "Over the certified least, start by start"
        result.append(Table(*bounds.table(entries), title))
    pictures = [Picture.of(chart) for chart in margin_charts(entries)]
    text = "Flights that have succeeded do not count in margins." if pictures else ""
    if pictures or result:
        yield Section("Mission", text, result, pictures)


def _headline(comparison: Comparison) -> dict[str, Any]:
    """What to take, and the first contestant's result in tiles beside the quickest of the others."""
    if not comparison.entries:
        return {}
    board = tables.scoreboard(comparison)
    first, *others = comparison.entries
    own = board[first.name]
    time = "time of success, s" if first.ends else "settling time, s"
    rival = min(
        (entry.name for entry in others),
        key=lambda name: board[name][time].value,
        default="",
    )
    tiles = []
    for key in filter(own.__contains__, _TILES):
        tiles.append(_tile(key, own[key], rival, board.get(rival, {}).get(key)))
        if key == time:
            tiles += _over_bounds(comparison)
    for tile in tiles:
        tile["note"] = f"{first.name}\n{tile['note']}"
    alone = ", ".join(f"{tile['label']} {tile['value']}" for tile in tiles[:3])
    hero = " ".join(tables.verdict(comparison)) or f"{first.name}: {alone}."
    return {"hero": hero, "tiles": tiles}


def _over_bounds(comparison: Comparison) -> Iterator[dict[str, str]]:
    """Tiles of the first contestant's ratios to what is certified as the least."""
    first = comparison.entries[0]
    mission = comparison.mission
    if mission is not None and len(multiples := mission.ratios(first)):
        yield {
            "label": f"over the certified least {mission.spending}",
            "value": f"{multiples.mean():.3f} x",
            "note": f"of {counted(len(multiples), 'start')}",
        }
    for event, ratios in [*tables.gaps(comparison).items()][:1]:
        over = float(np.median(ratios[first.name])) if ratios[first.name].size else np.inf
        yield {
            "label": f"over the certified least {event}",
            "value": f"{over:.3g} x" if np.isfinite(over) else "never",
            "note": f"of {counted(len(ratios[first.name]), 'start')}",
        }


_TILES = {
    "solved, %": "solved",
    "settling time, s": "settling time",
    "mission won, %": "mission won",
    "limit broken, %": "limit broken",
    "time of success, s": "time of success",
    "impulse of the episode, N s": "impulse of the episode",
    "position error, cm": "position error",
    "attitude error, deg": "attitude error",
}
"""Scores that are tiles, and what these call them."""


def _tile(key: str, own: Estimate, rival: str, other: Estimate | None) -> dict[str, str]:
    """Tile of a score with its interval, and that of a rival; figures are those of the table."""
    unit = key.partition(", ")[2]
    # Of one start there is no interval.
    known = np.isfinite(own.high) and own.low < own.high
    notes = [f"{own.low:.3g} to {own.high:.3g} {unit}"] if known else []
    if other is not None:
        notes.append(f"{rival} {_amount(other, unit)}")
    return {"label": _TILES[key], "value": _amount(own, unit), "note": "\n".join(notes)}


def _amount(estimate: Estimate, unit: str) -> str:
    """An estimate with its unit, or the word for what never happens."""
    number = estimate.text().partition(" ")[0]
    return number if number == "never" else f"{number} {unit}"


_GALLERY = 5
"""Worst starts of the first contestant in the replay."""
_RACERS = 8
"""Most contestants in the replay, the certified controls besides: more than fly beside a craft by default."""


def _race(comparison: Comparison) -> Race | None:
    """The median start of the first contestant and its slowest ones; None for tasks without a place."""
    contest = comparison.contest
    first, *_ = flying = comparison.entries[:_RACERS]
    if not has_place(first.flight):
        return None

    def tracks(k: int) -> list[Track]:
        """What flies from start k: contestants, then the quickest controls that certificates found."""
        own = [Track(entry.name, entry.flight, k, float(entry.arrival[k])) for entry in flying]
        return [*own, *_quickest(comparison, k)]

    caption = "The clock is common to all. Untick a name to hide it."
    if len(comparison.entries) > _RACERS:
        caption = (
            f"Of {len(comparison.entries)} contestants the first {_RACERS} fly here. {caption}"
        )
    typical = comparison.certified_starts() or range(contest.episodes)
    what = f"start of {first.name}"
    return gallery(contest.craft, what, first.arrival, tracks, typical, _GALLERY, caption)


def _quickest(comparison: Comparison, k: int) -> Iterator[Track]:
    """The controls of least time that were found from start k; an optimum only if their bounds have met."""
    contest = comparison.contest
    for answer in comparison.certified:
        if answer.start == k and answer.event == Event() and answer.commands is not None:
            steps = iter(np.array(answer.commands, dtype=float)[:, None])
            script: Any = SimpleNamespace(
                name="", reset=lambda _: None, act=lambda *_, left=steps: next(left)
            )
            until = replace(contest.timing, episode_steps=len(answer.commands))
            flight = fly(contest.craft, contest.task, script, contest.start(k), until)
            proven = answer.lower is not None and answer.upper <= answer.lower + 1e-9
            name = "certified optimum" if proven else "least time found"
            yield Track(name, flight, 0, float(flight.times[-1]), FOUND)


def _summary(comparison: Comparison) -> Section:
    """Section with the result, the scores over all starts, and what each contestant knows."""
    board = tables.scoreboard(comparison)
    said = comparison_section(_headline(comparison) | tables.outcome(comparison, board))
    facts = [*said.facts]
    if comparison.certified_starts():
        beaten = comparison.impossible()
        facts.append(
            Fact("flights that beat a certified bound", f"{len(beaten)}", passed=not beaten)
        )
    tuning = [[e.name, e.contestant.knows, e.contestant.tuning] for e in comparison.entries]
    known = Table(("contestant", "knows", "tuning"), tuning, "Information and tuning")
    return replace(
        said,
        title="Contestants",
        text=_MISSION_TEXT if comparison.entries and comparison.entries[0].ends else TEXT,
        tables=[*said.tables, tables.score_table(comparison), known] if board else [],
        facts=facts,
        link="",
    )


def time_and_impulse(comparison: Comparison) -> Chart | None:
    """Time and impulse when first in the goal set; None: missions that end have figures of their own."""
    if not comparison.entries:
        return None
    if comparison.entries[0].ends and not comparison.certified_starts(Event()):
        return None
    chart = plane_chart(comparison)
    return None if chart.is_empty else chart


def _plane(comparison: Comparison) -> Iterator[Section]:
    """Section of time and impulse when first in the goal set, above what is certified; none without flights."""
    chart = time_and_impulse(comparison)
    if chart is None:
        return
    text = (
        (
            "In the shaded range no controller's median can be. The bars are medians of what each start needs "
            "at least to be there at the marked time. No flight needs less than the bound of its own start; a "
            "median of many starts can still lie below a bar, if the contestant is early from some of them and "
            "late from others. The dotted line only guides the eye."
        )
        if len(comparison.certified_starts(Event())) > 1
        else ""
    )
    yield Section("Time and impulse", text, pictures=[Picture.of(chart)], first=True)


def _gaps(comparison: Comparison) -> Iterator[Section]:
    """Section with the certified bounds, and the multiples of them that contestants need."""
    gaps = tables.gaps(comparison)
    if not gaps:
        return
    starts = comparison.certified_starts()
    # Median bounds of every event, and how many of the first times are proven optimal.
    bounds = []
    for event in filter(comparison.certified_starts, comparison.events()):
        lower, upper = comparison.bounds(event)
        best = float(np.median(upper))
        closed = (upper <= lower + 1e-9).sum()
        proven = None if event.kind != "arrival" else f"{closed} of {len(lower)}"
        least = float(np.median(lower))
        bounds.append(
            [
                event.text,
                least if np.isfinite(least) else "impossible",
                best if np.isfinite(best) else None,
                proven,
            ]
        )
    text = (
        f"From {counted(len(starts), 'start')}, times the certified lower bound of the same event: 1 "
        "cannot be beaten. Who settles must first be slow enough to stay, and the bound of the settling time is "
        "of that moment. Impulse by a time is all that is spent until then by flights that have been in the goal "
        "set by then, in brackets how many; it is infinite for the others."
    )
    median = ", median" if len(starts) > 1 else ""
    multiples = tables.gap_table(gaps, f"Times the bound{median}")
    columns = ("question", f"certified bound{median}", f"best found{median}", "proven optimal")
    table = Table(columns, bounds, "The bounds (s and N s)")
    yield Section("Gaps to the certified bounds", text, [multiples, table])


def _differences(comparison: Comparison) -> Iterator[Section]:
    """Section with what each contestant takes less the first, start by start."""
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
