"""What a certificate of a network claims: the problem, the cells or the flight, and the words for it.

Closed tables: what a certificate says and nobody checks is refused here.
"""

from __future__ import annotations

import ast
from typing import Any, NamedTuple

from rans_proof.balls import Refused, need
from rans_proof.claims import (
    ABOVE_ZERO,
    ANYTHING,
    DIGEST,
    LINE,
    NUMBER,
    TABLE,
    TEXT,
    Kind,
    entries,
    json_of,
    list_of,
    toml_of,
    whole,
)

LARGEST = 2**28
"""Bytes of a certificate that is read; a million cells of four states have 10^8."""
_STATES = 16
"""Largest number of states."""


class Claim(NamedTuple):
    """What a certificate claims."""

    network: str
    """SHA-256 of the ONNX file."""
    problem: dict[str, Any]
    """Table of `problem_table`."""
    cells: list[list[tuple[float, float]]]
    """Ends of each cell along each state; []: it is of a flight."""
    flight: list[list[float]]
    """States at the control instants of a flight that breaks the property; []: the property is claimed."""


_FORMULAS = list_of(TEXT, 1, 1000)
_POSITIVE = Kind("number above 0, at most 1e4", lambda x: NUMBER.fits(x) and 0 < x <= 1e4)


def claim_of(certificate: bytes) -> Claim:
    """Claim of a certificate's file.

    Raises:
        Refused: it has not exactly the keys of format 1, or a value of another type or out of bounds.
    """
    table = json_of(certificate, LARGEST)
    is_flight = isinstance(table, dict) and "flight" in table
    proofs = {"flight": ANYTHING} if is_flight else {"cells": ANYTHING, "margins": ANYTHING}
    head = {"format": whole(1, 1), "network": DIGEST, "problem": TEXT}
    entries("it", table, head | proofs)
    problem = problem_table(table["problem"])
    count = len(problem["derivative"])
    state = list_of(NUMBER, count, count)
    if is_flight:
        instants = problem["steps"] + 1
        entries("it", {"flight": table["flight"]}, {"flight": list_of(state, instants, instants)})
        return Claim(table["network"], problem, [], table["flight"])
    rows = table["cells"]
    margins = table["margins"]
    kind = list_of(list_of(state, 2, 2), 1, 10_000_000)
    entries("it", {"cells": rows}, {"cells": kind})
    entries("it", {"margins": margins}, {"margins": list_of(ABOVE_ZERO, len(rows), len(rows))})
    cells = [[(float(a), float(b)) for a, b in zip(*row, strict=True)] for row in rows]
    need(all(a <= b for cell in cells for a, b in cell), "it has a cell of upper ends first.")
    return Claim(table["network"], problem, cells, [])


def problem_table(text: str) -> dict[str, Any]:
    """Table of a problem in TOML, every entry of which was checked.

    Raises:
        Refused: it has not exactly the keys of a problem, or a value of another type or out of bounds.
    """
    need(TEXT.fits(text), "its problem is too long.")
    table = toml_of(text)
    needed = {"name": LINE, "period": _POSITIVE, "steps": whole(1, 10_000), "start": TABLE}
    needed |= {"derivative": list_of(TEXT, 1, _STATES), "commands": whole(1, _STATES)}
    optional = {"keep": TABLE, "end": TABLE, "inputs": _FORMULAS, "begins": whole(0, 9999)}
    entries("its problem", table, needed, optional)
    steps = table["steps"]
    count = len(table["derivative"])
    need(table["commands"] <= count, "its problem has more commands than states.")
    need(table.get("begins", 0) < steps, "its property begins after the last period.")
    need({"keep", "end"} & table.keys(), "its problem asks nothing of flights.")
    _box(table["start"], count, "its start")
    if "end" in table:
        _box(table["end"], count, "its end", {"earliest": whole(0, steps)})
    if "keep" in table:
        need(len(table["keep"]) == 1, "its keep has not exactly one property.")
        ((kind, limit),) = table["keep"].items()
        _limit(kind, limit, count)
    return table


def _box(table: Any, count: int, what: str, optional: dict[str, Kind] | None = None) -> None:
    """Refuse what is no table of a lower and an upper corner."""
    corner = list_of(NUMBER, count, count)
    entries(what, table, {"lower": corner, "upper": corner}, optional)
    ends = zip(table["lower"], table["upper"], strict=True)
    need(all(a <= b for a, b in ends), f"{what} has a lower end above the upper one.")


