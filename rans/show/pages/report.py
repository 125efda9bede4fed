"""The report of a run: everything its folder holds, on one page.

Files in a run folder may be of older versions or a stranger's: every value is checked, and texts are never markup.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rans.base.errors import ConfigError, Late, brief, counted, meant_file
from rans.base.files import (
    environment,
    folders_with,
    inside,
    number,
    read_text,
    reading,
)
from rans.base.registry import Registry
from rans.base.table import Table
from rans.episode.flight import Flight
from rans.evaluation.measure.aggregate import COLUMNS, Metrics
from rans.evaluation.measure.statistics import WANTED, figure, too_few
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import read_spacecraft
from rans.show.charts import learning_charts
from rans.show.pages.chart import Chart, Mark, Series
from rans.show.pages.page import Fact, Page, Picture, Section, header, named, show
from rans.show.pages.race import median_and_slowest
from rans.show.palette import series_style

SOLVED_SHARE = 100.0 * WANTED
"""Share of episodes, %, from which a task counts as solved."""

SECTIONS: Registry[Callable[[Path, Any], Section | None]] = Registry(
    "section of a report", "rans.report_sections"
)
"""Sections that installed packages add, by the name of a JSON file in a run folder, or by a pattern of names:
functions of the file and its content, which return None where there is nothing to say. Packages may share a
pattern."""

_KEY_METRICS = (
    "solved",
    "settling time",
    "failed",
    "position error",
    "attitude error",
    "impulse",
    "duty",
)
"""Metrics of an evaluation that belong into a summary, the most telling first."""

_PROGRESS = (
    ("steps", "environment steps", "{:,}"),
    ("seconds", "training time", "{:.1f} s"),
    ("success", "episodes solved", "{:.1%}"),
)
"""Keys of ``metrics.jsonl`` that belong into a summary, what they are and how they are shown."""


def report_from_run(run: Path) -> Page:
    """The report of whatever a run folder holds; what is missing is left out.

    A run may hold ``config.json``, ``validation.json`` (checks), ``metrics.jsonl`` (training),
    ``evaluation.json`` (one or several `Metrics`), ``evaluation.svg``, ``episode.svg``, the same of
    protocols and tasks, as ``evaluation-paper.json``, ``compare.json``, and the files of installed
    packages (`SECTIONS`).
    `ConfigError` if there is no such folder or it holds no results, or a file is damaged or a link, or
    a picture does more than to draw.
    """
    sections = [section for _, section in sections_of(run)]
    if not sections:
        missing = f", there is no such folder{meant_file(run)}"
        if run.exists():
            missing = folders_with(run, ["compare.json", "evaluation*.json", *SECTIONS])
            if file := next(iter(sorted(run.glob("*.csv"))), None):
                missing += (
                    f" (flights of a file are compared first: rans compare mission:dock-3d {file})"
                )
        raise ConfigError(
            f"{run} holds no results to report{missing}; rans train, evaluate, compare, stress and assure "
            "write them."
        )
    # What made the run stands on top.
    makers = ("config.json", "validation.json", "compare.json")
    header = next(filter(None, (_read(run / name, _header) for name in makers)), {})
    sections += filter(None, [_read(run / "config.json", _configuration)])
    sections[:0] = _pictured(run)
    return Page(f"RANS: {run.resolve().name}", sections, header, sheet=True)


def sections_of(run: Path) -> list[tuple[Path, Section]]:
    """The sections of the files of results in a folder, each with its file; see `report_from_run`."""
    evaluations = sorted(run.glob("evaluation*.json"), key=lambda file: file.stem)
    # How it was trained, where that is not its algorithm alone.
    method = _read(run / "config.json", lambda config: config.get("about", {}).get("method", ""))
    # A file may have several sections: a package adds to what the core says of it.
    builders: list[tuple[str, Callable[[Any], Section | None]]] = [
        ("compare.json", comparison_section),
        *((file.name, partial(_evaluation, file)) for file in evaluations),
        *(
            (file.name, partial(build, file))
            for pattern, build in SECTIONS.each()
            for file in sorted(run.glob(pattern), key=lambda file: file.stem)
        ),
        (
            "metrics.jsonl",
            partial(training_section, name=run.resolve().name, method=method),
        ),
        ("validation.json", validation_section),
    ]
    return [(run / name, s) for name, build in builders if (s := _read(run / name, build))]


def _pictured(run: Path) -> Iterator[Section]:
    """Time and impulse of a comparison, and the spacecraft; where they are, the page to fly it."""
    chart = inside(run, "compare.svg")
    if chart.is_file():
        caption = "Time and impulse of the comparison."
        yield Section("Time and impulse", pictures=[_kept_picture(chart, caption)], first=True)
    craft = inside(run, "spacecraft.toml")
    if craft.is_file():
        yield Section("Spacecraft", pictures=[layout_picture(read_spacecraft(craft))], first=True)
    page = inside(run, "fly.html")
    if page.is_file():
        yield Section("Fly it yourself", link=page.name)


def layout_picture(craft: Spacecraft) -> Picture:
    """What flies."""
    figures = Late("rans.show.figures.layout_figure")
    return Picture.of(
        lambda: figures.draw_layout(craft), f"Forces of the thrusters of {craft.name}."
    )


def solved_share(run: Path) -> float | None:
    """Share of episodes that the agent of a run folder solves, 0 to 1, by its evaluation, else by its training.

    None: neither has been written. `ConfigError` if a file is damaged.
    """
    measured = _read(run / "evaluation.json", lambda result: [*_find_metrics(result)])
    if measured and "solved" in measured[0]:
        return measured[0]["solved"].value / 100.0
    return _read(run / "metrics.jsonl", lambda rows: float(rows[-1]["success"]))


def _read(file: Path, build: Callable[[Any], Any]) -> Any:
    """A file's content by a reader; None if there is no file, or nothing in it."""
    inside(file.parent, file.name)
    if not file.is_file():
        return None
    with reading(file) as content:
        return build(content) if content else None


