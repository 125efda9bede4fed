"""Environment steps per second and memory of the engine, beside what the machine's memory can move."""

from __future__ import annotations

import torch
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.graph import graphed
from rans.fast.stepping.step import Step
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions
from rans.tasks import Task
from validation.speed.measurement import Clock, Measurement
from validation.speed.roofline import step_work

MEMORY_TARGET = 250.0
"""Bytes an environment, of 3DoF simulation."""
_OPEN_SHARE = 0.3
"""Of the thrusters, at random in every step: a policy that has learnt nothing."""
_STEPS = 64
"""With commands of their own, which come again after them. Fewer would be a push that lasts, and more
spacecraft would spin or fly away than do under random commands."""


def copy_bandwidth(clock: Clock) -> Measurement:
    """Bytes read plus bytes written per second by a copy far larger than any cache."""
    count = (2**30 if clock.on_gpu else 2**27) // 4
    source = torch.ones(count, device=clock.device)
    target = torch.empty_like(source)
    seconds, warm_up = clock.time(lambda: target.copy_(source))
    return Measurement("memory", "memory copy", 8 * count / seconds / 1e9, "GB/s", warm_up)


def engine_rate(
    craft: Spacecraft,
    task: Task,
    num_envs: int,
    clock: Clock,
    bandwidth: float | None = None,
    compiled: bool | None = True,
    generated: bool = True,
    conditions: Conditions | None = None,
) -> Measurement:
    """Environment steps per second: dynamics, reward terms, ends, both observations, reset.

    Args:
        craft: what flies.
        task: where to.
        num_envs: spacecraft stepped together.
        clock: times it on its device.
        bandwidth: of `copy_bandwidth`, GB/s: no more steps' bytes can be moved in a second.
        compiled: see `Engine`.
        generated: see `Engine`.
        conditions: see `Engine`.
    """
    engine = Engine(
        craft,
        task,
        num_envs,
        device=clock.device,
        compiled=compiled,
        generated=generated,
        conditions=conditions,
    )
    engine.stagger()  # as in training: in every step some episodes end
    actions = _actions(engine, _STEPS)
    seconds, warm_up = clock.time(
        graphed(lambda: _last(engine, actions).reward, torch.device(clock.device))
    )
    moved = step_work(engine).bytes_moved
    note = f"{moved} bytes a step must move; {_ends(engine, actions)}"
    note += "" if engine.compiled else "; not compiled"
    bound = None if bandwidth is None else 1e3 * bandwidth / moved
    what = f"{craft.name}, {num_envs:,} environments" + ("" if generated else ", torch.compile")
    return Measurement(
        "engine",
        what,
        _STEPS * num_envs / seconds / 1e6,
        "M steps/s",
        warm_up,
        note,
        bound,
        "what the copy bandwidth allows",
    )


def memory_per_environment(
    craft: Spacecraft, task: Task, num_envs: int, clock: Clock
) -> Measurement:
    """Bytes that one environment takes: what the engine holds, an action, and the results of one step.

    On a GPU it is what torch has allocated; on a CPU, whose allocator does not say, the sum of the arrays.
    """
    before = torch.cuda.memory_allocated() if clock.on_gpu else 0
    engine = Engine(craft, task, num_envs, device=clock.device)
    action = _actions(engine, 1)[0]
    results = engine.step(action)
    if clock.on_gpu:
        held = torch.cuda.memory_allocated() - before
        how = "allocated by torch"
    else:
        arrays = (*engine.save_state()["buffers"], engine._draws.first, action, *results)
        held = sum(array.nbytes for array in arrays)
        how = "sum of all arrays"
    target = MEMORY_TARGET if craft.dimension == 2 else None
    return Measurement(
        "memory",
        f"{craft.name}, one environment",
        held / num_envs,
        "bytes",
        note=f"{how} of {num_envs:,} environments",
        bound=target,
        bound_name="" if target is None else f"the {target:.0f} bytes aimed at",
    )


def _last(engine: Engine, actions: list[Tensor]) -> Step:
    """The last of several steps; nothing holds the others."""
    for action in actions[:-1]:
        engine.step(action)
    return engine.step(actions[-1])


def _ends(engine: Engine, actions: list[Tensor]) -> str:
    """How many episodes end in a step: they cost more than others."""
    ended = 0.0
    for action in actions:  # one after the other, so that only one step's results are held
        step = engine.step(action)
        ended += float((step.terminated | step.truncated).double().mean()) / len(actions)
    return f"one episode in {1 / ended:.0f} ends in it" if ended else "no episode ends"


def _actions(engine: Engine, count: int) -> list[Tensor]:
    shape = engine.num_envs, len(engine.craft.thrusters)
    return [
        (torch.rand(shape, device=engine.device) < _OPEN_SHARE).to(torch.uint8)
        for _ in range(count)
    ]
