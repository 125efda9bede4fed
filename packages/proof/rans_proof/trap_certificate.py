"""Certificates of trapping sets: the one reader of their files, and the theorem that a certificate states.

The checker judges and the pages print what is read here, so that they cannot differ. The schema is closed: a key
that nobody checks is refused, since it would be printed beside those that are.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from rans.extend import ConfigError, brief, is_finite, parse_json

FORMAT = 2
"""Version of the file. Those of version 1 had no SHA-256 of config.json."""
PROPERTY = "trapping set of a velocity-tracking agent whose goal is at rest"
FILES = ("agent.safetensors", "config.json", "spacecraft.toml")
"""Files of an agent that decide its flight, and whose SHA-256 a certificate has."""
MOST_CELLS = 2**28
"""Largest number of the smallest cells of a grid: one byte each in the memory of every process that checks."""
LARGEST = 2**26
"""Bytes of a certificate that is read; 11,250 cells have 3 x 10^5."""
_LIMITS = ("speed", "spin")
_GRID = ("rings", "sectors", "layers", "fine")
_ERRORS = ("mass", "thrust", "velocity", "spin", "delay")
_KEYS = ("format", "property", "agent", "keep", "start", "grid", "uncertainty", "cells")


class TrapCertificate(NamedTuple):
    """Content of a certificate, of which only the form is known to be right."""

    agent: dict[str, str]
    """SHA-256 of each of the agent's files, in hexadecimal."""
    keep: dict[str, float]
    """Limits of speed (m/s) and spin (rad/s)."""
    start: dict[str, float]
    """Speed (m/s) and spin (rad/s) up to which every state is a start."""
    grid: dict[str, int]
    """Rings of speed, sectors of direction, layers of spin of either sign, and layers of a pulse."""
    uncertainty: dict[str, float]
    """See `rans_proof.trap.Uncertainty`."""
    cells: list[tuple[int, ...]]
    """Begin and end of the rings, of the sectors and of the layers of each cell."""
    sha256: str
    """SHA-256 of the file, in hexadecimal."""

    @property
    def theorem(self) -> str:
        """What it states, without a full stop: starts, property, time and errors."""
        keep, start = self.keep, self.start
        return (
            f"with its goal at rest, from every velocity up to {_digits(start['speed'])} m/s with any spin up to "
            f"{_digits(start['spin'])} rad/s, it never exceeds {_digits(keep['speed'])} m/s and "
            f"{_digits(keep['spin'])} rad/s, for ever; {self.errors}"
        )

    @property
    def errors(self) -> str:
        """How far what flies may be from its design, in words and units, as pages and commands print it.

        A key of "uncertainty" without words here would be an error that the theorem does not name.
        """
        off = {name: _digits(value) for name, value in self.uncertainty.items() if value}
        sentences = {
            "mass": "mass and inertia off by up to {} of them, by one factor",
            "thrust": "thrusts off by up to {} of them, by one factor for all",
            "velocity": "readings of each component of the velocity off by up to {} m/s",
            "spin": "readings of the spin off by up to {} rad/s",
            "delay": "one constant delay of up to {} s, the same for all valves, to open and to shut",
        }
        return ", ".join(sentences[name].format(x) for name, x in off.items()) or "all as designed"


def differing(agent: Mapping[str, str], files: Mapping[str, bytes]) -> str:
    """Name of the first of an agent's files that is another than a certificate's, or "".

    Args:
        agent: SHA-256 of each file, of a certificate.
        files: contents.
    """
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    return next((name for name in FILES if agent[name] != digests.get(name)), "")


def read_certificate(content: bytes, where: object) -> TrapCertificate:
    """Content of the file of a certificate.

    Args:
        content: content of the file.
        where: name of the file in messages.

    Raises:
        ConfigError: it is no certificate of a trapping set, or has a value that none can have.
    """
    table = parse_json(content, where)
    if not isinstance(table, dict) or "grid" not in table or "cells" not in table:
        raise ConfigError(f"{where} is no certificate of an agent's trapping set.")
    try:
        return _certificate(table, hashlib.sha256(content).hexdigest())
    except ConfigError as error:
        raise ConfigError(
            f"{where} is no certificate that rans prove writes: {error} Prove it anew."
        ) from error


