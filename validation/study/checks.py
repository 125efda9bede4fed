"""Checks and the studies they make up."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rans.base.errors import counted
from rans.base.files import environment, made_by, write_json
from rans.base.table import Table
from rans.evaluation.fly.evidence import sha256


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
    """Part of the study it belongs to, see `validation.study.study`."""

    @property
    def passed(self) -> bool:
        """Whether the bound is kept; a NaN keeps none."""
        return abs(self.value) <= self.tolerance

    @property
    def share(self) -> float:
        """The value as a share of the tolerance; infinite for a NaN, and for anything but 0 of a tolerance of 0."""
        if self.value == 0.0:
            return 0.0
        if math.isnan(self.value) or self.tolerance == 0.0:
            return math.inf
        return abs(self.value) / self.tolerance


@dataclass(frozen=True)
class Skipped:
    """What could not be checked here."""

    name: str
    """What was not measured."""
    reason: str
    """Why, as one sentence."""


NO_THRUSTERS = "The craft has no thrusters."
"""Why a check of thrusters is `Skipped`."""


@dataclass(frozen=True)
class Curve:
    """Measured points behind a figure of the report."""

    figure: str
    """Name of the figure: what it is of, over what."""
    name: str
    """What was measured, for the legend."""
    x: tuple[float, ...]
    y: tuple[float, ...]


@dataclass(frozen=True)
class Study:
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
    spacecraft: str = ""
    """File of the spacecraft, as RANS writes it."""
    is_partial: bool = False
    """Whether it was interrupted."""

    def __repr__(self) -> str:
        passed = sum(check.passed for check in self.checks)
        return f"<{self.title}: {passed} of {counted(len(self.checks), 'check')} passed>"

    @property
    def passed(self) -> bool:
        """Whether there is a check, every one passed, and none is left to make."""
        return (
            bool(self.checks) and not self.is_partial and all(check.passed for check in self.checks)
        )

    def table(self) -> Table:
        """The checks, a row each."""
        rows: list[tuple[Any, ...]] = [
            (
                check.name,
                f"{check.value:.1e}",
                f"{check.tolerance:.1e}",
                check.unit,
                bool(check.passed),
            )
            for check in self.checks
        ]
        rows += [(skipped.name, "", "", "", "not run") for skipped in self.skipped]
        columns = ("check", "value", "tolerance", "unit", "verdict")
        return Table(columns, rows, self.title, right=columns[1:3])

    def layers(self) -> Table:
        """A line for each layer: how many of its checks passed, and which is nearest to its tolerance."""
        rows: list[tuple[Any, ...]] = []
        for layer in dict.fromkeys(check.layer for check in self.checks):
            members = [check for check in self.checks if check.layer == layer]
            passed = sum(check.passed for check in members)
            nearest = max(members, key=lambda check: check.share)
            of_all = f"{passed} of {len(members)}"
            share = f"{nearest.share:.2g}"
            rows.append((layer or "-", of_all, nearest.name, share, passed == len(members)))
        rows += [("-", "", skipped.name, "", "not run") for skipped in self.skipped]
        columns = ("layer", "passed", "nearest to its tolerance", "value / tolerance", "verdict")
        return Table(columns, rows, self.title, right=(columns[1], columns[3]))

    def to_json(self) -> dict[str, Any]:
        """For `rans.base.files.write_json`."""
        return {
            "title": self.title,
            "passed": self.passed,
            "is_partial": self.is_partial,
            "settings": self.settings,
            "command": made_by("rans.validate"),
            "environment": environment(),
            "hashes": {"spacecraft": sha256([self.spacecraft.encode()])},
            "checks": [asdict(check) | {"passed": check.passed} for check in self.checks],
            "skipped": [asdict(skipped) for skipped in self.skipped],
            "curves": [asdict(curve) for curve in self.curves],
        }

    def write(self, file: Path) -> None:
        """Write the study as a JSON file, its folder made where missing.

        Raises:
            ConfigError: the disk refused.
        """
        write_json(file, self.to_json())
