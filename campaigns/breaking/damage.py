"""What accidents and strangers do to files: every kind of damage, from a random number generator."""

from __future__ import annotations

import random
import re

_NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][+-]?\d+)?")
_VALUES = (
    "0",
    "-0.0",
    "-1",
    "1e-9",
    "1e9",
    "1e308",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "NaN",
    "Infinity",
    "true",
    "null",
    '""',
    '"x"',
    "[]",
    "{}",
    "[1]",
    "[[1, 2], [3]]",
    "1" + "0" * 400,
    "18446744073709551616",
    '"[/red]\\u001b[31m"',
    '"' + "x" * 100_000 + '"',
    "[" * 3000 + "]" * 3000,
    "0.1",
    "1000000",
    '"../../etc/passwd"',
    '"posix:system"',
    "2024-01-01",
    "0x10",
    "1_000",
)
"""What may stand where a number should."""
_INSERTED = (
    "\x00",
    "\x1b[2J",
    "\ufeff",
    "\r",
    "\u202e",
    "=",
    "[[",
    "]",
    '"',
    "'",
    "#",
    "\n[a]\n",
    "{",
    "e",
    "\ud7ff",
    "💥",
    "\t",
    "\\",
)


def damaged_text(text: str, random: random.Random) -> str:
    """The text with one to three changes: of values mostly, of lines, of characters."""
    for _ in range(random.randint(1, 3)):
        text = random.choice((_value, _value, _value, _line, _character, _key))(text, random)
    return text


def damaged_bytes(content: bytes, random: random.Random) -> bytes:
    """The content with flipped bits, cut short, with a piece twice, empty, or all zeros."""
    way = random.randrange(6)
    at = random.randrange(max(1, len(content)))
    if way == 0:
        flipped = bytearray(content or b"x")
        for _ in range(random.choice((1, 1, 8, 100))):
            flipped[random.randrange(len(flipped))] ^= 1 << random.randrange(8)
        return bytes(flipped)
    if way == 1:
        return content[:at]
    if way == 2:
        return content[:at] + content[max(0, at - 100) :]
    if way == 3:
        return b""
    if way == 4:
        return bytes(len(content))
    return content[:at] + random.randbytes(64) + content[at + 64 :]


def _value(text: str, random: random.Random) -> str:
    places = list(_NUMBER.finditer(text))
    if not places:
        return _character(text, random)
    found = random.choice(places)
    return text[: found.start()] + random.choice(_VALUES) + text[found.end() :]


def _line(text: str, random: random.Random) -> str:
    lines = text.splitlines() or [""]
    at = random.randrange(len(lines))
    other = random.randrange(len(lines))
    way = random.randrange(4)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(at, lines[other])
    elif way == 2:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines = lines[:at]
    return "\n".join(lines) + "\n"


def _character(text: str, random: random.Random) -> str:
    at = random.randrange(len(text) + 1)
    return text[:at] + random.choice(_INSERTED) + text[at + random.randrange(2) :]


def _key(text: str, random: random.Random) -> str:
    words = list(re.finditer(r"[a-z_]{3,}", text))
    if not words:
        return _character(text, random)
    found = random.choice(words)
    other = random.choice(words)
    new = random.choice((other[0], other[0], found[0] + "s", found[0].upper(), "x" * 5000))
    return text[: found.start()] + new + text[found.end() :]
