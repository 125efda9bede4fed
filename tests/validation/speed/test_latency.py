from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans.evaluation.fly.agent import Agent
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import begin
from rans.tasks import GoToPose
from tests.fast.engines import PLATFORM, both_crafts
from tests.fast.test_policy import seen
from tests.fast.training import scatter
from validation.speed import latency
from validation.speed.latency import numpy_policy, onnx_policy


@pytest.mark.parametrize("activation", ["tanh", "elu", "relu"])
@both_crafts
def test_numpy_answers_as_torch_does(craft: Any, activation: Any) -> None:
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2, layers=(16, 24), activation=activation)
    policy = scatter(begin(Engine(craft, GoToPose(), 1), [settings], [0]).network)
    policy.update_statistics(policy.in_body(seen(craft, 500))[None])
    observation = seen(craft, 200, seed=4).float().numpy()
    expected = Agent(policy, "").act(None, None, observation)
    assert 0.2 < expected.mean() < 0.8  # of both kinds
    np.testing.assert_array_equal(numpy_policy(policy)(observation), expected)


def test_onnx_answers_as_torch_does() -> None:
    for package in ("onnxruntime", "onnxscript"):
        pytest.importorskip(package)
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2)
    policy = scatter(begin(Engine(PLATFORM, GoToPose(), 1), [settings], [0]).network)
    act = onnx_policy(policy)
    for row in seen(PLATFORM, 20).float().numpy():
        np.testing.assert_array_equal(act(row[None]), Agent(policy, "").act(None, None, row[None]))


def test_median_and_99th_percentile_in_microseconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten calls of 7 ms to warm up, then a hundred of 1 to 100 ms."""
    took = [7e-3] * 10 + [k * 1e-3 for k in range(100, 0, -1)]
    readings = iter([reading for seconds in took for reading in (50.0, 50.0 + seconds)])
    monkeypatch.setattr(latency.time, "perf_counter", lambda: next(readings))
    median, tail = latency._measured("NumPy, x", lambda x: x, np.zeros(1), 100)
    assert (median.name, median.value, median.unit) == ("NumPy, x, median", pytest.approx(50_500.0), "us")
    assert (tail.name, tail.value) == ("NumPy, x, 99th percentile", pytest.approx(99_010.0))
    assert (median.warm_up, median.note) == (pytest.approx(0.07), "of 100 calls")


def test_ways_to_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where ONNX is missing a row says what it needs."""
    def missing(_: Any) -> Any:
        raise ImportError("No module named 'onnxruntime'")

    monkeypatch.setattr(latency, "onnx_policy", missing)
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2)
    found = list(latency.latencies(PLATFORM, GoToPose(), settings, 20))
    assert [m.name for m in found] == [
        *(f"{way}, floating-platform, {which}" for way in ("torch, eager", "NumPy")
          for which in ("median", "99th percentile")), "ONNX, floating-platform"]
    assert [m.value is None for m in found] == [False] * 4 + [True]
    assert found[-1].note == "needs a package: No module named 'onnxruntime'"
