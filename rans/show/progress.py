"""Progress: of a training as a live line, of other work as bars; in notebooks as lines of text."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn

from rans.base.progress import Stages
from rans.base.system import is_terminal, to_stderr
from rans.base.terminal import REDRAWN, Terminal, progress, stages

_SECONDS = 5.0
"""Between plain lines."""
_BAR = 10
"""Characters of the bar: with the longest text beside it a line has 80."""


class NowAndThen:
    """Plain lines on standard error, not too many."""

    _last = -_SECONDS

    def say(self, line: str, surely: bool = False) -> None:
        """Say it if the last line was some seconds ago, or surely."""
        if surely or time.monotonic() - self._last > _SECONDS:
            self._last = time.monotonic()
            to_stderr(line)


class TrainingProgress(Progress):
    """Shows rows of metrics on standard error; the total is the budget of steps."""

    def __init__(self, total: int) -> None:
        console = Terminal(stderr=True)
        super().__init__(
            BarColumn(bar_width=_BAR),
            TextColumn("{task.description}"),
            console=console,
            disable=not console.is_terminal,
            refresh_per_second=REDRAWN,
        )
        self._bar = self.add_task("compiling and warming up ...", total=total)
        self._total = total
        self._plain = NowAndThen()

    def show(self, row: dict[str, Any]) -> None:
        """Show the newest row of metrics, as a live line or, without a terminal, now and then as text."""
        text = describe(row, self._total)
        self.update(self._bar, completed=row["steps"], description=text)
        if self.disable:
            self._plain.say(f"training: {text}", surely=row["steps"] >= self._total)


def describe(row: dict[str, Any], total: int) -> str:
    """Steps, episodes solved, return, speed, and the longest that training can still take (h:mm:ss).

    Where no episode ended since the last row, and after an imitation, there is neither a return nor a time left.
    """
    terms = [value for key, value in row.items() if key.startswith("return/")]
    reward = f"return {sum(terms):.0f}, " if terms else ""
    rate = row["steps_per_s"]
    speed = f"{rate / 1e6:.2f} M/s" if rate >= 1e4 else f"{rate:,.0f} steps/s"
    left = timedelta(seconds=round(max(total - row["steps"], 0) / max(rate, 1)))
    text = f"{row['steps'] / 1e6:.2f} M steps, solved {row['success']:.1%}, {reward}{speed}"
    return f"{text}, {left} left" if terms else text


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this code, whose cells show HTML."""
    shell = sys.modules.get("IPython")
    result = None if shell is None else shell.get_ipython()
    return type(result).__name__ == "ZMQInteractiveShell"


_SAVED_EVERY = 60.0
"""s between two files of results that a long call leaves if it is killed."""


def _saving(stages: Stages, save: Callable[[], object]) -> Stages:
    """The stages, during whose work results are written every `_SAVED_EVERY`."""
    last = time.monotonic()

    def stage(name: str, total: int | None, /) -> Callable[[int], None]:
        step = stages(name, total)

        def advance(count: int, /) -> None:
            nonlocal last
            step(count)
            if time.monotonic() - last >= _SAVED_EVERY:
                save()
                last = time.monotonic()

        return advance

    return stage


@contextmanager
def watched(save: Callable[[], object] = lambda: None) -> Iterator[Stages]:
    """Progress of a call from Python: bars on a terminal, now and then a line elsewhere.

    Args:
        save: writes the results so far, which is done now and then for when the process is killed.
    """
    with progress() as bars:
        yield _saving(stages(bars), save)


@contextmanager
def watched_training(
    total: int, visible: bool | None
) -> Iterator[Callable[[dict[str, Any]], object]]:
    """Function that displays rows of a training's metrics as `TrainingProgress` does.

    Args:
        total: budget of environment steps.
        visible: whether; None: on a terminal and in a notebook.
    """
    if not (in_notebook() or is_terminal(sys.stderr) if visible is None else visible):
        yield lambda row: None
        return
    with TrainingProgress(total) as bar:
        yield bar.show
