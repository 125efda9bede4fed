"""Texts of other languages: what a stranger writes becomes no code, key or line of theirs.

Every language has a type, whose `word` is its one escaper. Printers put values into their templates by `of`, which
leaves text of the language as it is and escapes any other, as templates of HTML do with `Markup`.
"""

from __future__ import annotations

import json
import re
from typing import Any, ClassVar, Self

_LONGEST = 1000
"""Largest number of characters of an escaped text: that of a sentence that has some names."""


class Code(str):
    """Text of a language that a printer writes as it stands."""

    __slots__ = ()
    meaningful: ClassVar[re.Pattern[str]]
    """What ends a comment or a text in quotes of the language, or continues its line."""

    @classmethod
    def word(cls, text: object) -> Self:
        """Any text, as one line for a comment or between quotes: what means something there becomes "_"."""
        clean = cls.meaningful.sub("_", str(text))
        return cls("".join(c if c.isprintable() else "_" for c in clean)[:_LONGEST])

    @classmethod
    def of(cls, value: object) -> Self:
        """Text of the language and numbers as they are, any other text as a `word`."""
        return cls(value) if isinstance(value, cls | int | float) else cls.word(value)


class Python(Code):
    """Python, in a docstring."""

    __slots__ = ()
    meaningful = re.compile(r"[\"'\\]")


class Toml(Code):
    """TOML 1.0."""

    __slots__ = ()
    meaningful = re.compile(r"[\ud800-\udfff]")

    @classmethod
    def value(cls, value: Any) -> Toml:
        """A text in quotes, a number or a list: JSON has them alike, but DEL may stand in a text of JSON alone."""
        return cls(json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f"))
