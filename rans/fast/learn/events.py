"""TensorBoard events of a training."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path


class Events:
    """TensorBoard events in a folder; none are written where the package tensorboard is missing.

    ``metrics.jsonl`` has all that they show.
    """

    def __init__(self, folder: Path) -> None:
        try:
            from torch.utils.tensorboard.writer import SummaryWriter
        except ImportError:  # torch asks for tensorboard, which it does not install
            self._writer = None
        else:
            self._writer = SummaryWriter(str(folder))

    def write(self, row: Mapping[str, float], steps: int) -> None:
        """Write numbers by their names at a number of environment steps."""
        if self._writer is None:
            return
        for name, value in row.items():
            self._writer.add_scalar(name, value, steps)
        self._writer.flush()
