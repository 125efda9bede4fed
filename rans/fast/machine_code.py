"""Machine code of processors and GPUs, which an installed package makes (group ``rans.machine_code``).

Without it NumPy and torch compute the same numbers to rounding; a training takes twice the time of a processor, and
a GPU steps by what torch compiles (docs/decisions/engine.md).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, Protocol

import torch
from torch import Tensor

from rans.base.registry import Registry
from rans.compile.step_program import StepProgram
from rans.episode.flight_statistics import FlightStatistics
from rans.episode.step import World
from rans.model.random import Draws
from rans.policy.architecture import Architecture
from rans.policy.preprocess import ColumnExecutor, TorchPreprocessor
from rans.policy.symmetry import Symmetries

if TYPE_CHECKING:
    from rans.fast.learn.adam import Adam
    from rans.fast.learn.batch import Batch, Losses, LossInputs
    from rans.fast.stepping.step import Step
    from rans.policy.network import Network

Products = Literal["bf16", "bf16x3", "bf16x6"]
"""Precision of the matrix products of flights on a GPU, by the names of XLA."""


class GeneratedStep(Protocol):
    """Step of the episodes that a program was traced from, which it changes in place."""

    def __call__(self, action: Tensor) -> Step:
        """Hold actions (N, commands) for one control period."""
        ...

    @property
    def observe(self) -> Callable[[], Tensor] | None:
        """Current observation (N, width); None: NumPy computes it as fast."""
        ...


class WholeFlights(Protocol):
    """Flights of one policy in a world, whose programs are compiled."""

    def fly(self, first: int, count: int, seed: int, listed: int) -> FlightStatistics:
        """Statistics of scenarios from the first on; at most ``listed`` failures are listed by number."""
        ...


class GradientBackend(Protocol):
    """Computes gradients of minibatches, written into its `Adam.gradient`."""

    description: ClassVar[str]
    """Description of the computation for the log."""

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of the trunks (N, inputs) from columns (N, k), a history and privileged observations."""
        ...

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, () each, of a minibatch whose memory are the `inputs`."""
        ...


class MachineCode(NamedTuple):
    """Functions that make what one kind of device runs often.

    They raise OSError where a compiler or driver is missing or refuses, and the errors of
    `rans.model.trace.UNTRACEABLE` where tasks or policies cannot be compiled.
    """

    step: Callable[[StepProgram, Draws], GeneratedStep]
    """Step of the episodes that a program was traced from."""
    preprocessor: Callable[[Architecture, TorchPreprocessor, Tensor], ColumnExecutor]
    """Preprocessor of a network whose tensors have the device and dtype of one; it leaves to torch's what it cannot
    compute."""
    gradient: Callable[[Network, Adam, Callable[[LossInputs], Losses], int], GradientBackend | None]
    """Gradients of a loss over minibatches of so many samples; None: of other networks than these."""
    flights: Callable[[World, Network, torch.device, Products], WholeFlights]
    """Flights of a policy in float32."""


PACKAGES: Registry[Callable[[str], MachineCode | None]] = Registry(
    "machine code", "rans.machine_code"
)
"""Functions that give a package's machine code for a type of torch's devices; None where it has none, or where a
library is missing that it needs."""


@cache
def machine_code(device: str) -> MachineCode | None:
    """Machine code of the first package that has any for devices of a type, such as "cpu"; None: there is none."""
    return next((code for _, make in PACKAGES.each() if (code := make(device))), None)


def compiled_preprocessor(
    architecture: Architecture, views: Symmetries | None, like: Tensor
) -> ColumnExecutor:
    """Fastest preprocessor for a network whose tensors have the device and dtype of ``like``.

    Its columns are (N, width); all executors see the same numbers to rounding.
    """
    plain = TorchPreprocessor(architecture, views)
    code = machine_code(like.device.type)
    return code.preprocessor(architecture, plain, like) if code else plain
