"""Texts, data and code in pages: everything that comes from a file is a claim, and is text, never mark-up.

Jinja's templates escape what they are filled with. Only what this module makes goes into a page as it stands, and
`tests/show/pages/test_hostile_texts.py` finds who makes mark-up elsewhere.
"""

from __future__ import annotations

import html
import json
import re
from typing import Any

_LEAVES_SCRIPT = re.compile(r"<!--|</?script", re.IGNORECASE)
"""Where a parser of HTML may leave a script element, or begin to read its text in another way (HTML standard,
section 13.2.5.4, "script data state" and those that follow it)."""
_ESCAPED = {ord(c): f"\\u{ord(c):04x}" for c in "<>&'"}
"""Letters that mean something to HTML, as JSON and JavaScript write them; JSON has none outside of texts."""


class Markup(str):
    """Text that goes into a page as it stands; what is made of it with other texts is a plain text again."""

    __slots__ = ()

    def __html__(self) -> str:
        """The text itself, which Jinja does not escape again."""
        return self


def text(value: str) -> Markup:
    """A text for an element or a quoted attribute of HTML."""
    return Markup(html.escape(value))


def data(value: Any) -> Markup:
    """A value as JSON, which a script element may hold: it ends no element, whatever its texts are."""
    return Markup(json.dumps(value, separators=(",", ":")).translate(_ESCAPED))


def code(*parts: str) -> Markup:
    """Code of RANS itself, with data by `data` in it, as the text of a script element.

    Raises:
        ValueError: it would end its element. Only data that has not been escaped does.
    """
    whole = "\n".join(parts)
    if found := _LEAVES_SCRIPT.search(whole):
        raise ValueError(f"code of a page holds {found[0]!r}, which ends its script element")
    return Markup(whole)
