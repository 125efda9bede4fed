"""Checks and the reports they make up."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.table import Table

from rans.files import environment, write_json


@dataclass(frozen=True)
class Check:
    """One measured value against the bound it must keep."""

    name: str
    """What was measured."""
    value: float
    """The measured value; smaller is better, its sign does not count."""
    tolerance: float
    """Largest value that passes."""
    unit: str
    """Of value and tolerance; "-" for none."""
    reason: str
    """Why the tolerance is what it is, as one sentence."""
    worst: str = ""
    """Where the value was found, among the many that were looked at."""
    layer: str = ""
    """Part of the study it belongs to, see `validation.study`."""

    @property
    def passed(self) -> bool:
        """Whether the bound is kept; a NaN keeps none."""
        return abs(self.value) <= self.tolerance


@dataclass(frozen=True)
class Skipped:
    """What could not be checked here."""

    name: str
    """What was not measured."""
    reason: str
    """Why, as one sentence."""


@dataclass(frozen=True)
class Curve:
    """Measured points behind a figure of the report."""

    figure: str
    """Name of the figure, see `validation.page`."""
    name: str
    """What was measured, for the legend."""
    x: tuple[float, ...]
    y: tuple[float, ...]


@dataclass(frozen=True)
class Report:
    """The checks of one study."""

    title: str
    """What was studied, on what."""
    checks: tuple[Check, ...]
    """In the order of the table."""
    settings: dict[str, Any] = field(default_factory=dict)
    """What a reader needs to repeat the study: seed, counts, times."""
    skipped: tuple[Skipped, ...] = ()
    """What could not be checked."""
    curves: tuple[Curve, ...] = ()
    """Behind the figures."""

    @property
    def passed(self) -> bool:
        """Whether there is a check and every one passed."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    def table(self) -> Table:
        """The checks for the terminal."""
        table = Table(title=self.title, title_justify="left")
        table.add_column("check", no_wrap=True)
        for heading in ("value", "tolerance"):
            table.add_column(heading, justify="right")
        table.add_column("unit")
        table.add_column("verdict")
        for check in self.checks:
            verdict = "[green]pass[/]" if check.passed else "[bold red]FAIL[/]"
            numbers = (f"{check.value:.1e}", f"{check.tolerance:.1e}")
            table.add_row(check.name, *numbers, check.unit, verdict)
        for skipped in self.skipped:
            table.add_row(skipped.name, "", "", "", "[yellow]not run[/]")
        return table

    def as_dict(self) -> dict[str, Any]:
        """The report as plain JSON values; a value that is not finite is null, which JSON can hold."""
        checks = []
        for check in self.checks:
            value = check.value if math.isfinite(check.value) else None
            checks.append(asdict(check) | {"value": value, "passed": check.passed})
        return {"title": self.title, "passed": self.passed, "settings": self.settings,
                "environment": environment(), "checks": checks,
                "skipped": [asdict(skipped) for skipped in self.skipped],
                "curves": [asdict(curve) for curve in self.curves]}

    def write(self, file: Path) -> None:
        """Write the report as a JSON file, its folder made where missing.

        Raises:
            ConfigError: the disk refused.
        """
        write_json(file, self.as_dict())
