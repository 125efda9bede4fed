"""Capabilities of an executor of policies; what it cannot compute is left to torch's forward pass."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from rans.policy.architecture import Architecture


class Capabilities(NamedTuple):
    """Kinds of policies that an executor computes rightly; those that are not stated it refuses."""

    backbones: tuple[str, ...] = ("dense",)
    heads: tuple[str, ...] | None = None
    """None: any, by its formula."""
    activations: tuple[str, ...] | None = None
    """None: any, by its formula."""
    memory: bool = True
    """Histories, averages and filters."""
    privileged_critic: bool = True
    """Executors of commands alone need no critic."""

    def missing(self, architecture: Architecture) -> str:
        """Parts of a policy that the executor cannot compute, in words; "" if it can compute all."""
        return " and ".join(self._missing(architecture))

    def _missing(self, architecture: Architecture) -> Iterator[str]:
        """Names of the parts of an architecture that this executor lacks."""
        if architecture.backbone not in self.backbones:
            yield f"the backbone {architecture.backbone!r}"
        if self.heads is not None and architecture.head not in self.heads:
            yield f"the head {architecture.head!r}"
        if self.activations is not None and architecture.activation not in self.activations:
            yield f"the activation {architecture.activation!r}"
        if architecture.memory and not self.memory:
            yield "a memory"
        if architecture.privileged and not self.privileged_critic:
            yield "a critic that is given privileged observations"
