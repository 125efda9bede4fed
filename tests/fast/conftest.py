from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import torch

from rans import Engine
from tests.support.engines import torch_engine


@pytest.fixture(params=["numpy", "torch"])
def backend(request) -> Iterator[Callable[..., Engine]]:
    """Makes engines that step on NumPy, or on torch as on a GPU but without compiling."""
    if request.param == "numpy":
        yield Engine
        return
    with torch.compiler.set_stance("force_eager"):
        yield torch_engine
