"""Measuring the speed of engine, trainer, optimiser and agents: what command and function share."""

from __future__ import annotations

import gc
import os
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rans.base.errors import ConfigError
from rans.base.registry import typed
from rans.model.spacecraft import Spacecraft
from rans.tasks import TASKS

if TYPE_CHECKING:
    from validation.speed.measurement import Measurement

_SIZES = {"cpu": (1024, 16_384, 262_144), "cuda": (16_384, 262_144, 4_194_304)}
"""Environments stepped together, by the kind of device."""
_QUICK_SIZES = {"cpu": (1024,), "cuda": (262_144,)}
"""The same for rough figures: with fewer a GPU waits for its launches, and the figure is not its speed."""


def chosen_device(device: str | None, quick: bool) -> str:
    """The device to measure on; None: a GPU if there is one.

    Raises:
        ConfigError: it is not here, or the compiler that the CPU's engine needs is missing.
    """
    from rans.fast.device import torch_device
    from rans.fast.learn.trainer import check_device

    result = device or torch_device()
    check_device(result)
    if not (result.startswith("cuda") or quick):
        _check_compiler()
    return result


def measured(
    crafts: Iterable[Spacecraft], task: str, num_envs: Sequence[int], device: str, quick: bool
) -> Iterator[Measurement]:
    """One measurement after the other."""
    from validation.speed.suite import effort, measurements

    usual = _QUICK_SIZES if quick else _SIZES
    sizes = tuple(num_envs) or usual["cuda" if device.startswith("cuda") else "cpu"]
    names = list(crafts)
    for measurement in measurements(
        names, task, TASKS[typed(task)](), sizes, effort(device, quick)
    ):
        yield measurement
        gc.collect()  # engines hang in reference cycles, and with them the device's memory


def _check_compiler() -> None:
    """On a CPU torch compiles the engine with the system's C++ compiler; nothing else here needs one."""
    compiler = os.environ.get("CXX") or ("clang++" if sys.platform == "darwin" else "g++")
    if shutil.which(compiler) is None:
        raise ConfigError(
            f"the compiled engine needs a C++ compiler, but there is no {compiler} here; "
            "training works without one, only this measurement does not; --quick does too."
        )
