"""Markdown tables of the generated pages."""

from __future__ import annotations

import re
from collections.abc import Iterable


def table(columns: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A Markdown table; what stands as docs/PAGE.md in its cells leads there."""
    lines = [columns, tuple("---" for _ in columns), *(tuple(map(_cell, row)) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _cell(text: str) -> str:
    """A text in one line; what Markdown would take for mark-up stands as it is, but for `code`."""
    pieces = re.split(r"(`[^`]*`)", text.strip())
    kept = [
        piece if piece.startswith("`") else re.sub(r"(?<!\[)([*_])(?!\])", r"\\\1", piece)
        for piece in pieces
    ]
    text = "".join(kept).replace("|", "\\|").replace("\n", "<br>")
    return re.sub(r"\bdocs/([\w-]+)\.md", r"[\1](/\1.md)", text)
