"""Preprocessing of observations: columns, symmetric views, filters and normalisation.

They are formulas on fields, which torch, machine code, CUDA kernels and exported files all compute
(docs/decisions/learning.md has why vectors are in the frame of the spacecraft).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import one_hot

from rans.model.fields import Field, tanh, within
from rans.policy.adaptation import Estimate, Rows
from rans.policy.symmetry import Symmetries

if TYPE_CHECKING:
    from rans.policy.architecture import Architecture


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
        self, architecture: Architecture, views: Symmetries | None, like: Tensor | None = None
    ) -> None:
        self._architecture = architecture
        self._views = views

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        if observation.device.type == "cpu" and not torch.is_grad_enabled():
            # Single operations on few rows cost half in NumPy.
            rows = np.ascontiguousarray(observation.numpy().T)
            columns = np.broadcast_arrays(*self._architecture.preprocessed(tuple(rows)))
            return torch.from_numpy(np.stack(columns)).T
        return torch.stack(self._architecture.preprocessed(observation.unbind(dim=1)), dim=1)

    def viewed(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`; there are filters, or several sides and a way to go."""
        architecture = self._architecture
        if architecture.adapts:
            read, memory = rows.tensor_split([architecture.read_count], dim=1)
            estimate = self._estimate(read, memory)
            gains = [gain[:, 0] for gain in estimate.gains]
            lost = estimate.shut.sum(dim=1)
            columns = architecture.kind.adapted(architecture, read.unbind(dim=1), gains, lost)
            return (
                torch.cat((torch.stack(columns, dim=1), *estimate.known), dim=1),
                torch.zeros_like(rows[:, 0], dtype=torch.int64),
            )
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
        """Next memory (N, m) of filters from rows (N, body, memory and command); see `ColumnExecutor`."""
        architecture = self._architecture
        if architecture.adapts:
            adaptation = architecture.adaptation
            read, memory, command = rows.split(
                [
                    architecture.read_count,
                    adaptation.width,
                    rows.shape[1] - architecture.read_count - adaptation.width,
                ],
                dim=1,
            )
            estimate = self._estimate(read, memory)
            return adaptation.next_memory(TorchRows(rows), estimate.memory, command)
        return torch.stack(architecture.next_filter_memory(rows.unbind(dim=1)), dim=1)

    def _estimate(self, read: Tensor, memory: Tensor) -> Estimate[Tensor]:
        """What a policy that adapts estimates after a reading."""
        adaptation = self._architecture.adaptation
        return adaptation.estimated(TorchRows(read), read[:, : adaptation.twist], memory)


@dataclass(eq=False)
class TorchRows(Rows[Tensor]):
    """Rows of `rans.policy.adaptation` as tensors of the device and type of another one."""

    like: Tensor

    def constant(self, values: object) -> Tensor:
        """See `Rows`."""
        return self.like.new_tensor(values)

    def product(self, row: Tensor, table: np.ndarray) -> Tensor:
        """See `Rows`."""
        return row @ self.like.new_tensor(table)

    def split(self, row: Tensor, widths: Sequence[int]) -> list[Tensor]:
        """See `Rows`."""
        return list(row.split(list(widths), dim=-1))

    def joined(self, rows: Sequence[Tensor]) -> Tensor:
        """See `Rows`."""
        return torch.cat(list(rows), dim=-1)

    def computed(self, formula: Callable[..., list[Field]], rows: Sequence[Tensor]) -> list[Tensor]:
        """See `Rows`."""
        return formula(*rows)

    def largest(self, row: Tensor, width: int) -> Tensor:
        """See `Rows`."""
        return one_hot(row.argmax(dim=-1), width).to(row.dtype)
