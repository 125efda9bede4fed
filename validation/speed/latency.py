"""How long an agent on board takes to answer one observation, with and without torch.

Everything runs on one CPU thread. The weights are those before training: whatever they are, arithmetic takes
as long.
"""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import cast

import numpy as np
import torch
from torch import nn

from rans.evaluation.fly.agent import Agent
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.member import begin
from rans.fast.learn.network import Network
from rans.fast.learn.selection import likeliest
from rans.fast.symmetry import Symmetries
from rans.model.spacecraft import Spacecraft
from rans.tasks import Task
from validation.speed.measurement import Measurement, one_thread

Policy = Callable[[np.ndarray], np.ndarray]
"""Commands (N, thrusters) for observations (N, width), float32."""

_ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
}


def latencies(craft: Spacecraft, task: Task, settings: PPOSettings, calls: int) -> Iterator[Measurement]:
    """Median and 99th percentile over so many single observations, in microseconds, by way to run it.

    Args:
        craft: whose thrusters are commanded.
        task: what is observed.
        settings: give the network.
        calls: so many observations.
    """
    engine = Engine(craft, task, 1)
    policy = begin(engine, [replace(settings, n_envs=1, n_steps=2, batch_size=2)], [0]).network
    observation, agent = engine.observe().numpy().copy(), Agent(policy, "")
    ways = {"torch, eager": lambda x: agent.act(None, None, x), "NumPy": numpy_policy(policy)}
    for way, act in ways.items():
        yield from _measured(f"{way}, {craft.name}", act, observation, calls)
    try:
        exported = onnx_policy(policy)
    except ImportError as error:
        yield Measurement("policy", f"ONNX, {craft.name}", None, "us", note=f"needs a package: {error}")
    else:
        yield from _measured(f"ONNX, {craft.name}", exported, observation, calls)


def numpy_policy(network: Network) -> Policy:
    """The deterministic on/off agent in NumPy, equal to `rans.evaluation`'s but for rounding."""
    given, table = network.architecture, {name: x.numpy() for name, x in network.member(0).items()}
    mean, zoom = table["features_extractor.mean"], given.zoom
    scale = 1.0 / np.sqrt(table["features_extractor.variance"] + np.float32(1e-6))
    hidden = [name for name in table if ".trunk." in name and name.endswith(".weight")]
    linear = [(table[name].T, table[name.replace("weight", "bias")]) for name in hidden]
    activation = _ACTIVATIONS[given.activation]
    rows, offsets = table["action_net.weight"], table["action_net.bias"]
    weight, bias = (rows[1::2] - rows[0::2]).T, offsets[1::2] - offsets[0::2]
    views = given.symmetries and Symmetries(*(np.asarray(x, dtype=kind) for x, kind in zip(
        given.symmetries, (np.float32, np.float32, np.int64), strict=True)))

    def act(observation: np.ndarray) -> np.ndarray:
        layout, place = given.layout.body, None
        columns = given.layout.in_body(tuple(observation.T))
        if views and (way := layout.ahead(columns)) is not None:
            which = views.which(way)
            columns, place = views.viewed(layout, columns, which), views.place[which]
        seen = np.stack(columns, axis=1)
        x = np.clip((seen - mean) * scale, -given.clip, given.clip)
        x = np.concatenate((x, np.tanh(seen * scale * zoom)), axis=1) if zoom else x
        for matrix, offset in linear:
            x = activation(x @ matrix + offset)
        opened = x @ weight + bias > 0.0
        return (opened if place is None else np.take_along_axis(opened, place, 1)).astype(np.float32)

    return act


def onnx_policy(policy: Network) -> Policy:
    """The deterministic agent in ONNX Runtime, for single observations.

    Raises:
        ImportError: onnxruntime is missing, or what torch needs to write an ONNX network.
    """
    import onnxruntime  # pyright: ignore[reportMissingImports]

    width = policy.architecture.layout.width
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings(action="ignore"):  # of the exporter, about itself
        program = torch.onnx.export(_Deterministic(policy).eval(), (torch.zeros(1, width),), dynamo=True,
                                    verbose=False)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    network = program.model_proto.SerializeToString()  # type: ignore[union-attr]
    session = onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    return lambda observation: cast("np.ndarray", session.run(None, {name: observation})[0])


class _Deterministic(nn.Module):
    def __init__(self, policy: Network) -> None:
        super().__init__()
        self._policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return likeliest(self._policy, observation, None)[0]


def _measured(name: str, policy: Policy, observation: np.ndarray, calls: int) -> Iterator[Measurement]:
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
