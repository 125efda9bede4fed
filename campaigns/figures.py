"""Tables of documents, from the files in docs/validation that their figures come from.

``python -m campaigns.figures`` writes all of them again; tests/test_figures.py compares.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from campaigns.table import PAGES, table
from rans.files import read_json
from rans.model.spacecraft_file import spacecraft_names

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
        passed = sum(check["passed"] for check in found["checks"])
        rows.append(
            (
                name,
                f"`rans validate {name} --output FOLDER`",
                f"{passed} of {len(found['checks'])}",
                f"{found['settings']['seconds']:.0f} s",
                f"[{name}.json](validation/{name}.json)",
            )
        )
    return ("spacecraft", "command", "checks", "time", "numbers"), rows


def judges(docs: Path) -> Rows:
    """The table of judges.md: how far ours is from what others computed."""
    rows = []
    for one in read_json(docs / "validation" / "judges.json"):
        differences = one["differences"]
        rows.append(
            (
                one["case"],
                one["about"],
                "<br>".join(f"{x['name']}: {x['value']:.1e} {x['unit']}" for x in differences),
                "<br>".join(f"{x['bound']:.0e}" for x in differences),
                one["spread"],
                f"`{one['file']}`",
                "agrees" if one["passed"] else "**disagrees**",
            )
        )
    headings = ("case", "what", "largest difference", "bound", "their own spread", "file", "")
    return headings, rows


def values(docs: Path) -> Rows:
    """The second: the largest difference that every check has found."""
    found = {
        name: {check["name"]: check for check in study["checks"]}
        for name, study in _studies(docs).items()
    }
    rows = []
    for name in dict.fromkeys(name for checks in found.values() for name in checks):
        same = [checks.get(name) for checks in found.values()]
        tolerances = dict.fromkeys(f"{one['tolerance']:.0e}" for one in same if one)
        unit = next(one["unit"] for one in same if one)
        rows.append(
            (
                name,
                unit,
                "/".join(tolerances),
                *(f"{one['value']:.0e}" if one else "" for one in same),
            )
        )
    return ("check", "unit", "tolerance", *found), rows


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
