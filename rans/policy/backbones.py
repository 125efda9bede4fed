"""Backbones: what a network is given of an observation, and how features become the outputs for its commands.

Every policy has a trunk of dense layers, which make features of what is observed and remembered. A backbone is one
object, by its name in `rans.policy.backbone_registry.BACKBONES` (entry point ``rans.backbones``). It writes a
program, which torch computes (`rans.policy.torch_program`) and files have. Executors that do not state it
(`rans.policy.capabilities`) leave such a policy to torch.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple, Protocol

from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.architecture import Architecture, Backbone
from rans.policy.backbone_registry import BACKBONES
from rans.policy.network import Network
from rans.policy.program import Program
from rans.tasks.observation_terms import Layout


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
    teacher: Callable[..., Network]
    """Network to imitate: of a network, its agent's text, an engine with the craft, and an architecture."""
    imitate: Callable[..., int]
    """Bring a network to the commands of a teacher; control periods that each environment flew, 0 if stopped."""


class AnyCraftBackbone(Backbone):
    """A backbone whose networks fly any craft."""

    @property
    @abstractmethod
    def any_craft(self) -> AnyCraft:
        """What is done with such networks."""


@cache
def any_craft() -> AnyCraft:
    """What an installed backbone offers, whose networks fly any craft."""
    return next(one.any_craft for _, one in BACKBONES.each() if isinstance(one, AnyCraftBackbone))


class Dense(Backbone):
    """The last layer on the features."""

    def rows(self, architecture: Architecture) -> int:
        """See `Backbone`."""
        return architecture.last.weights * architecture.thrusters

    def traced(self, program: Program, architecture: Architecture, features: str) -> str:
        """See `Backbone`."""
        return program.dense(features, "head", architecture.outputs, architecture.features)


DENSE = Dense()
