"""Tables whose first column has names of settings, commands and agents: on wide windows they stay whole."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

LONGEST = 30
"""Letters of a name; paths that are longer leave no room for the other columns, and break."""


def _mark(app: Sphinx, doctree: nodes.document) -> None:
    """Give such tables of a page the class names, which docs/_static/rans.css knows."""
    for table in doctree.findall(nodes.table):
        first = [row[0] for row in table.findall(nodes.row) if len(row)]
        names = [name.astext() for entry in first for name in entry.findall(nodes.literal)]
        words = [word for name in names for word in name.split()]
        if words and max(map(len, words)) <= LONGEST:
            table["classes"].append("names")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("doctree-read", _mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
