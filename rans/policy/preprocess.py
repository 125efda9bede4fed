"""Preprocessing of observations: columns, symmetric views, filters and normalisation.

They are formulas on fields, which torch, machine code, CUDA kernels and exported files all compute
(docs/decisions/policies.md has why vectors are in the frame of the spacecraft).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import torch
from torch import Tensor

from rans.model.fields import Field, tanh, within
from rans.policy.parts import PreprocessingView
from rans.policy.symmetry import Symmetries


def normalised(x: Field, mean: Field, scale: Field, clip: float) -> Field:
    """A column with zero mean and unit variance over those seen in training, clipped.

    The scale is one over the standard deviation.
    """
    return within((x - mean) * scale, -clip, clip)


def magnified(x: Field, zoom: Field) -> Field:
    """A column magnified and squashed: steepest at zero, where the goal is of every column that is no cosine."""
    return tanh(x * zoom)


class ColumnExecutor(ABC):
    """Computes the columns that a network is given from observations, before it normalises them."""

    @abstractmethod
    def in_body(self, observation: Tensor) -> Tensor:
        """The columns (N, k) of observations (N, width) in the body frame."""

    @abstractmethod
    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Columns from the side that has the goal ahead, and which side that is, (N,) int64.

        Rows are columns (N, k) and what filters remember; what these make of the columns stands beside them.
        """

    @abstractmethod
    def next_filter_memory(self, rows: Tensor) -> Tensor:
        """Memory of filters after these rows, each with the command that was given."""

    def whole(
        self, observation: Tensor, tensors: Mapping[str, Tensor]
    ) -> tuple[Tensor, Tensor] | None:
        """Log-odds (N, thrusters) and values (N,) of a network with these weights; None: not in one go."""
        return None


class TorchPreprocessor(ColumnExecutor):
    """By torch's operations."""

    def __init__(
        self, architecture: PreprocessingView, views: Symmetries | None, like: Tensor | None = None
    ) -> None:
        self._architecture = architecture
        self._views = views

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return torch.stack(self._architecture.preprocessed(observation.unbind(dim=1)), dim=1)

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`; there are filters, or several sides and a way to go."""
        blocks = self._architecture.filtered(rows.unbind(dim=1))
        direction = self._architecture.ahead(blocks[0][1])
        views = self._views
        if views is None or direction is None:
            columns = torch.stack([x for _, block in blocks for x in block], dim=1)
            return columns, torch.zeros_like(rows[:, 0], dtype=torch.int64)
        which = views.which(direction)
        columns = [x for layout, block in blocks for x in views.viewed(layout, block, which)]
        return torch.stack(columns, dim=1), which

    def next_filter_memory(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return torch.stack(self._architecture.next_filter_memory(rows.unbind(dim=1)), dim=1)
