from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans.evaluation.fly.agent import Agent
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.start import begin
from rans.tasks import GoToPose
from tests.fast.engines import PLATFORM, both_crafts
from tests.fast.test_policy import seen
from tests.fast.training import scatter
from validation.speed.latency import numpy_policy, onnx_policy


@pytest.mark.parametrize("activation", ["tanh", "elu", "relu"])
@both_crafts
def test_numpy_answers_as_torch_does(craft: Any, activation: Any) -> None:
    settings = PPOSettings(n_envs=1, n_steps=2, batch_size=2, layers=(16, 24), activation=activation)
    policy = scatter(begin(Engine(craft, GoToPose(), 1), [settings], [0]).network)
    policy.update_statistics(policy.look(seen(craft, 500))[0][None])
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
