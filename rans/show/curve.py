"""The learning curve, by a process that loads Matplotlib while another one trains."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from rans.processes import beside

Rows = Sequence[Mapping[str, Any]]
"""Lines of ``metrics.jsonl``."""


def curve(rows: Rows) -> str:
    """`rans.show.figures.learning_curve` as the text of an SVG file."""
    from rans.show.figures import learning_curve, svg

    return svg(learning_curve(rows))


@contextmanager
def drawn_beside() -> Iterator[Callable[[Rows], str]]:
    """`curve` once, by another process that is ready for it by then; here, where that fails."""
    if "matplotlib" in sys.modules:
        yield curve
        return
    here, there = Pipe()

    def ask(rows: Rows) -> str:
        try:
            here.send(rows)
            return here.recv()
        except (OSError, EOFError):
            return curve(rows)

    with here, beside(_draw, there):
        there.close()
        yield ask


def _draw(there: Connection) -> None:
    importlib.import_module("rans.show.figures")  # which loads Matplotlib
    there.send(curve(there.recv()))
