"""How long an agent on board takes to answer one observation, with and without torch.

Everything runs on one CPU thread. The weights are those before training: whatever they are, arithmetic takes
as long.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rans.base.errors import ConfigError
from rans.deploy.export import write_agent
from rans.evaluation.fly.agent import Agent
from rans.fast.agent_files.agent import SavedPolicy
from rans.fast.engine import Engine
from rans.fast.learn.beginning import begin
from rans.fast.learn.config import PPOSettings
from rans.fast.threads import one_thread
from rans.model.spacecraft import Spacecraft
from rans.policy.network import Network
from rans.tasks import Task
from validation.speed.exported import ANSWERS
from validation.speed.measurement import Measurement

Policy = Callable[[np.ndarray], np.ndarray]
"""Commands (N, thrusters) for observations (N, width), float32."""


def latencies(
    craft: Spacecraft, task: Task, settings: PPOSettings, calls: int
) -> Iterator[Measurement]:
    """Median and 99th percentile over so many single observations, in microseconds, by way to run it.

    Args:
        craft: whose thrusters are commanded.
        task: what is observed.
        settings: give the network.
        calls: so many observations.
    """
    engine = Engine(craft, task, 1)
    policy = begin(engine, replace(settings, n_envs=1, n_steps=2, batch_size=2), 0).network
    observation = engine.observe().numpy().copy()
    agent = Agent(policy, "")
    ways = {"torch, eager": lambda x: agent.act(None, None, x), "NumPy": exported(policy, "numpy")}
    for way, act in ways.items():
        yield from _measured(f"{way}, {craft.name}", act, observation, calls)
    try:
        act = exported(policy, "onnx")
    except (ConfigError, ImportError) as error:
        yield Measurement(
            "policy", f"ONNX, {craft.name}", None, "us", note=f"needs a package: {error}"
        )
    else:
        yield from _measured(f"ONNX, {craft.name}", act, observation, calls)


def exported(network: Network, form: str) -> Policy:
    """The agent as `rans export` writes it, for observations that nothing is remembered between.

    Raises:
        ConfigError, ImportError: the form needs a package.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_agent(Path(folder), form, SavedPolicy(network, 0), "agent")
        answer = ANSWERS[form](Path(folder))
    nothing = np.zeros((1, 0), np.float32)
    return lambda observation: answer(observation, nothing)[0]


def _measured(
    name: str, policy: Policy, observation: np.ndarray, calls: int
) -> Iterator[Measurement]:
    with one_thread():
        warm_up = sum(_seconds(policy, observation) for _ in range(calls // 10))
        seconds = [_seconds(policy, observation) for _ in range(calls)]
    for which, share in (("median", 50), ("99th percentile", 99)):
        value = 1e6 * float(np.percentile(seconds, share))
        yield Measurement("policy", f"{name}, {which}", value, "us", warm_up, f"of {calls} calls")


def _seconds(policy: Policy, observation: np.ndarray) -> float:
    begun = time.perf_counter()
    policy(observation)
    return time.perf_counter() - begun
