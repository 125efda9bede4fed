"""Reports: one HTML file that opens offline, with the verdict on top."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from rans.errors import ConfigError, RansError
from rans.evaluation.figures import comparison_figure, data_uri, learning_curve, svg
from rans.evaluation.metrics import COLUMNS, Metrics

SOLVED_SHARE = 99.0
"""Share of episodes, %, from which a task counts as solved."""

_HEADER = ("command", "revision", "git", "versions", "environment", "hardware", "device", "seed")
"""Entries of a run's configuration that belong on top of its report."""


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
    """See `rans.evaluation.figures.data_uri`."""
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
    """A heading with a paragraph, tables and pictures; its findings go to the top of the report."""

    title: str
    text: str = ""
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    findings: Sequence[Finding] = ()


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

    def html(self) -> str:
        """The page."""
        environment = Environment(loader=PackageLoader("rans.evaluation", "."), autoescape=True,
                                  undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        environment.filters["show"] = show
        written = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
        return environment.get_template("report.html.j2").render(report=self, written=written)

    def write(self, path: Path) -> Path:
        """Write the page; readers see the old page or the new one, never half of one.

        Raises:
            RansError: the file cannot be written.
        """
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            draft.write_text(self.html(), "utf-8")
            os.replace(draft, path)
        except OSError as error:
            draft.unlink(missing_ok=True)
            raise RansError(f"cannot write the report {str(path)!r}: {error}.") from error
        return path


def show(value: Any) -> str:
    """A table's cell as text."""
    if value is None:
        return "–"  # noqa: RUF001
    if isinstance(value, float):
        return "never" if value == math.inf else f"{value:.4g}"
    return str(value)


def report_from_run(run: Path) -> Path:
    """Write ``report.html`` from whatever a run folder holds; what is missing is left out.

    Args:
        run: may hold ``config.json``, ``validation.json`` (checks), ``metrics.jsonl`` (training),
            ``evaluation.json`` (one or several `Metrics`), ``evaluation.svg``, ``episode.svg`` and
            ``compare.json`` (lists of rows).

    Raises:
        ConfigError: there is no such folder or it holds none of them, or a file is damaged.
        RansError: the report cannot be written.
    """
    validation = _read_json(run / "validation.json") or {}
    config = _read_json(run / "config.json") or {}
    about = {"environment": validation.get("environment", {})} | config
    sections = list(_sections(run))
    if not sections:
        raise ConfigError(f"{str(run)!r} holds no results to report; is it a run folder?")
    if config:
        rows = [(name, show(value)) for name, value in _leaves(config)]
        sections.append(Section("Configuration", tables=[Table(("setting", "value"), rows)]))
    return Report(f"RANS: {run.resolve().name}", sections, _header(about)).write(run / "report.html")


def _sections(run: Path) -> Iterator[Section]:
    if checks := _read_json(run / "validation.json"):
        yield validation_section(checks)
    if rows := _read_lines(run / "metrics.jsonl"):
        yield training_section(rows)
    if found := list(_find_metrics(_read_json(run / "evaluation.json"))):
        yield evaluation_section(found, _pictures(run))
    if comparison := _read_json(run / "compare.json"):
        yield comparison_section(comparison)


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
        for c in checks if not c["passed"]
    ] or [Finding(f"{title}: all {len(checks)} checks within tolerance.", True)]
    text = f"{title}. Every engine must agree with the reference within these tolerances."
    rows = [[check[key] for key in keys] for check in checks]
    return Section("Validation", text, [Table(columns, rows)], (), findings)


def training_section(rows: Sequence[Mapping[str, Any]]) -> Section:
    """Learning curve from the lines of ``metrics.jsonl``; see `learning_curve` for their keys."""
    last = rows[-1]
    parts = [f"{last['steps']:,} environment steps"] if "steps" in last else []
    parts += [f"{last['seconds']:.3g} s"] if "seconds" in last else []
    parts += [f"{100 * last['success']:.1f} % of episodes successful"] if "success" in last else []
    picture = Picture(data_uri(svg(learning_curve(rows))), "Success and return by term while training.")
    return Section("Training", f"Ended after {', '.join(parts)}." if parts else "", (), [picture])


def evaluation_section(measured: Sequence[Metrics], pictures: Sequence[Picture] = ()) -> Section:
    """Metrics with their intervals, one table per flight, and figures."""
    tables = [Table(COLUMNS, [row.texts() for row in m.rows], m.title()) for m in measured]
    findings = [_solved(m) for m in measured]
    text = ("All episodes fly to their full length and count. Steps are the states after each command. "
            "Intervals are 95 % percentile bootstraps over episodes.")
    return Section("Evaluation", text, tables, pictures, findings)