def _certificate(table: dict[str, Any], digest: str) -> TrapCertificate:
    """The certificate of a table with closed keys and numbers in range; `ConfigError` names no file."""
    if table.get("format") != FORMAT or isinstance(table["format"], bool):
        raise ConfigError(f"format must be {FORMAT}, got {brief(table.get('format'))}.")
    _check_keys("it", table, _KEYS)
    if table["property"] != PROPERTY:
        raise ConfigError(f"property must be {PROPERTY!r}, got {brief(table['property'])}.")
    agent = _check_keys("agent", table["agent"], FILES)
    for name, value in agent.items():
        is_digest = isinstance(value, str) and len(value) == 64 and set(value) <= _HEXADECIMAL
        if not is_digest:
            raise ConfigError(f"agent.{name} must be a SHA-256, got {brief(value)}.")
    # Limits, starts and errors.
    keep, start = (_numbers(key, table[key], _LIMITS) for key in ("keep", "start"))
    for name in _LIMITS:
        if not keep[name] > 0.0:
            raise ConfigError(f"keep.{name} must be above 0, got {keep[name]:g}.")
        if not 0.0 <= start[name] <= keep[name]:
            raise ConfigError(
                f"start.{name} must be from 0 to the {keep[name]:g} of keep, got {start[name]:g}."
            )
    uncertainty = _numbers("uncertainty", table["uncertainty"], _ERRORS)
    for name, value in uncertainty.items():
        if not 0.0 <= value < 1.0:
            raise ConfigError(f"uncertainty.{name} must be from 0 to below 1, got {value:g}.")
    # Cells on a grid that fits into memory.
    grid = _check_keys("grid", table["grid"], _GRID)
    for name, value in grid.items():
        if not _is_whole(value) or not 1 <= value <= MOST_CELLS:
            raise ConfigError(
                f"grid.{name} must be a whole number from 1 to {MOST_CELLS}, got {brief(value)}."
            )
    count = 2 * grid["rings"] * grid["sectors"] * grid["layers"]
    check_size(count)
    return TrapCertificate(
        agent, keep, start, grid, uncertainty, _cells(table["cells"], count), digest
    )


def check_size(count: int) -> None:
    """Refuse (`ConfigError`) a grid of too many smallest cells."""
    if count > MOST_CELLS:
        raise ConfigError(
            f"a grid may have at most {MOST_CELLS:,} of the smallest cells, got {count:,}; the usual cause is a "
            "large --resolution."
        )


def _cells(cells: Any, most: int) -> list[tuple[int, ...]]:
    """Cells of a list, at most ``most``, each of six whole numbers; all else is refused (`ConfigError`)."""
    if not isinstance(cells, list) or not 1 <= len(cells) <= most:
        count = len(cells) if isinstance(cells, list) else brief(cells)
        raise ConfigError(
            f"cells must be a list of at least one and at most {most:,}, got {count}."
        )
    for number, cell in enumerate(cells):
        if not (isinstance(cell, list) and len(cell) == 6 and all(map(_is_whole, cell))):
            raise ConfigError(f"cell {number} must be six whole numbers, got {brief(cell)}.")
    return [tuple(cell) for cell in cells]


def _check_keys(what: str, table: Any, names: Iterable[str]) -> dict[str, Any]:
    """The table, which has exactly these keys."""
    names = set(names)
    if not isinstance(table, dict) or table.keys() != names:
        got = sorted(table) if isinstance(table, dict) else table
        raise ConfigError(f"{what} must have exactly {', '.join(sorted(names))}, got {brief(got)}.")
    return table


def _numbers(what: str, table: Any, names: Iterable[str]) -> dict[str, float]:
    """The finite numbers of a table that has exactly these keys."""
    for name, value in _check_keys(what, table, names).items():
        if not is_finite(value):
            raise ConfigError(f"{what}.{name} must be a finite number, got {brief(value)}.")
    return {name: float(table[name]) for name in names}


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _digits(value: float) -> str:
    """All digits of a number, since a rounded limit is another theorem; "1" of 1.0."""
    return repr(value).removesuffix(".0")


_HEXADECIMAL = frozenset("0123456789abcdef")
