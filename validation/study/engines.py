"""The engine that trains agents, on every path it can take, against the equations it should compute."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.fast.engine import Engine
from rans.fast.learn.graph import graphed
from rans.model.fields import leaves, unflatten
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from validation.study.checks import Check, Curve, Skipped
from validation.study.sampling import ENDLESS, Restless, any_spin, gap_checks, growth, reach

_TIMING = Timing()
_LONGER = Timing(episode_steps=_TIMING.episode_steps + 1)
"""No flight is started anew when its time is up."""


def engine_checks(craft: Spacecraft, seed: int, count: int) -> Sequence[Check | Curve]:
    """Eager paths over 25 s: NumPy and torch in float64, and float32, in which agents train."""
    starts = scenarios(ENDLESS, craft, seed, count)
    with any_spin():
        flight = fly(craft, ENDLESS, Restless(craft, seed), starts, _TIMING)
    numpy = _fly_engine(_engine(craft, seed, count, torch.float64), flight.commands)
    with torch.compiler.set_stance("force_eager"):
        eager = _fly_engine(
            _engine(craft, seed, count, torch.float64, compiled=True), flight.commands
        )
    single = _fly_engine(_engine(craft, seed, count, torch.float32), flight.commands)
    size = reach(flight.states)
    rounding = "The same equations: float64 rounding (1e-16) over 125 periods."
    training = (
        "float32 rounding (1e-7) over 125 periods, and its four quadrature nodes in the plane."
    )
    return [
        *gap_checks("engine, NumPy float64", numpy, flight.states, 1e-11 * size, rounding),
        *gap_checks("engine, torch float64", eager, flight.states, 1e-11 * size, rounding),
        *gap_checks("engine, float32", single, flight.states, 1e-3 * size, training),
        *growth("float32 against float64", single, flight.states, _TIMING),
    ]


def compiled_checks(craft: Spacecraft, seed: int, count: int) -> Sequence[Check | Skipped]:
    """The step as one compiled kernel, against the same step on NumPy."""
    name = "engine, compiled float64"
    if not any(map(shutil.which, ("c++", "g++", "clang++"))):
        return [
            Skipped(name, "torch.compile needs a C++ compiler, and there is none on this machine.")
        ]
    commands = _commands(craft, seed, count)
    compiled = _fly_engine(_engine(craft, seed, count, torch.float64, compiled=True), commands)
    eager = _fly_engine(_engine(craft, seed, count, torch.float64), commands)
    return gap_checks(
        name,
        compiled,
        eager,
        1e-11 * reach(eager),
        "The same arithmetic in another order: float64 rounding over 125 periods.",
    )


def graph_checks(craft: Spacecraft, seed: int, count: int) -> Sequence[Check | Skipped]:
    """The step compiled for a GPU and replayed from a CUDA graph, as the trainer runs it."""
    name = "engine, CUDA graph"
    if not torch.cuda.is_available():
        return [Skipped(name, "There is no CUDA device on this machine.")]
    commands = _commands(craft, seed, count)
    checks = []
    eager = _fly_engine(_engine(craft, seed, count, torch.float64), commands)
    for dtype, tolerance in ((torch.float64, 1e-11), (torch.float32, 1e-3)):
        engine = _engine(craft, seed, count, dtype, device="cuda")
        flown = _fly_engine(engine, commands, graph=True)
        checks += gap_checks(
            f"{name} {str(dtype).removeprefix('torch.')}",
            flown,
            eager,
            tolerance * reach(eager),
            "Rounding over 125 periods; see the eager paths.",
        )
    return checks


def _commands(craft: Spacecraft, seed: int, count: int) -> np.ndarray:
    starts = scenarios(ENDLESS, craft, seed, count)
    with any_spin():
        return fly(craft, ENDLESS, Restless(craft, seed), starts, _TIMING).commands


def _engine(
    craft: Spacecraft,
    seed: int,
    count: int,
    dtype: torch.dtype,
    device: str = "cpu",
    compiled: bool | None = None,
) -> Engine:
    return Engine(
        craft, ENDLESS, count, _LONGER, seed=seed, device=device, dtype=dtype, compiled=compiled
    )


def _fly_engine(engine: Engine, commands: np.ndarray, graph: bool = False) -> Any:
    """The engine's states with float64 fields (T + 1, N) under commands (T, N, thrusters)."""
    dtype = torch.float64 if engine.craft.is_continuous else torch.uint8
    action = torch.zeros(commands.shape[1:], dtype=dtype, device=engine.device)
    step: Callable[[], Any] = lambda: engine.step(action).reward  # noqa: E731
    step = graphed(step, engine.device) if graph else step
    states = [_copy(engine.state)]
    for command in commands:
        action.copy_(torch.from_numpy(command))
        step()
        states.append(_copy(engine.state))
    return unflatten(engine.state, np.moveaxis(np.array(states), 1, 0))


def _copy(state: Any) -> list[np.ndarray]:
    return [torch.as_tensor(x).cpu().numpy().astype(np.float64) for x in leaves(state)]
