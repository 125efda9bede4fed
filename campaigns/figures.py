"""Tables of documents, from the files in docs/validation that their figures come from.

``python -m campaigns.figures`` writes all of them again; tests/test_figures.py compares.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from campaigns.table import PAGES, table
from rans.base.files import number, read_json
from rans.model.spacecraft_file import load_spacecraft, spacecraft_names
from validation.study.checks import Check

Rows = tuple[Sequence[str], Sequence[Sequence[str]]]
"""Headings and rows of text."""


def stress(docs: Path) -> Rows:
    """The table of robustness: what each solves under conditions without a size, in %."""
    found = read_json(docs / "validation" / "stress.json")
    names = [one["spec"].removeprefix("pretrained:") for one in found["contestants"].values()]
    rows = [
        (one["effect"], *map(_solved, one["contestants"].values()))
        for one in found["conditions"].values()
        if one["size"] is None
    ]
    return ("solved, %", *names), rows


def _solved(result: dict[str, Any]) -> str:
    return f"{100.0 * result['held']['value']:.1f}"


def validations(docs: Path) -> Rows:
    """The first table of validation.md: how many checks of every spacecraft passed."""
    rows = []
    for name, found in _studies(docs).items():
        passed = sum(check.passed for check in checks_of(found))
        rows.append(
            (
                name,
                f"{passed} of {len(found['checks'])}",
                f"[{name}.json](validation/{name}.json)",
            )
        )
    return ("spacecraft", "checks", "numbers"), rows


def judges(docs: Path) -> Rows:
    """The table of judges.md: how far ours is from what others computed."""
    rows = []
    for one in read_json(docs / "validation" / "judges.json")["cases"]:
        differences = one["differences"]
        rows.append(
            (
                one["case"],
                one["about"],
                "<br>".join(f"{x['name']}: {x['value']:.1e} {x['unit']}" for x in differences),
                "<br>".join(f"{x['bound']:.0e}" for x in differences),
                "agrees" if one["passed"] else "**disagrees**",
            )
        )
    headings = ("case", "what", "largest difference", "bound", "")
    return headings, rows


def values(docs: Path) -> Rows:
    """The second: how near differences of each group of checks come to their tolerances, the worst craft's."""
    found: dict[str, dict[str, dict[str, tuple[str, float]]]] = {}
    for name, study in _studies(docs).items():
        is_planar = load_spacecraft(name).dimension == 2
        groups = found.setdefault("in the plane" if is_planar else "in space", {})
        for group, parts in _shares(checks_of(study)).items():
            for part, one in parts.items():
                worst = groups.setdefault(group, {}).get(part, one)
                groups[group][part] = max(worst, one, key=lambda x: x[1])
    rows = []
    for group in dict.fromkeys(group for groups in found.values() for group in groups):
        same = [groups.get(group, {}) for groups in found.values()]
        tolerances = dict.fromkeys(tolerance for one in same for tolerance, _ in one.values())
        cells = (f"{max(share for _, share in one.values()):.0e}" if one else "" for one in same)
        rows.append((group, ", ".join(tolerances), *cells))
    return ("check", "tolerance", *found), rows


def checks_of(study: dict[str, Any]) -> list[Check]:
    """Checks of the evidence of a validation."""
    return [
        Check(
            one["name"],
            number(one["value"]),
            one["tolerance"],
            one["unit"],
            one["reason"],
            layer=one["layer"],
        )
        for one in study["checks"]
    ]


def _shares(checks: Sequence[Check]) -> dict[str, dict[str, tuple[str, float]]]:
    """Tolerance, and difference over it, of parts such as "position" in groups of checks such as "25 s"."""
    groups: dict[str, dict[str, tuple[str, float]]] = {}
    for one in checks:
        group, _, part = one.name.partition(": ")
        groups.setdefault(group, {})[part] = f"{one.tolerance:.0e}", one.share
    return groups


def _studies(docs: Path) -> dict[str, Any]:
    files = {name: docs / "validation" / f"{name}.json" for name in spacecraft_names()}
    return {name: read_json(file) for name, file in files.items() if file.exists()}


def main() -> int:
    """Write every table."""
    for name in PAGES:
        table(Path("docs"), name).write(Path("docs"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
