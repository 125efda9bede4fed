"""Backbones: how what a policy has made of an observation becomes the outputs for its commands.

Every policy has a trunk of dense layers, which make features of what is observed and remembered. A backbone is one
class that makes the commands' outputs of them, and its name in `rans.policy.backbone_registry.BACKBONES`. It
writes a program, which torch computes (`rans.policy.torch_program`) and files have. Executors that do not state it
(`rans.policy.capabilities`) leave such a policy to torch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from torch import Tensor

from rans.policy.heads import Patterns
from rans.policy.program import Program

if TYPE_CHECKING:
    from rans.policy.architecture import Architecture
    from rans.policy.network import Network


class Backbone(ABC):
    """Makes outputs for commands of features."""

    token_widths: tuple[int, ...] = ()
    """Possible numbers of a token of `Architecture.tokens`; empty: it is not given the effectors of the craft."""

    @abstractmethod
    def rows(self, architecture: Architecture) -> int:
        """Rows of the last layer, whose weights are ``action_net``."""

    def tables(self, architecture: Architecture, like: Tensor) -> tuple[Tensor, ...]:
        """Constants of `patterns`, of the device and precision of ``like``; () if outputs decide.

        A network makes them once, since neither a compiler nor a CUDA graph may: see `Network.tables`.
        """
        return ()

    def patterns(self, network: Network, features: Tensor) -> Patterns | None:
        """Distribution for features (..., N, features) if on/off thrusters open together; None: by the outputs."""
        return None

    @abstractmethod
    def traced(self, program: Program, architecture: Architecture, features: str) -> str:
        """Write outputs for commands into a program: a row (N, outputs n) of a row of features (N, features).

        See `rans.policy.heads.Head`. Torch computes that program (`rans.policy.torch_program`).

        The last layer's parameters are those of "head", after `rans.policy.heads.Head.folded`.
        """


class Dense(Backbone):
    """The last layer on the features."""

    def rows(self, architecture: Architecture) -> int:
        """See `Backbone`."""
        return architecture.last.weights * architecture.thrusters

    def traced(self, program: Program, architecture: Architecture, features: str) -> str:
        """See `Backbone`."""
        return program.dense(features, "head", architecture.outputs, architecture.features)
