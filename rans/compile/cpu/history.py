"""What a policy remembers of very many flights on a CPU: rows of NumPy's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.policy.architecture import Architecture
from rans.policy.symmetry import Symmetries


class CpuHistory:
    """A history of N flights that begin, as `rans.policy.memory` keeps it: averages, then the last rows.

    Args:
        given: the network's architecture.
        count: N.
    """

    def __init__(self, given: Architecture, count: int) -> None:
        self._given = given
        self._views = None
        if given.symmetries is not None:
            turn, hand, place = given.symmetries
            self._views = Symmetries(turn.astype(np.float32), hand.astype(np.float32), place)
            self._back = np.argsort(place, axis=1)
        self._rows = np.zeros((given.recalled, given.row, count), np.float32)

    def shown(self, view: np.ndarray) -> np.ndarray:
        """Rows (recalled, row, N) of columns and commands from one side of the craft each, (N,)."""
        if self._views is None or not len(self._rows):
            return self._rows
        width = self._given.answered
        found = np.empty_like(self._rows)
        if width:
            then: list[Any] = list(self._rows[:, :width].swapaxes(0, 1))
            for i, column in enumerate(self._views.viewed(self._given.layout.body, then, view)):
                found[:, i] = column
        told = self._back[view].T[None]
        found[:, width:] = np.take_along_axis(self._rows[:, width:], told, axis=1)
        return found

    def remember(self, columns: Sequence[np.ndarray], command: np.ndarray) -> None:
        """A command (thrusters, N) and the columns (N,) in the body frame that it answered."""
        given = self._given
        rows = self._rows
        if not given.recalled:
            return
        newest = np.empty_like(rows[0])
        for i, column in enumerate(columns[: given.answered]):
            newest[i] = column
        newest[given.answered :] = command
        averages, moments = np.split(rows, [len(given.averages)])
        for row, kept in zip(averages, given.averages, strict=True):
            row[...] = newest + np.float32(kept) * (row - newest)
        if given.history:
            moments[:-1] = moments[1:]
            moments[-1] = newest
