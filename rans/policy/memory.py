"""Memory of networks from step to step: a history, and the state of filters.

A history (N, m) has rows of columns in the body frame and the command they were answered with, or of commands
alone: first exponential moving averages of all of them, then the last ones, the oldest first. What filters
remember stands behind it.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from rans.model.fields import Field
from rans.policy.architecture import Architecture
from rans.policy.preprocess import ColumnExecutor
from rans.policy.symmetry import Symmetries
from rans.tasks.observation_terms import Layout

PolicyState = Tensor | None
"""What a policy remembers of N spacecraft from step to step, (N, m): a history, and what filters expect; None of
a policy without memory. Zeros where an episode begins (`Remembering.initial_state`)."""

MakePreprocessor = Callable[[Architecture, Symmetries | None, Tensor], ColumnExecutor]
"""Makes an executor of preprocessing for an architecture, its symmetries in tensors, and networks with tensors like
the last argument."""


class Remembering:
    """Memory of a network about N spacecraft, in the columns of its view.

    Args:
        architecture: of the network.
        like: a tensor of its device and dtype.
        preprocessor: makes what computes columns, such as `rans.policy.preprocess.TorchPreprocessor`.
    """

    def __init__(
        self, architecture: Architecture, like: Tensor, preprocessor: MakePreprocessor
    ) -> None:
        self.architecture = architecture
        self._like = like
        decays = like.new_tensor(architecture.averages)
        views = architecture.symmetries
        self._kept = decays.repeat_interleave(architecture.row)
        self._views = None if views is None else views.tensors_like(like)
        self._preprocessor = preprocessor(architecture, self._views, like)

    def initial_state(self, count: int) -> PolicyState:
        """The memory (N, m) of N spacecraft whose episodes begin; None for a network that has none."""
        width = self.architecture.memory
        return self._like.new_zeros(count, width) if width else None

    def _parted(self, memory: Tensor | None, count: int) -> tuple[Tensor | None, Tensor | None]:
        """History (N, m), and what filters remember, which know nothing without a memory.

        A history comes first in the memory, filters behind it.
        """
        architecture = self.architecture
        if not architecture.filtering:
            return memory, None
        if memory is None:
            memory = self._like.new_zeros(count, architecture.memory)
        history, filters = memory.tensor_split([architecture.rows], dim=1)
        return history if architecture.recalled else None, filters

    def next_state(self, columns: Tensor, memory: PolicyState, command: Tensor) -> PolicyState:
        """The memory (N, m) after a command to columns in the body frame.

        Args:
            columns: (N, k) columns in the body frame.
            memory: (N, m) before the command.
            command: (N, thrusters).
        """
        if memory is None:
            return None
        history, filters = self._parted(memory, len(columns))
        parts = []
        if history is not None:
            observed = columns[:, : self.architecture.answered]
            parts.append(continued(history, torch.cat((observed, command), dim=1), self._kept))
        if filters is not None:
            parts.append(
                self._preprocessor.next_filter_memory(torch.cat((columns, filters, command), dim=1))
            )
        return torch.cat(parts, dim=1) if len(parts) > 1 else parts[0]


def continued(history: Tensor, newest: Tensor, decay: Tensor) -> Tensor:
    """A history after a new row (N, k); ``decay``, (averages k,), is the share that each average keeps."""
    averages, moments = history.tensor_split([len(decay)], dim=1)
    if len(decay):
        averages = torch.lerp(newest.repeat(1, len(decay) // newest.shape[1]), averages, decay)
    if not moments.shape[1]:
        return averages
    return torch.cat((averages, moments[:, newest.shape[1] :], newest), dim=1)


def viewed(history: Tensor, rows: int, layout: Layout, views: Symmetries, which: Tensor) -> Tensor:
    """A history of so many rows from the sides (N,) of the spacecraft that ``which`` names.

    The layout is of the columns in a row; commands alone have none.
    """
    each = which.repeat_interleave(rows)
    commands = history.reshape(len(each), -1)
    then, commands = commands.tensor_split([commands.shape[1] - views.place.shape[1]], dim=1)
    if then.shape[1]:
        then = torch.stack(views.viewed(layout, then.unbind(dim=1), each), dim=1)
    commands = torch.empty_like(commands).scatter(1, views.place[each], commands)
    return torch.cat((then, commands), dim=1).reshape(len(history), -1)


def by_row(function: Callable[[Tensor], Tensor], x: Tensor, count: int) -> Tensor:
    """A function applied to each of ``count`` rows that stand side by side, (..., n, count k)."""
    rows = function(x.unflatten(-1, (count, -1)).flatten(-3, -2))
    return rows.unflatten(-2, (-1, count)).flatten(-2)


# Formulas on fields, of which the traced program has the same (`rans.policy.traced`).


def averaged(average: Field, newest: Field, decay: Field) -> Field:
    """An exponential moving average that keeps this share of itself."""
    return newest + decay * (average - newest)
