"""What a network sees of observations: columns in the body frame, from one side, as filters have them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from rans.policy.architecture import Architecture
from rans.policy.symmetry import Symmetries


class ColumnExecutor(ABC):
    """Computes the columns that a network is given from observations, before it normalises them."""

    @abstractmethod
    def in_body(self, observation: Tensor) -> Tensor:
        """The columns (N, k) of observations (N, width) in the body frame."""

    @abstractmethod
    def seen(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Columns from the side that has the goal ahead, and which side that is, (N,) int64.

        Rows are columns (N, k) and what filters remember; what these make of the columns stands beside them.
        """

    @abstractmethod
    def expected(self, rows: Tensor) -> Tensor:
        """What filters remember after such rows, each with the command that was given."""

    def whole(
        self, observation: Tensor, tensors: Mapping[str, Tensor]
    ) -> tuple[Tensor, Tensor] | None:
        """Log-odds (N, thrusters) and values (N,) of a network with these weights; None: not in one go."""
        return None


MakePreprocessor = Callable[[Architecture, Symmetries | None, Tensor], ColumnExecutor]
"""Makes one for an architecture, its symmetries in tensors, and networks with tensors like the last."""


class TorchPreprocessor(ColumnExecutor):
    """By torch's operations."""

    def __init__(
        self, given: Architecture, views: Symmetries | None, like: Tensor | None = None
    ) -> None:
        self._given = given
        self._views = views

    def in_body(self, observation: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return torch.stack(self._given.preprocessed(observation.unbind(dim=1)), dim=1)

    def seen(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """See `ColumnExecutor`; there are filters, or several sides and a way to go."""
        blocks = self._given.filtered(rows.unbind(dim=1))
        way = self._given.ahead(blocks[0][1])
        views = self._views
        if views is None or way is None:
            seen = torch.stack([x for _, block in blocks for x in block], dim=1)
            return seen, torch.zeros_like(rows[:, 0], dtype=torch.int64)
        which = views.which(way)
        seen = [x for layout, block in blocks for x in views.viewed(layout, block, which)]
        return torch.stack(seen, dim=1), which

    def expected(self, rows: Tensor) -> Tensor:
        """See `ColumnExecutor`."""
        return torch.stack(self._given.expected(rows.unbind(dim=1)), dim=1)
