"""Progress of a training: a live line on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from datetime import timedelta
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn

from rans.terminal import Terminal

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
            print(line, file=sys.stderr, flush=True)


class TrainingProgress(Progress):
    """Shows rows of metrics on standard error; the total is the budget of steps, terms are the reward's."""

    def __init__(self, total: int, terms: bool = False) -> None:
        console = Terminal(stderr=True)
        super().__init__(
            BarColumn(bar_width=_BAR),
            TextColumn("{task.description}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._bar = self.add_task("compiling and warming up ...", total=total)
        self._total = total
        self._plain = NowAndThen()
        self._terms = terms

    def show(self, row: dict[str, Any]) -> None:
        """Show the newest row."""
        text = describe(row, self._total)
        self.update(self._bar, completed=row["steps"], description=text)
        if self.disable:
            self._plain.say(f"training: {text}", surely=row["steps"] >= self._total)
        if self._terms and not self.disable:
            self.console.print(describe_terms(row))
        elif self._terms:
            self._plain.say(describe_terms(row), surely=True)


def describe(row: dict[str, Any], total: int) -> str:
    """Steps, success, return, speed, and the longest that training can still take (h:mm:ss)."""
    reward = sum(value for key, value in row.items() if key.startswith("return/"))
    left = timedelta(seconds=round(max(total - row["steps"], 0) / max(row["steps_per_s"], 1)))
    return (
        f"{row['steps'] / 1e6:.2f} M steps, success {row['success']:.1%}, return {reward:.0f}, "
        f"{row['steps_per_s'] / 1e6:.2f} M/s, {left} left"
    )


def describe_terms(row: dict[str, Any]) -> str:
    """The return by term."""
    terms = " ".join(
        f"{key.removeprefix('return/')} {value:.0f}"
        for key, value in row.items()
        if key.startswith("return/")
    )
    return f"return of {row['steps'] / 1e6:.2f} M steps: {terms}"
