"""Engines whose generated kernel runs on the CPU."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from rans.fast.engine import Engine
from tests.support.host_kernels import HostKernel


@pytest.fixture
def on_host(tmp_path: Path) -> Iterator[Callable[..., Engine]]:
    """Makes engines on the CPU that step by their kernel."""

    def make(*args: Any, **kwargs: Any) -> Engine:
        engine = Engine(*args, compiled=True, **kwargs)
        engine._kernel = HostKernel(engine, tmp_path)
        return engine

    with torch.compiler.set_stance("force_eager"):
        yield make
