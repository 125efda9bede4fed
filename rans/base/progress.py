"""Protocols of progress reports, between long computations and displays."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Callback of a computation with the number of units done since the last call.

    A unit is a part of the work, such as an episode, a problem, a bound or a frame.
    """

    def __call__(self, count: int, /) -> object:
        """Report ``count`` more units."""
        ...


class Stages(Protocol):
    """Callback at the start of a stage with its name and number of units (None: unknown); returns `Progress`."""

    def __call__(self, name: str, total: int | None, /) -> Progress:
        """Begin a stage."""
        ...


def unseen(count: int, /) -> None:
    """`Progress` without a display."""


def unseen_stages(name: str, total: int | None, /) -> Progress:
    """`Stages` without a display."""
    return unseen
