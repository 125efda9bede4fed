"""Random damage to files, and what must come of it: each is read as it is, or refused in a sentence."""

from __future__ import annotations

import json
import random
import re
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from rans import RansError


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Bytes with a few of them changed, missing, repeated or of others' kinds."""
    result = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 8])):
        at = chance.randrange(len(result)) if result else 0
        length = chance.choice([1, 1, 2, 4, 8, 100])
        what = chance.randrange(5)
        if what == 0:
            result[at : at + length] = chance.randbytes(length)
        elif what == 1:
            del result[at : at + length]
        elif what == 2:
            result[at:at] = result[at : at + length]
        elif what == 3:
            result[at : at + length] = chance.choice([b"\xff", b"\0", b"9"]) * length
        else:
            del result[at:]
    return bytes(result)


ODD = [None, True, -1, 0, 2**70, 1e308, -1e-320, "", "x", "nan", "inf", [], [1], {}, {"a": 1}, [[]]]
"""What takes the place of a value in a table."""


def edited(
    value: Any, swap: Callable[[Any], Iterable[Any]], path: str = ""
) -> Iterator[tuple[str, Any]]:
    """Copies of a nested value, with what ``swap`` gives in place of one value in it, and that value's place."""
    for other in swap(value):
        yield path, other
    if isinstance(value, dict):
        for key, inner in value.items():
            for where, other in edited(inner, swap, f"{path}.{key}"):
                yield where, value | {key: other}
    elif isinstance(value, list):
        for at, inner in enumerate(value[:3]):
            for where, other in edited(inner, swap, f"{path}[{at}]"):
                yield where, [*value[:at], other, *value[at + 1 :]]


def toml(table: Any) -> str:
    """A table as TOML; inner tables are inline, and TOML writes texts and numbers as JSON does."""

    def inline(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{key} = {inline(x)}" for key, x in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(inline, value)) + "]"
        return json.dumps(value)

    if not isinstance(table, dict):
        return json.dumps(table)
    return "".join(f"{key} = {inline(value)}\n" for key, value in table.items())


FORMS: dict[str, tuple[Callable[[str], Any], Callable[[Any], str]]] = {
    ".json": (json.loads, json.dumps),
    ".jsonl": (
        lambda text: [json.loads(line) for line in text.splitlines()],
        lambda rows: "\n".join(map(json.dumps, rows if isinstance(rows, list) else [rows])),
    ),
    ".toml": (tomllib.loads, toml),
}
"""Readers and writers of tables, by the ending of a file."""


def mutations(file: Path, count: int, seed: int) -> Iterator[bytes]:
    """A file's content with damage in so many ways, and eight times as many edits of its values, if it has some."""
    whole = file.read_bytes()
    chance = random.Random(f"{file.name} {seed}")

    def odd(value: Any) -> Iterator[Any]:
        yield chance.choice(ODD)
        for key in value if isinstance(value, dict) else ():
            yield {other: x for other, x in value.items() if other != key}

    for _ in range(count):
        yield damaged(whole, chance)
    if file.suffix in FORMS:
        read, write = FORMS[file.suffix]
        edits = [*edited(read(whole.decode()), odd)]
        for _, value in chance.sample(edits, min(len(edits), 8 * count)):
            yield write(value).encode()


PYTHON = re.compile(
    r"Error\b|NoneType|object (is|has|of)|argument|nsupported|Unknown format|could not convert|unhashable"
)
"""Words of Python's own errors, which no sentence of RANS has."""


def check(files: list[Path], ask: Callable[[], object], often: float = 1.0) -> None:
    """Damage each of the files 8 times, or so many times as often, and ask; only a RansError may come out.

    Of tables each value is also replaced or missing, and then the error names the file.
    """
    ask()  # while nothing is damaged
    refused = 0
    for file in files:
        whole = file.read_bytes()
        for content in mutations(file, round(8 * often), 7):
            file.write_bytes(content)
            said = ""
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    ask()
            except RansError as error:
                said = str(error)
            except Exception as error:
                raise AssertionError(f"{file.name}: {content!r}") from error
            if said and file.suffix in FORMS:
                assert file.name in said or str(file.parent) in said, (said, content)
                own = said.partition(" cannot be loaded")[
                    0
                ]  # the rest is said by the code of an export
                assert not PYTHON.search(own), (said, content)
            refused += bool(said)
        file.write_bytes(whole)
    assert refused > 0
