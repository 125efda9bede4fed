"""Networks are read as ONNX computes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rans.proof.network import apply, read_network
from tests.support.small_networks import layers, written


@pytest.mark.parametrize("activation", ["sigmoid", "relu"])
def test_reading_follows_onnx(activation: str, tmp_path: Path) -> None:
    runtime = pytest.importorskip("onnxruntime")
    network = layers([4, 7, 5, 2], 8, activation)
    file = written(network, tmp_path / "net.onnx")
    session = runtime.InferenceSession(str(file))
    x = np.random.default_rng(1).normal(size=(50, 4)).astype(np.float32)
    (expected,) = session.run(None, {"x": x})
    # The session computes in single precision.
    np.testing.assert_allclose(apply(read_network(file), x), expected, atol=2e-6)
