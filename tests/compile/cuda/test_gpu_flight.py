"""Flights of the kernel on a GPU against those of a CPU, whose commands are float32's."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from rans.compile.cuda.flight import Products
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant
from rans.fast.flights import Flights
from rans.flight_statistics import QUANTITIES

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
]
COUNT = 16384


@pytest.mark.parametrize(("products", "alike"), [("bf16", 0.1), ("bf16x3", 0.9), ("bf16x6", 0.9)])
@pytest.mark.parametrize(
    "name",
    [
        "go-to-pose-2d-fast",
        "go-to-pose-2d",
        "go-to-pose-3d",
        "multi-task-2d",
        "go-to-pose-2d-robust",
        "go-to-pose-3d-robust",
    ],
)
def test_the_kernel_flies_as_a_cpu_does(name: str, products: Products, alike: float) -> None:
    run = contestant(f"pretrained:{name}")
    assert isinstance(run.controller, Agent)
    count = COUNT // 8 if run.conditions else COUNT
    kernel = Flights(run.controller.network, run.judged, "cuda", products=products).fly(5, count, 7)
    exact = Flights(run.controller.network, run.judged).fly(5, count, 7)
    assert kernel.ways == {f"flight kernel, {products}"}
    # Of bfloat16 one command in a thousand is another, and with it the rest of its flight; else one in 1e5.
    same = set(kernel.numbers) & set(exact.numbers)
    share = 0.03 if products == "bf16" else 5e-3
    if name.endswith("robust"):  # whether a reading is repeated exactly depends on its last bit
        share = 4.0 * share
    assert len(same) >= alike * max(kernel.unsolved, exact.unsolved) - 2
    # Those that go another way are others of the same kind, whose number at a moment spreads like its root,
    # and whose mean like its standard error.
    assert np.abs(kernel.settled_at - exact.settled_at).sum() <= share * math.sqrt(count * COUNT)
    for quantity in QUANTITIES:
        found = kernel.sums[quantity]
        expected = exact.sums[quantity]
        assert abs(found.mean - expected.mean) <= 3.0 * expected.error


@pytest.mark.parametrize("generated", [True, False])
def test_parts_add_up(generated: bool) -> None:
    run = contestant("pretrained:go-to-pose-2d-fast")
    assert isinstance(run.controller, Agent)
    flights = Flights(run.controller.network, run.judged, "cuda", generated=generated)
    whole = flights.fly(0, 3001, 1)
    parts = flights.fly(0, 1000, 1) + flights.fly(1000, 2001, 1)
    assert whole.failures == parts.failures
    np.testing.assert_array_equal(whole.numbers, parts.numbers)
    np.testing.assert_array_equal(whole.settled_at, parts.settled_at)
