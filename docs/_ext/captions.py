"""Captions of pictures: the alternative text of a picture that stands alone is also a sentence below it."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx


def _caption(app: Sphinx, doctree: nodes.document) -> None:
    """Add the captions of a page; pictures in tables have rows and columns, and none."""
    for image in [*doctree.findall(nodes.image)]:
        alone = image.parent
        text = image.get("alt", "").strip()
        if not (text and isinstance(alone, nodes.paragraph) and len(alone) == 1):
            continue
        if not isinstance(alone.parent, nodes.entry):
            sentence = text if text.endswith((".", ":")) else f"{text}."
            caption = nodes.paragraph(sentence, sentence, classes=["caption-of-picture"])
            alone.parent.insert(alone.parent.index(alone) + 1, caption)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-read", _caption)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
