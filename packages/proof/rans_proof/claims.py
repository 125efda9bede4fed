"""The checker's reader of text: JSON and TOML whose tables are closed and whose values are of known kinds.

A key that is not read would be a claim that is not checked, so it is refused.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from typing import Any, NamedTuple

from rans_proof.balls import Refused, need


class Kind(NamedTuple):
    """Values that an entry may have."""

    words: str
    """What it is, for messages."""
    fits: Callable[[Any], bool]
    """Whether a value is one."""


def whole(low: int, high: int) -> Kind:
    """Whole numbers within bounds, both of which are allowed."""
    words = f"whole number from {low} to {high}"
    return Kind(words, lambda x: type(x) is int and low <= x <= high)


def list_of(kind: Kind, low: int, high: int) -> Kind:
    """Lists of so many values of a kind."""
    words = f"list of {low} to {high}, each a {kind.words}"
    return Kind(
        words, lambda x: isinstance(x, list) and low <= len(x) <= high and all(map(kind.fits, x))
    )


ANYTHING = Kind("value", lambda x: True)
TABLE = Kind("table", lambda x: isinstance(x, dict))
TEXT = Kind("text", lambda x: isinstance(x, str) and len(x) < 2**16)
LINE = Kind("line of text", lambda x: TEXT.fits(x) and len(x) <= 200 and x.isprintable())
NUMBER = Kind("number below 1e9", lambda x: type(x) in (int, float) and -1e9 < x < 1e9)
ABOVE_ZERO = Kind("number above 0", lambda x: NUMBER.fits(x) and x > 0)
DIGEST = Kind(
    "SHA-256 of 64 digits",
    lambda x: isinstance(x, str) and len(x) == 64 and set(x) <= set("0123456789abcdef"),
)


def entries(
    what: str, table: Any, needed: dict[str, Kind], optional: dict[str, Kind] | None = None
) -> Any:
    """A table of these keys, with values of their kinds; anything else is refused.

    Readers take a table's values without further tests after this.
    """
    kinds = needed | (optional or {})
    is_closed = isinstance(table, dict) and needed.keys() <= table.keys() <= kinds.keys()
    need(is_closed, f"{what} has not exactly the keys {', '.join(sorted(kinds))}.")
    for key, value in table.items():
        need(kinds[key].fits(value), f"the {key} of {what} is no {kinds[key].words}.")
    return table


def json_of(content: bytes | str, largest: int) -> Any:
    """A JSON document of at most so many bytes, no table of which has a key twice.

    Raises:
        Refused: it is none.
    """
    need(len(content) <= largest, f"it has more than {largest:,} bytes.")
    try:
        return json.loads(content, object_pairs_hook=_once)
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused("it is damaged, it is not valid JSON.") from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    need(len(table) == len(pairs), "it is damaged, it has a key twice.")
    return table


def toml_of(content: bytes | str) -> dict[str, Any]:
    """A TOML document, from its bytes or text.

    Raises:
        Refused: it is none.
    """
    try:
        return tomllib.loads(content if isinstance(content, str) else content.decode())
    except (ValueError, RecursionError, MemoryError) as error:
        raise Refused("it is not valid TOML.") from error
