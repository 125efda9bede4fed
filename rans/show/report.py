"""Reports: one HTML file that opens offline, with the verdict on top."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import rich.table
from jinja2 import Environment, PackageLoader, StrictUndefined

from rans.errors import ConfigError
from rans.evaluation.measure.summary import COLUMNS, Metrics
from rans.files import read_json, read_json_lines, write_text
from rans.show.figures import data_uri, learning_curve, svg

SOLVED_SHARE = 99.0
"""Share of episodes, %, from which a task counts as solved."""

_KEY_METRICS = ("solved", "settling time", "failed", "position error", "attitude error", "duty")
"""Metrics of an evaluation that belong into a summary."""

_PROGRESS = (("steps", "environment steps", "{:,}"), ("seconds", "training time", "{:.1f} s"),
             ("success", "episodes solved", "{:.1%}"))
"""Keys of ``metrics.jsonl`` that belong into a summary, what they are and how they are shown."""


@dataclass(frozen=True)
class Table:
    """Rows of texts, numbers, truth values (shown as pass or FAIL) and None (shown as a dash)."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure inside the page."""

    source: str
    """See `rans.show.figures.data_uri`."""
    caption: str
    """Also read out to those who cannot see it."""


@dataclass(frozen=True)
class Finding:
    """One line of the verdict."""

    text: str
    passed: bool | None = None
    """None where there is nothing to pass."""


@dataclass(frozen=True)
class Section:
    """A heading with a paragraph, tables and pictures."""

    title: str
    text: str = ""
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    findings: Sequence[Finding] = ()
    """Go to the top of the page."""
    summary: Sequence[tuple[str, str]] = ()
    """What and how much, for the terminal."""
    link: str = ""
    """File beside the page that says more."""


