"""The page docs/reference/leaderboard.md: ranked tables of the evidence under docs/validation and of cards."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rans.base.pretrained import pretrained_card, pretrained_names

EVIDENCE = Path(__file__).parents[1] / "validation"
SCENARIOS = ("perfect", "lab", "roboran", "orbit", "harsh")
"""Conditions of the robustness table, in the order of their difficulty."""
FAULTS = {
    "none": "none",
    "one dead": "one dead, recoverable (8)",
    "one stuck open": "one stuck-open, recoverable (8)",
    "one weak": "one weak, recoverable (8)",
    "two dead": "two dead, recoverable (16)",
    "two stuck open": "two stuck-open, recoverable (16)",
    "two dead, unrecoverable": "two dead, unrecoverable (12)",
}
"""Columns of the table of thruster faults, and their keys in faults.json."""


class Table(NamedTuple):
    """Rows of text under a heading, with what they are from."""

    title: str
    text: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    source: str
    grouped: bool = False
    """Whether ranks begin anew where the first column changes."""
    ranked: bool = True
    """Whether rows have ranks: not where contestants are columns."""


def leaderboard_page() -> str:
    """Ranked tables: best first, and of equals the quicker or the cheaper one."""
    lines = [
        "# Leaderboard",
        "",
        "Ranked from the files of evidence, every time the site is built. Shares have 95 % intervals in the files; "
        "a rank does not separate agents whose intervals overlap. How comparisons are made: "
        "[Protocol](../protocol.md).",
    ]
    for table in (*task_tables(), robustness(), faults(), *missions(), assurance(), settled_gate()):
        lines += [
            "",
            f"## {table.title}",
            "",
            table.text,
            "",
            _markdown(table),
            f"Source: {table.source}.",
        ]
    return "\n".join(lines) + "\n"


def task_tables() -> Iterable[Table]:
    """Agents that come with RANS, by task and spacecraft: those that settle first come first."""
    rows: dict[str, list[tuple[tuple[Any, ...], list[str]]]] = {}
    for name in pretrained_names():
        card = pretrained_card(name)
        for part, values in card["evaluation"]["own"].items():
            task = part if part and not part.replace(".", "").isdigit() else card["task"]
            if task not in ("go-to-pose", "go-to-position"):
                continue
            solved, settling, impulse = (
                values[metric] for metric in ("solved", "settling time", "impulse")
            )
            key = (card["spacecraft"], -solved[0], settling[0], impulse[0])
            row = [
                card["spacecraft"],
                f"`{name}{f'#{part}' if part else ''}`",
                _interval(solved),
                f"{settling[0]:.3g}",
                f"{impulse[0]:.4g}",
                _judged(card),
            ]
            title = f"{task}, {'plane' if '-2d' in name else 'space'}"
            rows.setdefault(title, []).append((key, row))
    columns = ("solved, %", "settling, s", "impulse, N s", "judged")
    for title, found in sorted(rows.items()):
        yield Table(
            title,
            "1,024 starts of seed 2023, under the conditions of each agent's training. Ranks are by spacecraft. "
            "Judged: day, and revision of the code (+: with uncommitted changes).",
            ("spacecraft", "agent", *columns),
            [row for _, row in sorted(found)],
            "cards of the agents, which `rans list NAME` prints",
            grouped=True,
        )


def robustness() -> Table:
    """Who holds the goal under which conditions."""
    data = _read("stress.json")
    rows = []
    for name, about in data["contestants"].items():
        shares = [
            100.0 * data["conditions"][one]["contestants"][name]["held"]["value"]
            for one in SCENARIOS
        ]
        row = [name, about["knows"], *(f"{x:.1f}" for x in shares)]
        rows.append((-sum(shares), row))
    return Table(
        "Robustness of go-to-pose in the plane",
        "Share of episodes that hold the goal, %; the mean over columns decides the order. "
        "Conditions: [Domain randomization](conditions.md).",
        ("contestant", "is given", *SCENARIOS),
        [row for _, row in sorted(rows)],
        _source("stress.json", "rans stress"),
    )


def faults() -> Table:
    """How agents for faults fly with broken thrusters."""
    rows = []
    for file in ("faults.json", "faults-space.json"):
        for name, kinds in _read(file)["agents"].items():
            found = [
                kinds[key]["held"]["value"] if (key := _like(wanted, kinds)) else math.nan
                for wanted in FAULTS.values()
            ]
            cells = ["-" if math.isnan(x) else f"{x:.1f}" for x in found]
            agent = f"`{name.removeprefix('pretrained:')}`"
            rows.append((-sum(x for x in found if not math.isnan(x)), [agent, *cells]))
    agents, *columns = zip(*(row for _, row in sorted(rows)), strict=True)
    return Table(
        "Thruster faults",
        "Share of episodes that hold the goal with failed thrusters from the start, %; best agent first.",
        ("failed thrusters", *agents),
        [[kind, *cells] for kind, cells in zip(FAULTS, columns, strict=True)],
        f"{_source('faults.json')}; {_source('faults-space.json')}",
        ranked=False,
    )


def missions() -> Iterable[Table]:
    """Who wins a mission, by conditions."""
    for file in sorted(EVIDENCE.glob("mission-*.json")):
        data = _read(file.name)
        if "mission" not in data:
            continue  # inspections, whose page has their table
        order = list(dict.fromkeys(row["condition"] for row in data["rows"]))
        rows = sorted(
            data["rows"],
            key=lambda row: (order.index(row["condition"]), -row["won"], _number(row["spent"])),
        )
        cells = [
            [
                row["condition"],
                row["who"].removeprefix("pretrained:"),
                f"{row['starts']:,}",
                f"{100.0 * row['won']:.1f}",
                f"{100.0 * row['violated']:.1f}",
                _plain(row["spent"]),
                _plain(row["ratio"]),
            ]
            for row in rows
        ]
        yield Table(
            f"Mission {data['mission']}",
            "The ratio is impulse over its certified lower bound, where there is one (mean over starts).",
            ("condition", "contestant", "starts", "won, %", "violated, %", "impulse, N s", "ratio"),
            cells,
            _source(file.name),
            grouped=True,
        )


def assurance() -> Table:
    """Upper bounds on failure probabilities."""
    rows = []
    for file in sorted((EVIDENCE / "assurance").glob("*.json")):
        data = _read(f"assurance/{file.name}")
        found = data["bounds"]["any"]
        rows.append(
            (
                found["at most"],
                [
                    file.stem,
                    f"{found['flights']:,}",
                    f"{found['failures']:,}",
                    f"{found['at most']:.2g}",
                    data["environment"].get("revision", ""),
                ],
            )
        )
    return Table(
        "Failure probability",
        "Upper bounds at 99 % confidence, smallest first. Names that end in a scenario fly under it; others fly "
        "nominally. How to read them: [Assurance](../assurance/assurance.md).",
        ("agent", "flights", "failures", "failure probability at most", "revision"),
        [row for _, row in sorted(rows)],
        "`docs/validation/assurance/*.json`, each with its command",
    )


def settled_gate() -> Table:
    """The published benchmark of faulty attitude actuators."""
    rows = []
    for name, kinds in _read("settled-gate.json")["settled"].items():
        shares = [x["value"] for x in kinds.values()]
        rows.append((-sum(shares), [name.removeprefix("runs/"), *(f"{x:.1f}" for x in shares)]))
        columns = ("contestant", *kinds)
    return Table(
        "Settled gate",
        "Share of settled flights by kind of fault, %. The benchmark: "
        "[Settled gate](../assurance/robustness.md#the-settled-gate).",
        columns,
        [row for _, row in sorted(rows)],
        _source("settled-gate.json"),
    )


def _read(name: str) -> dict[str, Any]:
    return json.loads((EVIDENCE / name).read_text("utf-8"))


def _source(name: str, command: str = "") -> str:
    """The file, when it was last changed, and the revision that made it."""
    data = _read(name)
    parts = [
        f"`docs/validation/{name}`",
        f"revision {data['environment'].get('revision', 'unknown')}",
    ]
    if when := _changed(name):
        parts.append(when)
    if command:
        parts.append(f"`{command}`")
    return ", ".join(parts)


def _changed(name: str) -> str:
    """The day on which a file of evidence was committed, "" outside of a repository."""
    try:
        done = subprocess.run(
            ["git", "log", "-1", "--format=%cs", "--", name],
            cwd=EVIDENCE,
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _like(wanted: str, kinds: Iterable[str]) -> str:
    """The kind of fault of this name, whatever the number of thruster sets in brackets."""
    start = wanted.partition(" (")[0]
    return next(
        (
            kind
            for kind in kinds
            if kind.partition(" (")[0] == start and ", by" not in kind and ", any" not in kind
        ),
        "",
    )


def _judged(card: Mapping[str, Any]) -> str:
    """The day and the revision at which a card's figures were flown; + for one with uncommitted changes."""
    revision = card.get("evaluation_environment", {}).get("revision", "").replace("-dirty", "+")
    return f"{card.get('date', '')}{f' `{revision}`' if revision else ''}"


def _interval(metric: Sequence[Any]) -> str:
    value, low, high = (float(x) for x in metric[:3])
    return f"{value:.4g} ({low:.3g}-{high:.3g})"


def _number(value: Any) -> float:
    """A number for an order, infinite where there is none."""
    number = float(value)
    return math.inf if math.isnan(number) else number


def _plain(value: Any) -> str:
    return f"{float(value):.3g}" if math.isfinite(float(value)) else "-"


def _markdown(table: Table) -> str:
    if not table.ranked:
        lines = [table.columns, ["---"] * len(table.columns), *table.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
    lines = [["rank", *table.columns], ["---"] * (len(table.columns) + 1)]
    rank = 0
    before = ""
    for row in table.rows:
        rank = 1 if table.grouped and row[0] != before else rank + 1
        before = row[0]
        lines.append([str(rank), *row])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