def validation_section(study: Mapping[str, Any]) -> Section:
    """Checks against their tolerances, of a study.

    It has ``checks`` (name, value, tolerance, unit, reason, passed) and, if known, ``title`` and
    ``skipped`` (name, reason).
    """
    checks = study["checks"]
    skipped = study.get("skipped", ())
    title = study.get("title", "Validation")
    failed = [check for check in checks if not check["passed"]]
    within = f"{len(checks) - len(failed)} of {len(checks)}"
    # A row for every check, and for those that did not run.
    columns = ("check", "value", "tolerance", "unit", "verdict", "found at", "why this tolerance")
    keys = ("name", "value", "tolerance", "unit", "passed", "worst", "reason")
    rows = [[check.get(key) for key in keys] for check in checks]
    rows += [
        [check["name"], None, None, None, "not run", None, check["reason"]] for check in skipped
    ]
    facts = [Fact("checks within tolerance", within, passed=not failed if checks else None)]
    for check in failed:
        value = f"{show(check['value'])} {check['unit']}"
        note = f"tolerance {show(check['tolerance'])}"
        facts.append(Fact(str(check["name"]), value, passed=False, note=note))
    return Section(
        "Validation",
        f"{title}. Every value must stay within its tolerance.",
        [Table(columns, rows)],
        [Picture.of(chart) for chart in _curves(study.get("curves", ()))],
        facts,
        notes=[f"Not run: {check['name']}. {check['reason']}" for check in skipped],
        folded=True,
        hero=f"{title}: {within} checks within tolerance.",
    )


def _curves(curves: Sequence[Mapping[str, Any]]) -> Iterator[Chart]:
    """Charts of the errors that a study has measured, by their figures."""
    for title in dict.fromkeys(str(curve["figure"]) for curve in curves):
        series = [
            Series(curve["name"], [*map(Mark, curve["x"], curve["y"])], *series_style(k), "solid")
            for k, curve in enumerate(curves)
            if curve["figure"] == title
        ]
        quantity, _, over = title.partition(", over ")
        yield Chart(over or "size", quantity, series, f"{title}.", logarithmic="xy")


