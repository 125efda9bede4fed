"""Loggers of metrics beside ``metrics.jsonl``: TensorBoard, and Weights & Biases on request."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from rans.choices import LoggerName
from rans.errors import ConfigError
from rans.fast.learn.config import TrainConfig, to_table
from rans.files import first_line, inside
from rans.structure import entries


class Logger(Protocol):
    """Logger of rows of metrics."""

    def write(self, row: dict[str, Any]) -> None:
        """Log a row, which has its number of ``steps``."""

    def close(self) -> None:
        """Finish the log."""


def require_loggers(names: Sequence[LoggerName]) -> None:
    """Reject (`ConfigError`) loggers whose library is not installed."""
    for name in names:
        _library(name)


def loggers(names: Sequence[LoggerName], config: TrainConfig, run: Path) -> list[Logger]:
    """Start loggers by name, with the config of a run folder.

    Raises:
        ConfigError: a logger cannot be started.
    """
    plain = (bool, int, float, str)  # lists become texts
    settings = {
        name: x if isinstance(x, plain) else str(x) for name, x in entries(to_table(config))
    }
    results: list[Logger] = []
    for name in dict.fromkeys(names):
        try:
            results.append(_WandB(settings, run))
        except Exception as error:  # services may raise anything
            raise ConfigError(f"--log {name} cannot start: {first_line(error)}.") from error
    return results


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


class _WandB:
    def __init__(self, settings: dict[str, Any], run: Path) -> None:
        inside(run, "wandb")  # its folder; it creates links among its own files
        self._run = _library("wandb").init(
            project="rans", name=run.name, config=settings, dir=str(run)
        )

    def write(self, row: dict[str, Any]) -> None:
        self._run.log(row, step=row["steps"])

    def close(self) -> None:
        self._run.finish()


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(
            f"--log {name} needs the package {name} ({first_line(error)}): pip install {name}."
        ) from error
