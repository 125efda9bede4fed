"""What RANS refuses or warns of, and that its sentence names it: the rows of every ``refused.txt``.

The tests of a room run its own (conftest.py); here are those of all rooms.

A row is a call and, below it, the class and the words of its error or warning; ``...`` stands for any others. Calls
without an answer are made before the rows of their file.
"""

from __future__ import annotations

import builtins
import doctest
import functools
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from rans.base import errors

ROOT = Path(__file__).parents[1]


def examples(file: Path) -> list[doctest.Example]:
    return doctest.DocTestParser().get_examples(file.read_text("utf-8"))


FILES = [file for room in ("tests", "packages") for file in (ROOT / room).rglob("refused.txt")]


@functools.cache
def prepared(file: Path) -> dict[str, Any]:
    """Names of a file, whose objects no test sees end."""
    names: dict[str, Any] = {}
    for row in examples(file):
        if not row.want:
            exec(row.source, names)
    return names


COMMANDS = [
    pytest.param(*row.split("\n", 1), id=row.split("\n", 1)[0][:60])
    for file in sorted((ROOT / "tests").rglob("refused_commands.txt"))
    for row in file.read_text("utf-8").rstrip("\n").removeprefix("$ rans ").split("\n$ rans ")
]
"""Command lines of every ``refused_commands.txt``, and words of what is said of each."""


@pytest.mark.parametrize(("line", "words"), COMMANDS)
def test_a_command_is_refused_in_a_sentence_and_writes_nothing(line, words, refused, here):
    assert words in refused("", *shlex.split(line))
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("file", sorted(FILES), ids=lambda file: str(file.parent.relative_to(ROOT)))
@pytest.mark.usefixtures("here")
def test_a_sentence_names_what_is_wrong(file):
    check_rows(file)


def check_rows(file: Path) -> None:
    """Every row of a file of refusals raises the sentence that it states; a note names the row that fails."""
    names = prepared(file)
    for row in examples(file):
        if row.want:
            check(row, names)


def check(row: doctest.Example, names: dict[str, Any]) -> None:
    kind, words = row.want.rstrip("\n").split(": ", 1)
    error = names.get(kind) or getattr(errors, kind, None) or getattr(builtins, kind)
    says = "(?s)" + ".*".join(map(re.escape, words.split("...")))
    catch: Any = pytest.warns if issubclass(error, Warning) else pytest.raises
    try:
        with catch(error, match=says) as caught:
            exec(row.source, names)
        if kind == "ConfigError":
            assert str(caught.value).endswith((".", "?"))
            assert "\n" not in str(caught.value)
    except BaseException as wrong:
        wrong.add_note(f"line {row.lineno + 1}: {row.source}")
        raise
