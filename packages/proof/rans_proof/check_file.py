"""The checker's own reader of certificates: a closed schema, and the sentence that a certificate proves.

It shares no code with `rans_proof.problem`. What is not in the schema is refused, since a key that no checker reads
would be a claim that no checker checks.
"""

from __future__ import annotations

import json
import math
import tomllib
from typing import Any, NamedTuple

from rans_proof.balls import Refused

LARGEST = 2**28
"""Bytes of a certificate that is read; a million cells of four states have 10^8."""
_CELLS = 10_000_000
_TEXT = 2**16
"""Characters of a problem; those of the examples have less than a thousand."""
_BOUND = 1e9
"""Numbers of a problem are below this."""
_STATES = 12
_STEPS = 10_000
_FORMULAS = 1000
_PERIOD = 1e4


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


def claim_of(certificate: bytes) -> Claim:
    """Claim of a certificate's file.

    Raises:
        Refused: it has not exactly the keys of format 1, or a value of another type or out of bounds.
    """
    if len(certificate) > LARGEST:
        raise Refused(f"it has {len(certificate):,} bytes, and at most {LARGEST:,} are read.")
    try:
        table = json.loads(certificate, object_pairs_hook=_once, parse_constant=_constant)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused("it is damaged, it is not valid JSON.") from error
    proofs = {"flight"} if isinstance(table, dict) and "flight" in table else {"cells", "margins"}
    _keys(table, {"format", "network", "problem"} | proofs, "it")
    if type(table["format"]) is not int or table["format"] != 1:
        raise Refused("its format is not 1, the only one that is known.")
    network, text = table["network"], table["problem"]
    if not (
        isinstance(network, str) and len(network) == 64 and set(network) <= set("0123456789abcdef")
    ):
        raise Refused("its network is no SHA-256 of 64 digits.")
    if not isinstance(text, str):
        raise Refused("its problem is no text.")
    problem = problem_table(text)
    count = len(problem["derivative"])
    if "flight" in table:
        states = table["flight"]
        if not isinstance(states, list) or len(states) != problem["steps"] + 1:
            raise Refused(f"its flight has not the {problem['steps'] + 1} states of its problem.")
        flight = [_numbers(state, "flight") for state in states]
        if not all(len(state) == count for state in flight):
            raise Refused(f"its flight has not {count} numbers a state.")
        return Claim(network, problem, [], flight)
    rows, margins = table["cells"], table["margins"]
    if not (isinstance(rows, list) and 1 <= len(rows) <= _CELLS):
        raise Refused("it has no cells, so that it proves nothing, or more than can be checked.")
    cells = [_box(row, count, f"cell {k}") for k, row in enumerate(rows)]
    if not all(margin > 0.0 for margin in _numbers(margins, "margins")):
        raise Refused("it has a margin that is not above 0.")
    if len(margins) != len(cells):
        raise Refused(f"it has {len(margins)} margins for {len(cells)} cells.")
    return Claim(network, problem, cells, [])


def problem_table(text: str) -> dict[str, Any]:
    """Table of a problem in TOML, every entry of which was checked.

    Raises:
        Refused: it has not exactly the keys of a problem, or a value of another type or out of bounds.
    """
    if len(text) > _TEXT:
        raise Refused(f"its problem has {len(text):,} characters, and at most {_TEXT:,} are read.")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused("its problem is not valid TOML.") from error
    keys = {"name", "period", "steps", "derivative", "commands", "start"}
    _keys(table, keys | ({"keep", "end", "inputs", "begins"} & table.keys()), "its problem")
    if not {"keep", "end"} & table.keys():
        raise Refused("its problem asks nothing of flights.")
    rates = table["derivative"]
    if not (
        isinstance(rates, list)
        and all(isinstance(x, str) for x in rates)
        and 1 <= len(rates) <= _STATES
    ):
        raise Refused(f"its derivative is no list of 1 to {_STATES} formulas.")
    count = len(rates)
    name = table["name"]
    if not (isinstance(name, str) and len(name) <= 200 and name.isprintable()):
        raise Refused("its name is no line of at most 200 characters.")
    _whole(table["steps"], 1, _STEPS, "steps")
    _whole(table["commands"], 1, count, "commands")
    if not 0.0 < _number(table["period"], "period") <= _PERIOD:
        raise Refused(f"its period is not above 0 and at most {_PERIOD:g} s.")
    _corners(table["start"], count, "start")
    _whole(table.get("begins", 0), 0, table["steps"] - 1, "begins")
    if "inputs" in table:
        _texts(table["inputs"], "inputs")
    if "end" in table:
        end = dict(table["end"]) if isinstance(table["end"], dict) else table["end"]
        if isinstance(end, dict):
            _whole(end.pop("earliest", 0), 0, table["steps"], "end.earliest")
        _corners(end, count, "end")
    if "keep" in table:
        _check_property(table["keep"], count)
    return table


