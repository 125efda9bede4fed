"""Judges: what others computed, and how far ours is from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from validation.study.checks import Check


@dataclass(frozen=True)
class Judge:
    """Who computed figures that ours are compared with."""

    name: str
    source: str
    """Repository and folder."""
    commit: str
    """Commit of the repository that has the figures."""
    why: str
    """One sentence: why this judge does not share our mistakes."""


@dataclass(frozen=True)
class Row:
    """One case of a judge."""

    judge: Judge
    case: str
    about: str
    """What the case is, in a few words."""
    file: str
    """Where its figures come from."""
    checks: tuple[Check, ...]
    """Our largest differences, each against its bound."""
    spread: str
    """How far the judge, or those who repeat it, are from themselves."""

    @property
    def passed(self) -> bool:
        """Whether every difference is within its bound; a judge that disagrees stays in the table."""
        return all(check.passed for check in self.checks)

    def differences(self) -> str:
        """The largest differences in a few words, such as "9e-11 degrees, 1e-14 degrees/s"."""
        return ", ".join(f"{check.value:.1e} {check.unit}" for check in self.checks)

    def bounds(self) -> str:
        """The bounds in a few words."""
        return ", ".join(f"{check.tolerance:.0e} {check.unit}" for check in self.checks)

    def to_json(self) -> dict[str, Any]:
        """Plain values, for a file."""
        return {
            "judge": self.judge.name,
            "case": self.case,
            "about": self.about,
            "file": self.file,
            "commit": self.judge.commit,
            "passed": self.passed,
            "spread": self.spread,
            "differences": [
                {
                    "name": check.name,
                    "value": check.value,
                    "bound": check.tolerance,
                    "unit": check.unit,
                    "reason": check.reason,
                }
                for check in self.checks
            ],
        }


class Largest:
    """The largest of differences by quantity, in the order in which they come."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}

    def add(self, name: str, value: float) -> None:
        """One more difference; a NaN stays."""
        before = self.values.get(name, 0.0)
        self.values[name] = value if math.isnan(value) else max(before, value)
