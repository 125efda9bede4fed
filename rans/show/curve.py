"""The learning curve, by a process that loads Matplotlib while another one trains."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from rans.processes import beside

Rows = Sequence[Mapping[str, Any]]
"""Lines of ``metrics.jsonl``."""


_SOME = [{"steps": 1, "seconds": 1.0, "success": 0.5, "return/term": 1.0}]


def curve(rows: Rows) -> str:
    """`rans.show.figures.figures.learning_curve` as the text of an SVG file."""
    from rans.show.figures.figures import learning_curve
    from rans.show.figures.svg import svg

    return svg(learning_curve(rows))


@contextmanager
def curve_in_another_process() -> Iterator[Callable[[Rows], str]]:
    """`curve` once, by another process that is ready for it by then; here, where that fails."""
    if "matplotlib" in sys.modules:
        yield curve
        return
    receiver, sender = Pipe()

    def ask(rows: Rows) -> str:
        try:
            receiver.send(rows)
            return receiver.recv()
        except (OSError, EOFError):
            return curve(rows)

    with receiver, beside(_draw, sender):
        sender.close()
        yield ask


def _draw(pipe: Connection) -> None:
    curve(_SOME)  # loads Matplotlib and its fonts
    pipe.send(curve(pipe.recv()))
