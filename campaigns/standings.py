"""What is known at least of every mission, the first table of its page.

It measures nothing: it gathers proven bound, least known flight, guidance and agent of each mission from the
evidence of `campaigns.missions`, `campaigns.inspection`, `rans improve` and passive
safety. The cheapest known flight is of whoever spends least with the thrusters of the craft: optimal
trajectories of throttled ones are in tables of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rans.base.files import number, read_json

_HEADINGS = (
    "",
    "who",
    "starts",
    "won, %",
    "over the bound",
    "mean spent",
    "median time, s",
)


@dataclass(frozen=True)
class Mission:
    """Which rows of the evidence are the standings of a mission."""

    condition: str
    """The condition of `campaigns.missions`; empty: the only one."""
    rows: tuple[tuple[str, str], ...]
    """What each row is, and who flies it in the evidence."""
    passive: tuple[tuple[str, str], ...] = ()
    """Names in passive-safety.json of contestants, from which times are."""
    unit: str = "N s"


_BOUND = "proven bound"
_CHEAPEST = "least known"
_FOUND = "found by `rans improve`"
_GUIDANCE = "guidance"
_SAFE = "guidance, passively safe"
_AGENT = "agent"
_AGAIN = ", in Drake"
_NONE = "none"
"""Cell of a row for which no flight is known."""
_ORBITAL = (
    (_GUIDANCE, "mission guidance"),
    (_AGENT, _NONE),
)
MISSIONS = {
    "dock": Mission(
        "1,000 s",
        _ORBITAL,
        (("mission guidance", "dock, mission"),),
    ),
    "hold": Mission(
        "1,900 s",
        ((_GUIDANCE, "convex guidance"), *_ORBITAL),
        (("mission guidance", "hold, mission"), (_SAFE, "hold, passive")),
    ),
    "rendezvous": Mission(
        "5,000 s",
        _ORBITAL,
        (("mission guidance", "rendezvous, mission"),),
    ),
    "land": Mission("", ((_AGENT, "pretrained:land-3d"),), unit="kg"),
    "inspect": Mission(
        "",
        (
            (_GUIDANCE, "circumnavigation, 12,240 s"),
            (_AGENT, "pretrained:inspect-3d"),
        ),
        (("circumnavigation, 12,240 s", "inspect, circumnavigation"),),
    ),
    "final-approach": Mission("", ((_GUIDANCE, "corridor"), (_AGENT, _NONE))),
    "avoid": Mission(
        "default zones",
        (
            (_GUIDANCE, "MPC"),
            (_GUIDANCE, "LQR, filtered"),
            (_AGENT, "pretrained:avoid-2d"),
            (_AGENT, "pretrained:avoid-3d"),
        ),
    ),
    "dock-port": Mission(
        "default rates",
        (
            (_GUIDANCE, "MPC"),
            (_GUIDANCE, "LQR, filtered"),
            *((_AGENT, f"pretrained:dock-port-{name}") for name in ("2d", "2d-atmos", "3d")),
            (_AGENT, "value:dock-port-2d@floating-platform#0.5"),
        ),
    ),
}


def rows(docs: Path, mission: str) -> tuple[Sequence[str], list[list[str]]]:
    """Headings and rows of the table of a mission's page, of the evidence in docs/validation."""
    asked = MISSIONS[mission]
    flown = {
        row["who"]: row
        for row in read_json(docs / "validation" / f"mission-{mission}.json")["rows"]
        if row.get("condition", "") == asked.condition
    }
    safety = {row["who"]: row for row in read_json(docs / "validation/passive-safety.json")["rows"]}
    of_safety = {who: safety[name] for who, name in asked.passive if name in safety}
    evidence = read_json(docs / "validation" / f"mission-{mission}.json")
    lines = [_bound(mission, asked, flown)]
    found = _found(docs, mission)
    # What gains nothing is no other flight, and its starts may be others.
    better = {who: row for who, row in found.items() if row["gains"]}
    entries = [(_CHEAPEST, *one) for one in _cheapest({**flown, **better})]
    # The least known flights stand once, whoever flies them.
    least = {who for _, who, _ in entries}
    entries += [(_FOUND, who, row) for who, row in better.items() if who not in least]
    entries += [
        (what, who, flown.get(who))
        for what, who in asked.rows
        if not (what == _GUIDANCE and who in least)
    ]
    for what, who, row in entries:
        orbital = bool(asked.passive and asked.condition) and who in flown
        name = f"{who}, by {asked.condition}" if orbital else who
        # Flights by one deadline are others than those of passive-safety.json, which have their own.
        safety_of_row = None if asked.condition else of_safety.get(who)
        lines.append([what, name, *_cells(row, safety_of_row, evidence, asked.unit)])
    if _SAFE in of_safety:
        name = dict(asked.passive)[_SAFE].partition(", ")[2]
        row = of_safety[_SAFE]
        other = next(one for one in of_safety.values() if one is not row)
        spent = _spent(row["impulse"], asked.unit)
        if row["starts"] == other["starts"]:
            # From the same starts, with the same deadlines.
            spent += f", {row['impulse'] / other['impulse']:.2f} of guidance"
        name += ", own deadlines" if asked.condition else ""
        counts = f"{row['starts']:,}", f"{100.0 * row['won']:.1f}"
        lines.append([_SAFE, name, *counts, "-", spent, _time(row)])
    # Rows in the order of their kinds: that of safe guidance before agents.
    order = (_BOUND, _CHEAPEST, _FOUND, _GUIDANCE, _SAFE, _AGENT)
    lines.sort(key=lambda line: order.index(line[0]))
    return _HEADINGS, lines


