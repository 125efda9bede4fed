"""Machine code of a processor, which an installed package makes (group ``rans.machine_code``).

Without it NumPy and torch compute the same numbers to rounding, and a training takes twice the time of a processor
(docs/decisions/kernels.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from rans.compile.flight_program import FlightProgram
from rans.compile.step_program import StepProgram
from rans.episode import World
from rans.flight_statistics import FlightStatistics
from rans.model.random import Draws
from rans.policy.capabilities import Capabilities
from rans.policy.preprocess import ColumnExecutor, TorchPreprocessor
from rans.registry import Registry

if TYPE_CHECKING:
    from torch import Tensor

    from rans.compile.preprocess import PolicyPrograms
    from rans.fast.learn.adam import Adam
    from rans.fast.learn.config import PPOSettings
    from rans.fast.learn.fused_gradient import GradientBackend
    from rans.fast.stepping.step import Step
    from rans.policy.network import Network


class WholeFlights(Protocol):
    """Flights of one policy in a world, whose programs are compiled."""

    def fly(self, first: int, count: int, seed: int, listed: int) -> FlightStatistics:
        """Statistics of scenarios from the first on; at most ``listed`` failures are listed by number."""
        ...


class MachineCode(NamedTuple):
    """Functions that make what a processor runs often, in single precision."""

    step: Callable[[StepProgram, Draws], Callable[[Tensor], Step]]
    """Step of the episodes that a program was traced from, which it changes in place."""
    preprocessor: Callable[[PolicyPrograms, TorchPreprocessor], ColumnExecutor]
    """Preprocessor of a network, which leaves to torch's what it cannot compute."""
    gradient: Callable[[Network, Adam, PPOSettings, int], GradientBackend | None]
    """Gradients of minibatches of so many samples; None: of other networks than these."""
    flown: Capabilities
    """Kinds of policies that ``flights`` fly."""
    flights: Callable[[World, FlightProgram, Mapping[str, np.ndarray]], WholeFlights]
    """Flights of a policy, from their traced program and the policy's tables (`rans.policy.traced.parameters`)."""


PACKAGES: Registry[Callable[[], MachineCode | None]] = Registry(
    kind="machine code", group="rans.machine_code", built_in={}, checked=lambda make: make
)
"""Functions that give a package's machine code; None where a library is missing that it needs."""


@cache
def machine_code() -> MachineCode | None:
    """Machine code of the first package that can be used here; None: there is none."""
    return next((code for _, make in PACKAGES.each() if (code := make())), None)
