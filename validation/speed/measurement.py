"""One figure of merit, and the clock behind it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch

Kind = Literal["memory", "engine", "flights", "training", "policy"]


@dataclass(frozen=True)
class Measurement:
    """One figure of merit."""

    kind: Kind
    """Of what."""
    name: str
    """What was measured."""
    value: float | None
    """Median over the repeats, unless the name says otherwise; None where it could not be measured."""
    unit: str
    """Of the value."""
    warm_up: float = 0.0
    """Seconds of compiling and first calls, not part of the value."""
    note: str = ""
    """What it was measured on, or why it was not measured."""
    bound: float | None = None
    """What the value should be compared with, in its unit."""
    bound_name: str = ""
    """What the bound is."""


@dataclass(frozen=True)
class Clock:
    """Times functions on one device."""

    device: str
    """Torch device whose work is waited for."""
    repeats: int = 7
    """Each figure is the median of so many."""
    seconds: float = 0.3
    """Wall time of each repeat, about."""

    _WARM_UP = 4
    """Calls; a `rans.fast.learn.graph.graphed` function is recorded in the third."""

    def time(self, function: Callable[[], object]) -> tuple[float, float]:
        """Median seconds of one call, and seconds of warm-up."""
        warm_up = self._took(function, self._WARM_UP) * self._WARM_UP
        calls = max(1, round(self.seconds / self._took(function, 1)))
        return statistics.median(self._took(function, calls) for _ in range(self.repeats)), warm_up

    def once(self, function: Callable[[], object]) -> float:
        """Seconds of a single call."""
        self.wait()
        return self._took(function, 1)

    def _took(self, function: Callable[[], object], calls: int) -> float:
        """Seconds of one of so many calls."""
        begun = time.perf_counter()
        for _ in range(calls):
            function()
        self.wait()
        return (time.perf_counter() - begun) / calls

    def wait(self) -> None:
        """Until the device has done everything that it was told to do."""
        if self.on_gpu:
            torch.cuda.synchronize()

    @property
    def on_gpu(self) -> bool:
        """Whether the device is a GPU."""
        return self.device.startswith("cuda")