def training_section(rows: Sequence[Mapping[str, Any]], name: str, method: Any) -> Section | None:
    """Learning curve from the lines of ``metrics.jsonl`` of a run; see `learning_charts` for their keys.

    None for rows of many trainings, as the sweeps of version 0.3 wrote them.
    """
    last = rows[-1]
    if "member" in last:
        return None
    hero = ""
    if {"success", "steps"} <= last.keys():
        hero = (
            f"{name} solved {last['success']:.1%} of its last episodes in training, after {last['steps']:,} steps; "
            "it has not flown from other starts yet."
        )
    facts = [
        Fact(what, form.format(last[key]), "domain") for key, what, form in _PROGRESS if key in last
    ]
    return Section(
        "Training",
        f"By {brief(method)}." if method else "",
        [Table(("at the end", "value"), [(fact.what, fact.value) for fact in facts])],
        [Picture.of(chart) for chart in learning_charts(rows)],
        facts,
        hero=hero,
    )


def evaluation_section(measured: Sequence[Metrics], pictures: Sequence[Picture] = ()) -> Section:
    """Metrics with their intervals, one table per flight, and figures."""
    tables = [Table(COLUMNS, [texts for _, texts in m.lines()], m.title()) for m in measured]
    text = (
        "All episodes fly to their full length and count. Steps are the states after each command. "
        "Intervals are 95 %: Wilson's of shares, and percentile bootstraps over episodes of the rest."
    )
    return Section(
        "Evaluation",
        text,
        tables,
        pictures,
        [fact for m in measured for fact in _key_metrics(m)],
        notes=[note for m in measured if (note := _doubt(m))],
        flies=True,
        hero=_headline(measured[0]) if measured else "",
    )


def evaluation_page(measured: Sequence[Metrics], flight: Flight, command: str) -> Page:
    """The result of an evaluation: its sentence and tiles, a replay of some of its flights, and all metrics."""
    sections = [evaluation_section(measured)]
    if (replay := median_and_slowest(flight, measured[0].controller)) is not None:
        sections.insert(0, Section("Replay", race=replay, first=True))
    about = header({"command": command, "environment": environment()})
    return Page(f"Evaluation: {measured[0].controller}", sections, about)


def _headline(measured: Metrics) -> str:
    """The result of an evaluation in a sentence, with the interval of what is solved."""
    solved = measured["solved"]
    hero = (
        f"{measured.controller} solves {figure(solved.value, '.4g')} % of {measured.episodes:,} episodes "
        f"({figure(solved.low)} to {figure(solved.high)} %)"
    )
    if "settling time" in measured and math.isfinite(measured["settling time"].value):
        hero += f" and settles in {figure(measured['settling time'].value)} s"
    if "impulse" in measured:
        hero += f", with {figure(measured['impulse'].value)} N s"
    return f"{hero}."


def _doubt(measured: Metrics) -> str:
    """What so few episodes cannot show, though all are solved; "" where there are enough, or some have failed."""
    return too_few(measured.episodes) if measured["solved"].value >= SOLVED_SHARE else ""


def _key_metrics(measured: Metrics) -> Iterator[Fact]:
    """Facts of an evaluation by one engine; whether enough is solved is judged where the episodes can show it."""
    engine = f"{measured.engine} engine"
    lines = {name: (value, limits) for _, (name, value, limits, _) in measured.lines()}
    for name in _KEY_METRICS:
        if name in lines:
            value, limits = lines[name]
            passed = None
            is_asked = name == "solved"
            if is_asked:
                limits += f"; at least {SOLVED_SHARE:g} % are asked"
                passed = None if _doubt(measured) else measured[name].value >= SOLVED_SHARE
            fact = Fact(f"{name}, {engine}", value, passed=passed, note=limits)
            yield fact._replace(is_asked=is_asked, leads=is_asked)
    yield Fact(f"episodes, {engine}", f"{measured.episodes:,}")


def comparison_section(comparison: Mapping[str, Any]) -> Section:
    """Contestants (see `rans.show.tables.comparison_tables.outcome`), a line each; compare.html has the rest."""
    rows = [(str(row["contestant"]), _outcome(row)) for row in comparison.get("summary", [])]
    tiles = [
        Fact(str(tile["label"]), str(tile["value"]), note=str(tile["note"]))
        for tile in comparison.get("tiles", ())
    ]
    return Section(
        "Comparison",
        f"{comparison['title']}.",
        [Table(("contestant", "outcome"), rows)],
        facts=[*tiles, *(Fact(*row) for row in rows), *_gaps(comparison)],
        failures=[*map(str, comparison["failures"])],
        notes=[*map(str, comparison.get("notes", ()))],
        link="compare.html",
        flies=True,
        hero=str(comparison.get("hero", "")),
    )