def _check_property(keep: Any, count: int) -> None:
    """Refuse a property that is not checked."""
    if not (isinstance(keep, dict) and len(keep) == 1):
        raise Refused("its keep has not exactly one property.")
    ((kind, limit),) = keep.items()
    if kind in ("avoid", "within"):
        _corners(limit, count, kind)
    elif kind in ("every", "some"):
        _texts(limit, kind)
    elif kind in ("keep_out", "stay_in"):
        _keys(limit, {"position", "radius"}, f"its {kind}")
        _states(limit["position"], count, f"{kind}.position")
        if not _number(limit["radius"], "radius") > 0.0:
            raise Refused("its radius is not above 0.")
    elif kind == "speed_limit":
        _keys(limit, {"position", "velocity", "base", "slope"}, "its speed_limit")
        _states(limit["position"], count, "speed_limit.position")
        if len(_states(limit["velocity"], count, "speed_limit.velocity")) != 2:
            raise Refused(
                "its speed_limit.velocity has not two states: a limit of a velocity in the plane is checked."
            )
        _number(limit["base"], "base")
        if not _number(limit["slope"], "slope") >= 0.0:  # distances are bounded from below
            raise Refused("the slope of its speed limit is below 0.")
    else:
        raise Refused(f"its property {kind[:40]!r} is not checked.")


def _texts(texts: Any, what: str) -> None:
    """Refuse what is no list of formulas."""
    good = isinstance(texts, list) and 1 <= len(texts) <= _FORMULAS
    if not good or not all(isinstance(text, str) for text in texts):
        raise Refused(f"its {what} is no list of 1 to {_FORMULAS} formulas.")


def statement(problem: dict[str, Any]) -> str:
    """What is proved of a network if a certificate of a problem is accepted, in a few lines."""
    count = len(problem["derivative"])
    states = ", ".join(problem.get("inputs", [f"x{i}" for i in range(count)]))
    commands = ", ".join(f"u{i}" for i in range(problem["commands"]))
    period, steps = problem["period"], problem["steps"]
    begin, end = (f"{n * period:.10g}" for n in (problem.get("begins", 0), steps))
    lines = [
        "plant: "
        + ", ".join(
            f"x{i}' = {' '.join(rate.split())}" for i, rate in enumerate(problem["derivative"])
        ),
        f"commands: {commands} = network({states}), computed exactly and held for {_digits(period)} s each",
        f"starts: {_within(problem['start'])}",
    ]
    if "keep" in problem:
        ((kind, limit),) = problem["keep"].items()
        lines.append(f"property, at all times from {begin} to {end} s: {_sentence(kind, limit)}")
    if "end" not in problem:
        return "\n".join(lines)
    earliest = problem["end"].get("earliest", 0) or steps
    if earliest < steps:
        lines.append(
            f"end, at one of the control instants from {earliest * period:.10g} to {end} s: "
            + _within(problem["end"])
        )
        return "\n".join(lines)
    lines.append(f"end, at {end} s: {_within(problem['end'])}")
    inner, outer = (
        _box([problem[key]["lower"], problem[key]["upper"]], count, key) for key in ("end", "start")
    )
    is_back = all(c <= a and b <= d for (a, b), (c, d) in zip(inner, outer, strict=True))
    if is_back and "keep" in problem and not problem.get("begins", 0):
        lines.append(
            "flights end among the starts, so that the property holds at all later times, too"
        )
    return "\n".join(lines)


