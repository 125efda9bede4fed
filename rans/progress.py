"""Progress of work that takes long: one protocol for all that reports it and all that shows it."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called while work goes on with the number of units done since the last call.

    A unit is what the work consists of: an episode, a problem, a bound, a frame.
    """

    def __call__(self, count: int, /) -> object:
        """Report so many more units."""
        ...


class Stages(Protocol):
    """Called when a stage of the work begins, with its name and number of units; returns its `Progress`.

    The number is None where nobody knows it.
    """

    def __call__(self, name: str, total: int | None, /) -> Progress:
        """Begin a stage."""
        ...


def unseen(count: int, /) -> None:
    """`Progress` that nobody watches."""


def unseen_stages(name: str, total: int | None, /) -> Progress:
    """`Stages` that nobody watches."""
    return unseen
