"""Random damage to files, and what must come of it: each is read as it is, or refused in a sentence."""

from __future__ import annotations

import json
import random
import warnings
from collections.abc import Callable, Iterator
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
"""What takes the place of a value of JSON."""


def odd_json(value: Any, chance: random.Random) -> Any:
    """Copy of a nested value with one entry, anywhere in it, replaced, missing or renamed."""
    if not isinstance(value, dict | list) or not value or chance.random() < 0.15:
        return chance.choice(ODD)
    if isinstance(value, list):
        at = chance.randrange(len(value))
        return [*value[:at], odd_json(value[at], chance), *value[at + 1 :]]
    key = chance.choice(sorted(value))
    if chance.random() < 0.15:
        return {k: x for k, x in value.items() if k != key}
    return value | {key: odd_json(value[key], chance)}


def mutations(file: Path, count: int, seed: int) -> Iterator[int]:
    """Damage a file in so many ways, one after the other; yield the number of each."""
    whole = file.read_bytes()
    for number in range(count):
        chance = random.Random(f"{file.name} {seed} {number}")
        if file.suffix == ".json" and number % 2:
            file.write_text(json.dumps(odd_json(json.loads(whole), chance)))
        else:
            file.write_bytes(damaged(whole, chance))
        yield number
    file.write_bytes(whole)


def check(files: list[Path], ask: Callable[[], object], often: float = 1.0) -> None:
    """Damage each of the files 8 times, or so many times as often, and ask; only a RansError may come out."""
    ask()  # while nothing is damaged
    refused = 0
    for file in files:
        for number in mutations(file, round(8 * often), 7):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    ask()
            except RansError as error:
                refused += bool(str(error))
            except Exception as error:
                raise AssertionError(f"{file.name}, mutation {number}") from error
    assert refused > 0