def difference(problem: dict[str, Any], other: dict[str, Any]) -> str:
    """Names of the entries in which two problems differ, or "" if they are the same."""
    names = sorted(problem.keys() | other.keys())
    return ", ".join(name for name in names if problem.get(name) != other.get(name))


def _sentence(kind: str, limit: dict[str, Any]) -> str:
    """A property in a formula."""
    if kind == "within":
        return _within(limit)
    if kind == "avoid":
        return f"never {_within(limit)}, all at once"
    if kind in ("every", "some"):
        joint = " and " if kind == "every" else " or "
        return joint.join(f"{' '.join(text.split())} >= 0" for text in limit)
    distance = f"|({', '.join(f'x{i}' for i in limit['position'])})|"
    if kind == "keep_out":
        return f"{distance} >= {_digits(limit['radius'])}"
    if kind == "stay_in":
        return f"{distance} <= {_digits(limit['radius'])}"
    speed = f"|({', '.join(f'x{i}' for i in limit['velocity'])})|"
    return f"{speed} <= {_digits(limit['base'])} + {_digits(limit['slope'])} {distance}"


def _within(box: dict[str, Any]) -> str:
    ends = zip(box["lower"], box["upper"], strict=True)
    return ", ".join(
        f"x{i} in [{_digits(low)}, {_digits(high)}]" for i, (low, high) in enumerate(ends)
    )


def _digits(value: float) -> str:
    """A number with all its digits."""
    return repr(float(value)).removesuffix(".0")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Object of JSON whose keys are there once."""
    table = dict(pairs)
    if len(table) != len(pairs):
        raise Refused("it is damaged, it has a key twice.")
    return table


def _constant(name: str) -> Any:
    raise Refused(f"it has the number {name}, which is not finite.")


def _keys(table: Any, names: set[str], what: str) -> None:
    """Refuse what is no table of exactly these keys."""
    if not isinstance(table, dict) or table.keys() != names:
        raise Refused(f"{what} has not exactly the keys {', '.join(sorted(names))}.")


def _whole(value: Any, least: int, largest: int, what: str) -> None:
    if type(value) is not int or not least <= value <= largest:
        raise Refused(f"its {what} is no whole number from {least} to {largest}.")


def _number(value: Any, what: str) -> float:
    if type(value) not in (int, float) or not -_BOUND < value < _BOUND:
        raise Refused(f"its {what} is no number below {_BOUND:g}.")
    return value


def _numbers(values: Any, what: str) -> list[float]:
    if not isinstance(values, list):
        raise Refused(f"its {what} is no list.")
    return [_number(value, what) for value in values]


def _states(numbers: Any, count: int, what: str) -> list[int]:
    """Numbers of states, each at most once."""
    if not isinstance(numbers, list) or not numbers:
        raise Refused(f"its {what} is no list of states.")
    for number in numbers:
        _whole(number, 0, count - 1, what)
    if len(set(numbers)) != len(numbers):
        raise Refused(f"its {what} has a state twice.")
    return numbers


def _corners(table: Any, count: int, what: str) -> list[tuple[float, float]]:
    """Ends along each state of a table of lower and upper."""
    _keys(table, {"lower", "upper"}, f"its {what}")
    return _box([table["lower"], table["upper"]], count, what)


def _box(corners: Any, count: int, what: str) -> list[tuple[float, float]]:
    """Ends along each state of a list of a lower and an upper corner."""
    if not isinstance(corners, list) or len(corners) != 2:
        raise Refused(f"its {what} has not a lower and an upper corner.")
    low, high = (_numbers(corner, what) for corner in corners)
    if not len(low) == len(high) == count or not all(
        a <= b for a, b in zip(low, high, strict=True)
    ):
        raise Refused(f"its {what} is no box of {count} states, lower ends first.")
    assert all(math.isfinite(x) for x in (*low, *high))
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
