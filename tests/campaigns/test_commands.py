"""Commands of campaigns that pages and campaigns print are there to be run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from campaigns.table import CAMPAIGNS
from rans.base.files import read_json

CAMPAIGNS_BY_COMMAND = {name.replace(" ", "-") for name in CAMPAIGNS}
ROOT = Path(__file__).parents[2]
ROOMS = "validation", "campaigns"
HISTORY = ROOT / "CHANGELOG.md"
"""Its older versions name commands as they were."""


def texts() -> Iterator[Path]:
    """Pages, and the files of campaigns, whose docstrings and tables name commands."""
    yield from (page for page in ROOT.glob("*.md") if page != HISTORY)
    yield from (ROOT / "docs").rglob("*.md")
    yield from ROOT.glob("packages/*/docs/*.md")
    for room in ROOMS:
        yield from (ROOT / room).rglob("*.py")
        yield from (ROOT / room).rglob("*.toml")


def commands(text: str) -> set[str]:
    """Modules that ``python -m`` or ``rans ... MODULE:NAME`` starts, and files that it reads."""
    rooms = "|".join(ROOMS)
    modules = re.findall(rf"-m\s+((?:{rooms})(?:\.\w+)+)", text)
    rows = re.findall(r"-m\s+campaigns\s+(?!NAME|MISSION)(\w[\w-]*)", text)
    picked = re.findall(rf"\b((?:{rooms})(?:\.\w+)+):[A-Z]", text)
    files = re.findall(rf"(?:^|[\s`(])((?:{rooms})/(?:\w+/)*\w+\.(?:py|toml))", text)
    return {*files, *rows, *(name.replace(".", "/") for name in (*modules, *picked))}


def is_there(name: str) -> bool:
    """Whether this is a campaign, a file, a module, or a package that runs."""
    module = f"campaigns/{name.replace('-', '_')}.py"
    return name in CAMPAIGNS_BY_COMMAND or any(
        (ROOT / one).is_file() for one in (name, f"{name}.py", f"{name}/__main__.py", module)
    )


def test_commands_start_what_is_there():
    missing = [
        (str(file.relative_to(ROOT)), name)
        for file in texts()
        for name in commands(file.read_text("utf-8"))
        if not is_there(name)
    ]
    assert not missing


def test_convex_guidance_has_flown_as_many_starts_as_its_row_asks():
    """A mission whose row says for how many starts it plans is planned by the latest deadline."""
    asked = {
        one.evidence[0]: int(one.given[one.given.index("--planned") + 1])
        for one in CAMPAIGNS.values()
        if "--planned" in one.given
    }
    assert asked
    for name, count in asked.items():
        rows = read_json(ROOT / "docs" / "validation" / name)["rows"]
        assert max(row["starts"] for row in rows if row["who"] == "convex guidance") == count


def test_commands_are_seen():
    """In a line, over its end, as a row of the table, as a module of a class, and as a file."""
    text = """`python -m campaigns.assurances RUN`, `python -m
    campaigns.pictures`, `python -m campaigns dock-on-ellipses --docs docs`,
    `rans train campaigns.ram:Ram`, `rans train campaigns/agent.toml`"""
    assert commands(text) == {
        "campaigns/assurances",
        "campaigns/pictures",
        "dock-on-ellipses",
        "campaigns/ram",
        "campaigns/agent.toml",
    }
