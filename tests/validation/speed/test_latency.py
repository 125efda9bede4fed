from __future__ import annotations

import sys

import numpy as np
import pytest

from rans.fast.learn.config import PPOSettings
from rans.tasks import GoToPose
from tests.support.engines import PLATFORM
from validation.speed import latency


def test_median_and_99th_percentile_in_microseconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten calls of 7 ms to warm up, then a hundred of 1 to 100 ms."""
    took = [7e-3] * 10 + [k * 1e-3 for k in range(100, 0, -1)]
    readings = iter([reading for seconds in took for reading in (50.0, 50.0 + seconds)])
    monkeypatch.setattr(latency.time, "perf_counter", lambda: next(readings))
    median, tail = latency._measured("NumPy, x", lambda x: x, np.zeros(1), 100)
    assert (median.name, median.value, median.unit) == (
        "NumPy, x, median",
        pytest.approx(50_500.0),
        "us",
    )
    assert (tail.name, tail.value) == ("NumPy, x, 99th percentile", pytest.approx(99_010.0))
    assert (median.warm_up, median.note) == (pytest.approx(0.07), "of 100 calls")


def test_ways_to_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where ONNX is missing a row says what it needs."""
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2)
    found = list(latency.latencies(PLATFORM, GoToPose(), settings, 20))
    assert [m.name for m in found] == [
        *(
            f"{way}, floating-platform, {which}"
            for way in ("torch, eager", "NumPy")
            for which in ("median", "99th percentile")
        ),
        "ONNX, floating-platform",
    ]
    assert [m.value is None for m in found] == [False] * 4 + [True]
    assert "needs a package: import of onnxruntime halted" in found[-1].note
