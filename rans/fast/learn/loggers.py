"""Optional loggers of metrics: TensorBoard hyper-parameters, Weights & Biases, MLflow."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from rans.choices import LoggerName
from rans.errors import ConfigError, require
from rans.fast.learn.config import TrainConfig, to_table
from rans.files import first_line, inside, inside_for_others
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
        if name != "hparams":
            _library(name)


def loggers(names: Sequence[LoggerName], config: TrainConfig, run: Path) -> list[Logger]:
    """Start loggers by name, with the config of a run folder.

    Raises:
        ConfigError: a logger cannot be started.
    """
    writers = {"hparams": _Hparams, "wandb": _WandB, "mlflow": _MLflow}
    plain = (bool, int, float, str)  # lists become texts
    settings = {
        name: x if isinstance(x, plain) else str(x) for name, x in entries(to_table(config))
    }
    results: list[Logger] = []
    for name in dict.fromkeys(names):
        try:
            results.append(writers[name](settings, run))
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


class _Hparams:
    def __init__(self, settings: dict[str, Any], run: Path) -> None:
        require("tensorboard")
        self._settings = settings
        self._folder = str(inside_for_others(run, "tensorboard"))
        self._last: dict[str, float] = {}

    def write(self, row: dict[str, Any]) -> None:
        self._last = {"evaluation/success": row["success"], "perf/steps_per_s": row["steps_per_s"]}

    def close(self) -> None:
        """Write the settings beside the last figures, as TensorBoard compares runs by them."""
        from torch.utils.tensorboard.summary import hparams
        from torch.utils.tensorboard.writer import SummaryWriter

        measured = self._last or {"evaluation/success": 0.0}
        writer = SummaryWriter(self._folder)
        events = writer.file_writer
        assert events is not None  # until the writer is closed
        for summary in hparams(self._settings, measured):
            events.add_summary(summary)
        for name, value in measured.items():
            writer.add_scalar(name, value)
        writer.close()


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


class _MLflow:
    def __init__(self, settings: dict[str, Any], run: Path) -> None:
        self._mlflow = _library("mlflow")
        self._mlflow.set_experiment("rans")
        self._mlflow.start_run(run_name=run.name)
        self._mlflow.log_params(settings)

    def write(self, row: dict[str, Any]) -> None:
        self._mlflow.log_metrics(row, step=row["steps"])

    def close(self) -> None:
        self._mlflow.end_run()


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(
            f"--log {name} needs the package {name} ({first_line(error)}): pip install {name}."
        ) from error