def _limit(kind: str, limit: Any, count: int) -> None:
    """Refuse a property (`Refused`) that is not checked, or whose table has other keys than are checked.

    Every kind that `rans_proof.problem` reads must be here too.
    """
    every = list_of(whole(0, count - 1), 1, count)
    states = Kind("list of different states", lambda x: every.fits(x) and len(set(x)) == len(x))
    if kind in ("avoid", "within"):
        _box(limit, count, f"its {kind}")
    elif kind in ("every", "some"):
        entries("its keep", {kind: limit}, {kind: _FORMULAS})
    elif kind in ("keep_out", "stay_in"):
        entries(f"its {kind}", limit, {"position": states, "radius": NUMBER})
        need(limit["radius"] > 0, "its radius is not above 0.")
    else:
        need(kind == "speed_limit", f"its property {kind[:40]!r} is not checked.")
        plane = Kind("two different states", lambda x: states.fits(x) and len(x) == 2)
        kinds = {"position": states, "velocity": plane, "base": NUMBER, "slope": NUMBER}
        entries(f"its {kind}", limit, kinds)
        # Distances are bounded from below, which serves limits that grow with them.
        need(limit["slope"] >= 0, "the slope of its speed limit is below 0.")


def difference(problem: dict[str, Any], other: dict[str, Any]) -> str:
    """Names of the entries in which two problems differ, or "" if they are the same."""
    names = sorted(problem.keys() | other.keys())
    return ", ".join(name for name in names if problem.get(name) != other.get(name))


def statement(problem: dict[str, Any]) -> str:
    """What is proved of a network if a certificate of a problem is accepted, in a few lines.

    Printed as the theorem and nothing else: every key that changes what is checked must have its words here.
    """
    rates = [_read(rate) for rate in problem["derivative"]]
    taken = ", ".join(map(_read, problem.get("inputs", [f"x{i}" for i in range(len(rates))])))
    commands = ", ".join(f"u{i}" for i in range(problem["commands"]))
    period = problem["period"]
    steps = problem["steps"]
    begins = problem.get("begins", 0)
    begin, last = (f"{n * period:.10g}" for n in (begins, steps))
    held = f"rounded as its file computes, and held for {_digits(period)} s each"
    lines = [
        "plant: " + ", ".join(f"x{i}' = {rate}" for i, rate in enumerate(rates)),
        f"commands: {commands} = network({taken}), {held}",
        f"starts: {_within(problem['start'])}",
    ]
    if "keep" in problem:
        ((kind, limit),) = problem["keep"].items()
        lines.append(f"property, at all times from {begin} to {last} s: {_sentence(kind, limit)}")
    if "end" not in problem:
        return "\n".join(lines)
    end = problem["end"]
    start = problem["start"]
    earliest = end.get("earliest", 0) or steps
    one_of = f" one of the control instants from {earliest * period:.10g} to"
    lines.append(f"end, at{one_of if earliest < steps else ''} {last} s: {_within(end)}")
    is_back = all(a <= x for a, x in zip(start["lower"], end["lower"], strict=True)) and all(
        x <= b for x, b in zip(end["upper"], start["upper"], strict=True)
    )
    if is_back and earliest == steps and "keep" in problem and not begins:
        lines.append("flights end among the starts: the property holds at all later times, too")
    return "\n".join(lines)


def _sentence(kind: str, limit: Any) -> str:
    """A property in a formula of the states x0, x1 ..., as statements of theorems print it."""
    if kind == "within":
        return _within(limit)
    if kind == "avoid":
        return f"never {_within(limit)}, all at once"
    if kind in ("every", "some"):
        joint = " and " if kind == "every" else " or "
        return joint.join(f"{_read(text)} >= 0" for text in limit)
    distance = f"|({', '.join(f'x{i}' for i in limit['position'])})|"
    if kind != "speed_limit":
        return f"{distance} {'>=' if kind == 'keep_out' else '<='} {_digits(limit['radius'])}"
    speed = f"|({', '.join(f'x{i}' for i in limit['velocity'])})|"
    return f"{speed} <= {_digits(limit['base'])} + {_digits(limit['slope'])} {distance}"


def _read(formula: str) -> str:
    """A formula as it was parsed, which is what is checked; its text may mean less than it says."""
    try:
        return ast.unparse(ast.parse(formula.strip(), mode="eval"))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise Refused(f"its formula {formula[:80]!r} cannot be read.") from error


def _within(box: dict[str, Any]) -> str:
    ends = enumerate(zip(box["lower"], box["upper"], strict=True))
    return ", ".join(f"x{i} in [{_digits(low)}, {_digits(high)}]" for i, (low, high) in ends)


def _digits(value: float) -> str:
    """A number with all its digits."""
    return repr(float(value)).removesuffix(".0")
