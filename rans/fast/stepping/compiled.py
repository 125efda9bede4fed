"""The step of an engine on a CPU as a straight-line program: for few spacecraft four times as fast as equations.

Equations on NumPy's arrays compute common expressions again for each formula and allocate memory for every result,
which takes most of the time of a step of a hundred spacecraft.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import Tensor

from rans.base.errors import RansWarning
from rans.compile.step_program import trace_step
from rans.episode.step import Episode, World
from rans.fast.machine_code import GeneratedStep, machine_code
from rans.fast.stepping.step import Backend, Step, step_arrays, step_tensors
from rans.model.random import Draws
from rans.model.trace import UNTRACEABLE
from rans.randomization.faults import sets_among

_MOST = 600
"""Largest number of an episode's values for which a program is generated. 538 values, with 40 delayed commands of
8 thrusters, take 9 s and 300 MB; 3,000, as at 1 kHz with valves that are 0.2 s late, took minutes and 14 GB."""


def generated_step(
    device: str, world: World, episode: Episode, draws: Draws
) -> GeneratedStep | None:
    """Machine code of an engine's step; None: no package writes any for a device or, with a warning, this step."""
    if (code := machine_code(device)) is None:
        return None
    try:
        return code.step(trace_step(world, episode, draws.dtype), draws)
    except UNTRACEABLE as error:
        reason = f"its task does more than arithmetic on fields: {error}"
    except OSError as error:  # of a GPU's compiler or driver
        reason = str(error)
    warnings.warn(f"this engine steps slower, as {reason}", RansWarning, stacklevel=3)
    return None


class ArrayStep:
    """Step of the episodes of one engine on NumPy's arrays, which are changed in place.

    The first call traces the program, in 0.02 s in the plane, 0.3 s under conditions in space, and many seconds for
    a craft of many substeps, such as a CubeSat under `lab`. The equations are used instead without machine code, in
    double precision, for tasks that do more than arithmetic on fields, and for episodes with more than `_MOST`
    values.
    """

    def __init__(self) -> None:
        self._generated: GeneratedStep | None = None
        self._tried = False

    def __reduce__(self) -> tuple[type[ArrayStep], tuple[()]]:
        """A copy generates a program of its own, for other episodes."""
        return ArrayStep, ()

    def __call__(self, world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
        """Step actions (N, n) as `step_arrays`; the first call traces the program, or warns once."""
        small = len(episode.memory()) <= _MOST
        by_values = getattr(world.setup.guard, "by_values", False)
        can_trace = draws.dtype is np.float32 and small and not by_values
        if not self._tried and can_trace:
            self._generated = generated_step("cpu", world, episode, draws)
        self._tried = True
        return (
            self._generated(action)
            if self._generated
            else step_arrays(world, episode, action, draws)
        )


class TorchCompiledStep:
    """A step on tensors that torch compiles; where it cannot, the step runs eagerly, with a warning."""

    def __init__(self) -> None:
        # The compiler cannot trace linear programs, whose result is the same in every step.
        torch.compiler.assume_constant_result(sets_among)
        self._step = torch.compile(step_tensors, fullgraph=True, dynamic=False)

    def __call__(self, world: World, episode: Episode, action: Tensor, draws: Draws) -> Step:
        """Step actions (N, n) as `step_tensors`; what torch cannot compile is stepped as written from then on."""
        from torch._dynamo.exc import Unsupported  # the import takes seconds

        try:
            return self._step(world, episode, action, draws)
        except Unsupported as error:  # while it is traced, before anything has changed
            reason = str(error).partition("\n")[0]
            warnings.warn(
                "this engine steps slower, as torch cannot compile what its task does: "
                f"{reason.lower()}. Use functions of rans.model.fields, or do not compile.",
                RansWarning,
                stacklevel=2,
            )
            self._step = step_tensors
            return step_tensors(world, episode, action, draws)


def stepping(
    backend: Backend, compiled: bool, plain: bool
) -> Callable[[World, Episode, Tensor, Draws], Step]:
    """Function that steps one engine's episodes; all of them agree to rounding (`tests/fast/stepping`)."""
    if plain:
        return partial(step_tensors, plain=True)
    if compiled:
        return TorchCompiledStep()
    return ArrayStep() if backend.on_numpy else step_tensors
