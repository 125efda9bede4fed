"""The built site asks for nothing elsewhere: a script, style, font or picture of another address is an error."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_FETCHED = (
    re.compile(
        r"""<(?:script|img|iframe|source|video|embed)\b[^>]*\bsrc=["'](?:https?:)?//[^"']+"""
    ),
    re.compile(
        r"""<link\b[^>]*\brel=["'](?:stylesheet|preload|icon|preconnect)[^>]*\bhref=["'](?:https?:)?//[^"']+"""
    ),
    re.compile(
        r"""<link\b[^>]*\bhref=["'](?:https?:)?//[^"']+["'][^>]*\brel=["'](?:stylesheet|preload)"""
    ),
    re.compile(r"""url\(["']?(?:https?:)?//[^)]+|@import\s+["'](?:https?:)?//[^"']+"""),
)


def fetched(text: str) -> list[str]:
    """What a page or a style sheet would fetch from another address.

    >>> fetched('<script src="https://cdn.example/x.js"></script><a href="https://example.org">x</a>')
    ['<script src="https://cdn.example/x.js']
    """
    return [one[0] for pattern in _FETCHED for one in pattern.finditer(text)]


def _check(app: Sphinx, exception: Exception | None) -> None:
    from sphinx.errors import SphinxError

    if exception is not None or app.builder.format != "html":
        return
    for file in sorted(Path(app.outdir).rglob("*")):
        if file.suffix in (".html", ".css") and (foreign := fetched(file.read_text("utf-8"))):
            raise SphinxError(
                f"{file.relative_to(app.outdir)} would fetch from another address: {foreign[0]}. "
                "Pages must open without a network: keep a copy in docs/_static."
            )


def setup(app: Sphinx) -> dict[str, Any]:
    """Check every page once all are written."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