def over(row: Mapping[str, Any]) -> str:
    """Cell of a mean ratio of a row to the bounds, with the number of its starts where the row has more."""
    ratio = _ratio(row)
    if not math.isfinite(ratio):
        return "-"
    compared = row.get("compared", row.get("starts"))
    return f"{ratio:.3f}" if compared == row.get("starts") else f"{ratio:.3f} of {compared}"


def _found(docs: Path, mission: str) -> dict[str, Any]:
    """What `rans improve` found of a mission, as rows by what it began from."""
    file = docs / "validation/least-known.json"
    if not file.exists():
        return {}
    return {row["who"]: row for row in read_json(file)["rows"] if row["mission"] == mission}


def _cheapest(flown: dict[str, Any]) -> list[tuple[str, Any]]:
    """Who has the lowest mean ratio to the bound of all that win from every start, from whichever hand.

    Where nobody wins from every start, of those that win from the largest part of them. Empty: nobody has a ratio,
    as where a quick run flies another condition.
    """
    # Drake flies the same guidance once more, from fewer starts.
    candidates = {
        who: row
        for who, row in flown.items()
        if math.isfinite(_ratio(row)) and not who.endswith(_AGAIN)
    }
    most = max(map(_won, candidates.values()), default=0.0)
    best = [(who, row) for who, row in candidates.items() if _won(row) == most]
    return sorted(best, key=lambda candidate: _ratio(candidate[1]))[:1]


def _won(row: Any) -> float:
    return row["won"] if "won" in row else row["succeeded"]


def _ratio(row: Any) -> float:
    """Mean of what is spent over the bound; NaN: there is none."""
    if "ratio" in row:
        return _number(row, "ratio")
    return row["impulse"] / row["bound"] if "bound" in row else math.nan


def _bound(mission: str, asked: Mission, flown: dict[str, Any]) -> list[str]:
    """The row of the bound; impulses of inspections are in the evidence."""
    bounds = [row["bound"] for row in flown.values() if "bound" in row]
    known = bool(bounds) or any(
        _number(row, "ratio") == _number(row, "ratio") for row in flown.values()
    )
    spent = _spent(bounds[0], asked.unit) if bounds else "-"
    return [
        _BOUND,
        "any flight" if known else _NONE,
        "-",
        "-",
        "1" if known else "-",
        spent,
        "-",
    ]


def _cells(row: Any, safety: Any, evidence: dict[str, Any], unit: str) -> list[str]:
    """Starts, won, over the bound, spent and time of a contestant."""
    if row is None:
        return [*"-----"]
    won = _won(row)
    spent = _number(row, "spent") if "spent" in row else row["impulse"]
    median = "-" if safety is None else _time(safety)
    if "median" in row:
        # A percentile is the time of a flight, which a median of an even number of flights may not be.
        median = f"{row['median']:,.0f}"
    starts = row.get("starts", evidence["episodes"])
    return [
        f"{starts:,}",
        f"{100.0 * won:.1f}",
        over(row),
        _spent(spent, unit),
        median,
    ]


def _time(row: Any) -> str:
    """Median time of the flights of passive-safety.json."""
    return f"{number(row['percentiles']['arrival, s'][0]):,.0f}"


def _spent(value: float, unit: str) -> str:
    return f"{float(f'{value:.3g}'):,g} {unit}"


def _number(row: Any, name: str) -> float:
    """A number of a row of evidence; NaN: there is none."""
    value = row.get(name)
    return float("nan") if value is None else float(value)
