"""How fast the engine and the trainer are, beside what the memory of the same machine can move."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from rans.fast.config import PPOSettings
from rans.fast.engine import Engine
from rans.fast.graph import graphed
from rans.fast.presets import preset
from rans.fast.trainer import make_ppo
from rans.spacecraft import Spacecraft
from rans.tasks import Task

_REPEATS = 7
_REPEAT_SECONDS = 0.3
"""Each figure is the median of so many repeats of about so much wall time, after warm-up."""


@dataclass(frozen=True)
class Measurement:
    """One figure of merit."""

    name: str
    """What was measured."""
    value: float
    """Median over the repeats."""
    unit: str
    """Of the value."""
    warm_up: float
    """Seconds of compiling and first calls, not part of the value."""
    note: str = ""
    """What it should be compared with."""


def measurements(craft: Spacecraft, task_name: str, task: Task, device: str, sizes: list[int],
                 ) -> Iterator[Measurement]:
    """Copy bandwidth, then environment steps per second at each size, then trained steps per second."""
    bandwidth = copy_bandwidth(device)
    yield bandwidth
    for num_envs in sizes:
        yield engine_rate(craft, task, num_envs, device, bandwidth.value)
    yield trainer_rate(craft, task, preset(task_name, craft.dimension, device), device)


def copy_bandwidth(device: str) -> Measurement:
    """Bytes read plus bytes written per second by a copy far larger than any cache."""
    count = (2**30 if device.startswith("cuda") else 2**27) // 4
    source = torch.ones(count, device=device)
    target = torch.empty_like(source)
    seconds, warm_up = _time(lambda: target.copy_(source), device)
    return Measurement("memory copy", 8 * count / seconds / 1e9, "GB/s", warm_up)


def engine_rate(craft: Spacecraft, task: Task, num_envs: int, device: str, bandwidth: float) -> Measurement:
    """Environment steps per second: dynamics, reward terms, ends, both observations, reset.

    The action is random but the same in every step: how it is chosen is not the engine's business.
    """
    engine = Engine(craft, task, num_envs, device=device, compiled=True)
    thrusters = len(craft.thrusters)
    action = (torch.rand(num_envs, thrusters, device=device) < 0.3).to(torch.uint8)
    step = graphed(lambda: engine.step(action).reward, torch.device(device))
    seconds, warm_up = _time(step, device)
    moved = step_bytes(engine, action)
    share = moved * num_envs / seconds / (bandwidth * 1e9)
    note = f"{moved} bytes a step, {share:.0%} of the copy bandwidth"
    return Measurement(f"{craft.name}, {num_envs:,} environments", num_envs / seconds / 1e6, "M steps/s",
                       warm_up, note)


def step_bytes(engine: Engine, action: Tensor) -> int:
    """Bytes that one environment's step must read and write.

    State, goal and counters move both ways, the action in, the results out.
    """
    count = engine.num_envs
    kept = sum(buffer.nbytes for buffer in engine.save_state()["buffers"])
    results = sum(tensor.nbytes for tensor in engine.step(action))
    return (2 * kept + action.nbytes + results) // count


def trainer_rate(craft: Spacecraft, task: Task, settings: PPOSettings, device: str) -> Measurement:
    """Environment steps per second of PPO: flown, and learned from in every epoch."""
    engine = Engine(craft, task, settings.n_envs, device=device)
    model = make_ppo(engine, settings, seed=0)
    model.start()
    rollout = settings.n_envs * settings.n_steps

    def iteration() -> None:
        model.collect()
        model.update()

    seconds, warm_up = _time(iteration, device)
    layers = "x".join(str(units) for units in settings.layers)
    note = f"{settings.n_envs:,} environments x {settings.n_steps} steps, network {layers}"
    return Measurement(f"PPO, {craft.name}", rollout / seconds / 1e6, "M steps/s", warm_up, note)


def _time(function: Callable[[], object], device: str) -> tuple[float, float]:
    """Median seconds of one call, and seconds of warm-up."""
    begun = time.perf_counter()
    for _ in range(5):
        function()
    _wait(device)
    warm_up = time.perf_counter() - begun
    calls = _calls(function, device)
    return statistics.median(_seconds(function, calls, device) for _ in range(_REPEATS)), warm_up


def _calls(function: Callable[[], object], device: str) -> int:
    """Calls that fill one repeat."""
    return max(1, round(_REPEAT_SECONDS / _seconds(function, 3, device)))


def _seconds(function: Callable[[], object], calls: int, device: str) -> float:
    begun = time.perf_counter()
    for _ in range(calls):
        function()
    _wait(device)
    return (time.perf_counter() - begun) / calls


def _wait(device: str) -> None:
    if device.startswith("cuda"):
        torch.cuda.synchronize()