def _solved(measured: Metrics) -> Finding:
    share = measured["solved"].value
    text = (f"{measured.controller} ({measured.engine} engine) solves {share:.1f} % of "
            f"{measured.episodes} episodes; {SOLVED_SHARE:g} % are wanted.")
    return Finding(text, share >= SOLVED_SHARE)


def comparison_section(comparison: Mapping[str, Any]) -> Section:
    """Contestants from the same starts.

    Args:
        comparison: ``title`` and ``text`` if known; every entry that is a list of rows (mappings of
            plain values) becomes a table, and rows that name a ``contestant`` with ``settling_time``
            and ``on_time`` are also drawn. See `rans.evaluation.compare.Comparison.to_json`.
    """
    tables, pictures = [], []
    for name, rows in comparison.items():
        if isinstance(rows, list) and rows and all(isinstance(row, dict) for row in rows):
            columns = list(dict.fromkeys(key for row in rows for key in row))
            cells = [[row.get(column) for column in columns] for row in rows]
            tables.append(Table([c.replace("_", " ") for c in columns], cells, name.replace("_", " ")))
            if contestants := _contestants(rows):
                figure = svg(comparison_figure(contestants))
                pictures.append(Picture(data_uri(figure), "Settling time against thruster on-time."))
    text = ". ".join(comparison[key] for key in ("title", "text") if key in comparison)
    findings = [_outcome(row) for row in comparison.get("summary", [])]
    return Section("Comparison", text, tables, pictures, findings)


def _outcome(row: Mapping[str, Any]) -> Finding:
    """A line about one contestant; a bound that was not found from every start is a failure."""
    text = f"{row['contestant']} settles from {row['settled']} of {row['starts']} starts"
    for key, what in (("median_settling_time", "s (median)"), ("mean_impulse", "N s of thrust (mean)")):
        if row.get(key) is not None:
            text += f", {row[key]:.2f} {what}"
    if row["kind"] == "bound" and row["flown"] < row["starts"]:
        return Finding(f"{text}; the optimiser found none from {row['starts'] - row['flown']}.", False)
    return Finding(f"{text}.")


def _contestants(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, list[float]]]:
    keys = ("settling_time", "on_time")
    contestants: dict[str, dict[str, list[float]]] = {}
    for row in rows:
        if all(key in row for key in ("contestant", *keys)):
            values = contestants.setdefault(row["contestant"], {key: [] for key in keys})
            for key in keys:
                values[key].append(math.inf if row[key] is None else float(row[key]))
    return contestants


def _pictures(run: Path) -> list[Picture]:
    captions = {"evaluation.svg": "All episodes.", "episode.svg": "One episode."}
    return [Picture(data_uri((run / name).read_text("utf-8")), caption)
            for name, caption in captions.items() if (run / name).is_file()]


def _find_metrics(found: Any) -> Iterator[Metrics]:
    """Every `Metrics` inside a JSON value, however nested."""
    if isinstance(found, dict) and {"controller", "rows"} <= found.keys():
        yield Metrics.from_json(found)
    elif isinstance(found, dict | list):
        for inner in found.values() if isinstance(found, dict) else found:
            yield from _find_metrics(inner)


def _header(config: Mapping[str, Any]) -> dict[str, str]:
    """The entries of `_HEADER`, a group of them in one line."""
    lines = {}
    for name in _HEADER:
        if name in config:
            pairs = (f"{key} {show(value)}".strip() for key, value in _leaves(config[name]))
            lines[name] = ", ".join(pairs)
    return lines


def _leaves(value: Any, name: str = "") -> list[tuple[str, Any]]:
    """The plain values of nested mappings, by dotted name; lists become texts."""
    if not isinstance(value, Mapping):
        return [(name, ", ".join(map(show, value)) if isinstance(value, list) else value)]
    names = {key: f"{name}.{key}" if name else key for key in value}
    return [leaf for key, inner in value.items() for leaf in _leaves(inner, names[key])]


def _read_json(file: Path) -> Any:
    """The file's value, or None where there is no such file."""
    try:
        return json.loads(file.read_text("utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read {str(file)!r}: {error}.") from error


def _read_lines(file: Path) -> list[dict[str, Any]]:
    """The rows of a JSON-lines file; a last line cut off by an interruption is left out."""
    rows = []
    lines = file.read_text("utf-8").splitlines() if file.is_file() else []
    for line in lines:
        try:
            rows.append(json.loads(line))
        except ValueError:
            break
    return rows
