"""Backbones: what a network is given of an observation, and how features become the outputs for its commands.

Every policy has a trunk of dense layers, which make features of what is observed and remembered. A backbone is one
object, by its name in `rans.policy.backbone_registry.BACKBONES` (entry point ``rans.backbones``). It writes a
program, which torch computes (`rans.policy.torch_program`) and files have. Executors that do not state it
(`rans.policy.capabilities`) leave such a policy to torch.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple, Protocol

from torch import Tensor

from rans.base.errors import brief
from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.heads import Patterns
from rans.policy.program import Program
from rans.tasks.observation_terms import Columns, Layout

if TYPE_CHECKING:
    from rans.fast.engine import Engine
    from rans.policy.adaptation import Adaptation
    from rans.policy.architecture import Architecture
    from rans.policy.network import Network

Tokens = tuple[tuple[float, ...], ...]
"""What each effector of a craft is, by the numbers that a backbone needs."""


class Prospect(Protocol):
    """What decides whether a craft holds a pose."""

    @property
    def reason(self) -> str:
        """Why flights will not settle, for a sentence; "" if all are expected to."""
        ...

    def text(self, period: float) -> str:
        """The numbers, for a user."""
        ...


class AnyCraft(NamedTuple):
    """Functions of a backbone whose networks fly any craft: weights stay, constants change."""

    for_craft: Callable[[Network, Spacecraft, float], Network]
    """Policy for a craft and a control period (s); `ConfigError` where it cannot fly that."""
    frugal: Callable[[Network, float, float, float, tuple[float, float]], Network]
    """Policy at a frugality from 0 (fast) to 1, for a mean distance of the starts (m), a length of flights (s), and
    tolerances of position (m) and attitude (rad)."""
    observes: Callable[[Layout], bool]
    """Whether observations of a layout have what it needs."""
    timing: Callable[[Spacecraft, Timing, float | None], Timing]
    """Timing for a craft, by the usual one, at a control period (s); None: chosen for the craft."""
    periods: tuple[float, ...]
    """Control periods of craft in space, s, short to long."""
    prospect: Callable[[Spacecraft, float], Prospect]
    """What decides whether a craft that is commanded at a period (s) holds a pose."""
    spared: Callable[[Spacecraft, float], str]
    """Which thrusters a craft can lose, commanded at a period (s), in a sentence; "" if it is not known."""
    slips: Callable[[Spacecraft], Iterator[str]]
    """Questions about thrusters that a file may have wrong."""
    teacher: Callable[[Network, str, Engine, Architecture], Network]
    """Network for the craft of an engine that one of an architecture imitates, of an agent by its text."""
    imitate: Callable[..., int]
    """Bring a network to the commands of a teacher; control periods that each environment flew, 0 if stopped."""


class Backbone(ABC):
    """Makes outputs for commands of features."""

    @property
    def any_craft(self) -> AnyCraft | None:
        """For networks that fly any craft; None: they fly the one of their training."""
        return None

    def tokens(self, craft: Spacecraft, period: float) -> Tokens:
        """`Architecture.tokens` of a network that learns for a craft; () if it is not given its effectors.

        Raises:
            ConfigError: it cannot command the craft.
        """
        return ()

    def check(self, architecture: Architecture) -> None:
        """Refuse (`ValueError`) numbers of an agent's file that no such network has."""
        of_others = (
            architecture.tokens,
            architecture.authority,
            architecture.frugal,
            architecture.reach,
            architecture.filling,
        )
        if any(of_others) or architecture.adapts:
            raise ValueError(
                f"it has numbers that its backbone {brief(architecture.backbone)} lacks"
            )

    def columns(self, architecture: Architecture) -> Layout:
        """Layout of the columns that the network is given."""
        return architecture.layout.body

    def preprocessed(self, architecture: Architecture, observation: Columns) -> list[Field]:
        """Columns of a reading, which are all of an observation's in B for a network that adapts."""
        return architecture.layout.in_body(observation)

    def known(self, architecture: Architecture, columns: Columns) -> dict[str, list[Field]]:
        """Rows beside features that outputs need, by their names in a program, of the columns of the network."""
        return {}

    def adaptation(self, architecture: Architecture) -> Adaptation:
        """Estimator of a network that adapts; `check` refuses others."""
        raise NotImplementedError

    def adapted(
        self, architecture: Architecture, read: Columns, gains: Columns, lost: Field
    ) -> list[Field]:
        """Columns of a network that adapts; `check` refuses others.

        Args:
            architecture: of the network.
            read: columns of a reading.
            gains: of velocities and of angular velocities, over those of the file (`rans.policy.adaptation`).
            lost: 1 if a thruster is taken for lost, else 0.
        """
        raise NotImplementedError

    def for_faults(self, architecture: Architecture) -> Architecture:
        """The architecture with which the network flies where thrusters fail."""
        return architecture

    def choices(self, architecture: Architecture) -> int:
        """Number of ways to open thrusters together of which outputs choose one; 0: each command by itself."""
        return 0

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


DENSE = Dense()