@dataclass(frozen=True)
class Report:
    """Everything one page says."""

    title: str
    sections: Sequence[Section]
    header: Mapping[str, Any] = field(default_factory=dict)
    """How it was made: command, revision, versions, hardware, seeds."""

    @property
    def findings(self) -> list[Finding]:
        """The findings of all sections, failures first."""
        order = {False: 0, True: 1, None: 2}
        return sorted((f for s in self.sections for f in s.findings), key=lambda f: order[f.passed])

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return all(finding.passed is not False for finding in self.findings)

    @property
    def verdict(self) -> str:
        """In one sentence; a finding that nothing checked passes nothing."""
        if not self.passed:
            return "Something has failed."
        checked = any(finding.passed for finding in self.findings)
        return "Everything checked has passed." if checked else "Nothing was checked here."

    def summary(self) -> rich.table.Table:
        """The few most telling lines of every section, for the terminal."""
        table = rich.table.Table("part", "what", "value", title=self.title, title_justify="left")
        table.columns[1].overflow = "fold"
        for section in self.sections:
            for number, (what, value) in enumerate(section.summary):
                table.add_row("" if number else section.title, what, value)
            table.add_section()
        return table

    def html(self) -> str:
        """The page."""
        environment = Environment(loader=PackageLoader("rans.show", "."), autoescape=True,
                                  undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        environment.filters["show"] = show
        written = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        return environment.get_template("report.html.j2").render(report=self, written=written)

    def write(self, file: Path) -> None:
        """Write the page; readers see the old page or the new one, never half of one.

        Raises:
            ConfigError: the file cannot be written.
        """
        write_text(file, self.html())


def show(value: Any) -> str:
    """A table's cell as text."""
    if value is None:
        return "–"  # noqa: RUF001
    if isinstance(value, float):
        return "never" if value == math.inf else f"{value:.4g}"
    return str(value)


def report_from_run(run: Path) -> Report:
    """The report of whatever a run folder holds; what is missing is left out.

    Args:
        run: may hold ``config.json``, ``validation.json`` (checks), ``metrics.jsonl`` (training),
            ``evaluation.json`` (one or several `Metrics`), ``evaluation.svg``, ``episode.svg``, the same
            of protocols and tasks, as ``evaluation-paper.json``, and ``compare.json``.

    Raises:
        ConfigError: there is no such folder or it holds no results, or a file is damaged.
    """
    evaluations = sorted(run.glob("evaluation*.json"), key=lambda file: file.stem)
    builders: dict[str, Callable[[Any], Section]] = {
        "validation.json": validation_section,
        "metrics.jsonl": training_section,
        **{file.name: partial(_evaluation, file) for file in evaluations},
        "compare.json": comparison_section,
    }
    sections = [s for name, build in builders.items() if (s := _read(run / name, build))]
    if not sections:
        raise ConfigError(f"{run} holds no results to report; is it a run folder?")
    header = _read(run / "config.json", _header) or _read(run / "validation.json", _header) or {}
    sections += filter(None, [_read(run / "config.json", _configuration)])
    return Report(f"RANS: {run.resolve().name}", sections, header)


def _read(file: Path, build: Callable[[Any], Any]) -> Any:
    """What becomes of a file's content; None where there is no file or nothing in it."""
    if not file.is_file():
        return None
    content = read_json_lines(file) if file.suffix == ".jsonl" else read_json(file)
    try:
        return build(content) if content else None
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{file} is not what RANS writes there: {error!r}.") from error


def validation_section(report: Mapping[str, Any]) -> Section:
    """Checks against their tolerances.

    Args:
        report: ``checks`` (name, value, tolerance, unit, reason, passed) and, if known, ``title``.
    """
    checks = report["checks"]
    columns = ("check", "value", "tolerance", "unit", "verdict", "why this tolerance")
    keys = ("name", "value", "tolerance", "unit", "passed", "reason")
    title = report.get("title", "Validation")
    findings = [
        Finding(f"{c['name']}: {show(c['value'])} {c['unit']}, tolerance {show(c['tolerance'])}.", False)
        for c in checks if not c["passed"]]
    findings = findings or [Finding(f"{title}: all {len(checks)} checks within tolerance.", True)]
    text = f"{title}. Every engine must agree with the reference within these tolerances."
    rows, passed = [[check[key] for key in keys] for check in checks], sum(c["passed"] for c in checks)
    return Section("Validation", text, [Table(columns, rows)], (), findings,
                   [("checks within tolerance", f"{passed} of {len(checks)}")])


def training_section(rows: Sequence[Mapping[str, Any]]) -> Section:
    """Learning curve from the lines of ``metrics.jsonl``; see `learning_curve` for their keys."""
    last = rows[-1]
    summary = [(what, form.format(last[key])) for key, what, form in _PROGRESS if key in last]
    picture = Picture(data_uri(svg(learning_curve(rows))), "Success and return by term while training.")
    return Section("Training", "", [Table(("at the end", "value"), summary)], [picture], (), summary)


def evaluation_section(measured: Sequence[Metrics], pictures: Sequence[Picture] = ()) -> Section:
    """Metrics with their intervals, one table per flight, and figures."""
    tables = [Table(COLUMNS, [texts for _, texts in m.lines()], m.title()) for m in measured]
    text = ("All episodes fly to their full length and count. Steps are the states after each command. "
            "Intervals are 95 % percentile bootstraps over episodes.")
    summary = [line for m in measured for line in _key_metrics(m)]
    return Section("Evaluation", text, tables, pictures, [_solved(m) for m in measured], summary)


def _key_metrics(measured: Metrics) -> Iterator[tuple[str, str]]:
    yield "episodes", f"{measured.episodes:,} ({measured.engine} engine)"
    yield from ((name, f"{value} ({interval})") for _, (name, value, interval, _) in measured.lines()
                if name in _KEY_METRICS)


def _solved(measured: Metrics) -> Finding:
    share = measured["solved"].value
    return Finding(f"{measured.title()}: {share:.1f} % solved; {SOLVED_SHARE:g} % are wanted.",
                   share >= SOLVED_SHARE)


def comparison_section(comparison: Mapping[str, Any]) -> Section:
    """Contestants from the same starts, a line each; compare.html beside the report has the rest.

    Args:
        comparison: ``title``; ``summary``, rows of `rans.show.comparison_tables.to_json`; and
            ``failures``, sentences.
    """
    rows = comparison.get("summary", [])
    summary = [(row["contestant"], _outcome(row)) for row in rows]
    findings = [*(Finding(text, False) for text in comparison["failures"]),
                *(Finding(f"{name} {outcome}.") for name, outcome in summary)]
    return Section("Comparison", f"{comparison['title']}.", [Table(("contestant", "outcome"), summary)], (),
                   findings, summary, "compare.html")


def _outcome(row: Mapping[str, Any]) -> str:
    text = f"settles from {row['settled']} of {row['starts']} starts"
    for key, what in (("median_settling_time", "s (median)"), ("mean_impulse", "N s of thrust (mean)")):
        if row.get(key) is not None:
            text += f", {row[key]:.2f} {what}"
    lost = row["starts"] - row["flown"]
    return text + (f"; the optimiser found none from {lost}" if lost else "")


def _evaluation(file: Path, found: Any) -> Section:
    pictures = [Picture(data_uri(picture.read_text("utf-8")), caption)
                for name, caption in (("evaluation", "All episodes."), ("episode", "One episode."))
                if (picture := file.with_name(f"{file.stem.replace('evaluation', name)}.svg")).is_file()]
    section = evaluation_section([*_find_metrics(found)], pictures)
    return replace(section, title=file.stem.replace("-", " ").capitalize())


def _find_metrics(found: Any) -> Iterator[Metrics]:
    """Every `Metrics` inside a JSON value, however nested."""
    if isinstance(found, dict) and {"controller", "rows"} <= found.keys():
        yield Metrics.from_json(found)
    elif isinstance(found, dict | list):
        for inner in found.values() if isinstance(found, dict) else found:
            yield from _find_metrics(inner)


def _header(content: Mapping[str, Any]) -> dict[str, str]:
    """How it was made, from ``config.json`` or ``validation.json``; a group in one line."""
    known = {key: content[key] for key in ("seed", "device", "environment") if key in content}
    return {name: ", ".join(f"{key} {show(value)}".strip() for key, value in _leaves(group))
            for name, group in (content.get("about", {}) | known).items()}


def _configuration(config: Mapping[str, Any]) -> Section:
    rows = [(name, show(value)) for name, value in _leaves(config) if not name.startswith("about.")]
    return Section("Configuration", tables=[Table(("setting", "value"), rows)])


def _leaves(value: Any, name: str = "") -> list[tuple[str, Any]]:
    """The plain values of nested mappings, by dotted name; lists become texts."""
    if not isinstance(value, Mapping):
        return [(name, ", ".join(map(show, value)) if isinstance(value, list) else value)]
    return [leaf for key, inner in value.items()
            for leaf in _leaves(inner, f"{name}.{key}" if name else key)]
