"""Progress of a training: a live line on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, TextColumn

from rans.terminal import Terminal

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig

_PLAIN_SECONDS = 5.0
"""Between lines when standard error is not a terminal."""


class TrainingProgress:
    """Shows rows of metrics on standard error.

    Args:
        config: gives the budget of steps.
    """

    def __init__(self, config: TrainConfig) -> None:
        self._total = config.total_timesteps
        console = Terminal(stderr=True)
        self._live = Progress(
            TextColumn("training"), BarColumn(bar_width=20), TextColumn("{task.description}"),
            console=console, disable=not console.is_terminal)
        self._bar = self._live.add_task("compiling and warming up ...", total=self._total)
        self._plain = not console.is_terminal
        self._last = 0.0

    def __enter__(self) -> TrainingProgress:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, row: dict[str, Any]) -> None:
        """Show the newest row."""
        text = describe(row, self._total)
        self._live.update(self._bar, completed=row["steps"], description=text)
        if self._plain and (time.monotonic() - self._last > _PLAIN_SECONDS or row["steps"] >= self._total):
            print(f"training: {text}", file=sys.stderr, flush=True)
            self._last = time.monotonic()


def describe(row: dict[str, Any], total: int) -> str:
    """Success, return by term, speed, and the longest that training can still take."""
    terms = " ".join(f"{key.removeprefix('return/')} {value:.0f}" for key, value in row.items()
                     if key.startswith("return/"))
    left = max(total - row["steps"], 0) / max(row["steps_per_s"], 1)
    return (f"{row['steps'] / 1e6:.2f} M steps, success {row['success']:.1%}, return: {terms}, "
            f"{row['steps_per_s'] / 1e6:.2f} M steps/s, at most {left:.0f} s left")