def _gaps(comparison: Mapping[str, Any]) -> Iterator[Fact]:
    """How many times the certified least the first contestant takes, by question; of a mission, what it spends."""
    if mission := comparison.get("per_start", {}).get("mission"):
        for name, estimates in [*comparison["estimates"].items()][:1]:
            ratio, *_ = estimates[f"{mission['spending']} over the bound"]
            text = f"{number(ratio):.3f} times the certified least"
            text += f", mean of the first {counted(len(mission['lower']), 'start')} that succeed"
            yield Fact(f"gap of {name}: {mission['spending']}", text, "limits")
    certified = comparison.get("certified", {})
    for question, ratios in certified.get("gaps", {}).items():
        for name, each in [*ratios.items()][:1]:
            finite = [ratio for ratio in each if math.isfinite(number(ratio))]
            text = f"never, of {counted(len(each), 'start')}"
            if finite:
                text = f"{sum(finite) / len(finite):.3f} times the certified least"
                text += f", mean of {len(finite)} of {counted(len(each), 'start')}"
            if each:
                yield Fact(f"gap of {name}: {question}", text, "limits")


def _outcome(row: Mapping[str, Any]) -> str:
    """Sentence with what a contestant of a comparison reached, from its row of compare.json."""
    verb = "succeeds" if row.get("ends") else "solves its task"
    text = f"{verb} from {row['solved']} of {counted(row['starts'], 'start')}"
    for key, what in (
        ("median_settling_time", "s (median)"),
        ("mean_impulse", "N s of thrust (mean)"),
    ):
        if math.isfinite(value := number(row.get(key))):
            text += f", {value:.2f} {what}"
    late = row.get("too_early", 0)
    lost = row["starts"] - row["flown"] - late
    text += f"; not searched from {late}, where the fastest found take longer" if late else ""
    return text + (f"; the optimiser found none from {lost}" if lost else "")


def _evaluation(file: Path, evaluation: Any) -> Section:
    """Section of an evaluation: its metrics, and those of its pictures that the folder holds."""
    pictures = []
    for name, caption in (("evaluation", "All episodes."), ("episode", "One episode.")):
        picture = inside(file.parent, f"{file.stem.replace('evaluation', name)}.svg")
        if picture.is_file():
            pictures.append(_kept_picture(picture, caption))
    section = evaluation_section([*_find_metrics(evaluation)], pictures)
    page = inside(file.parent, f"{file.stem}.html")
    link = page.name if page.is_file() else ""
    return replace(
        section,
        title=file.stem.replace("-", " ").capitalize(),
        link=link,
    )


def _kept_picture(file: Path, caption: str) -> Picture:
    """A figure from a run folder, perhaps a stranger's; `ConfigError` if it is no SVG."""
    text = read_text(file)
    if "<svg" not in text or "<!ENTITY" in text:  # entities may grow without bounds
        raise ConfigError(
            f"the picture {file} was not put into the report: it is no SVG. Delete it to have "
            "the report without it."
        )
    return Picture.of(text, caption)


def _find_metrics(result: Any) -> Iterator[Metrics]:
    """Every `Metrics` inside a JSON value, however nested."""
    if isinstance(result, dict) and {"controller", "rows"} <= result.keys():
        yield Metrics.from_json(result)
    elif isinstance(result, dict | list):
        for inner in result.values() if isinstance(result, dict) else result:
            yield from _find_metrics(inner)


def _header(content: Mapping[str, Any]) -> dict[str, str]:
    """Description of how a run was made, from its own file or that of its first result."""
    training = {key: content[key] for key in ("seed", "device", "environment") if key in content}
    return header(content.get("about", {}) | training)


def _configuration(config: Mapping[str, Any]) -> Section:
    rows = [(name, show(value)) for name, value in named(config) if not name.startswith("about.")]
    return Section("Configuration", tables=[Table(("setting", "value"), rows)], folded=True)
