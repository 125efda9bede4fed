"""Controllers that know which thrusters are dead from the start, and allocate without them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from rans.flight import Controller
from rans.model.spacecraft import Spacecraft, is_steerable
from rans.randomization.conditions import Conditions


class MemoryController(Controller, Protocol):
    """A controller whose memory of episodes can be read and replaced."""

    def memory(self) -> np.ndarray:
        """What is remembered of every episode, (N, ...)."""
        ...

    def recall(self, memory: np.ndarray) -> None:
        """Go on from a `memory`."""


class WithoutDead:
    """A controller of a craft whose dead thrusters stay shut; made by `expecting_dead`.

    Args:
        nominal: the controller that expects all thrusters to work.
        remaining: one of the same kind and settings, for the craft without its dead thrusters.
        alive: numbers of the thrusters and further effectors that ``remaining`` commands.
        craft: with all its thrusters.
    """

    def __init__(
        self, nominal: Any, remaining: MemoryController, alive: np.ndarray, craft: Spacecraft
    ) -> None:
        self.name = nominal.name
        self.slow = getattr(nominal, "slow", False)
        self.observes = nominal.observes
        self.heeds_constraints = nominal.heeds_constraints
        self.craft = craft
        self._nominal = nominal
        self._remaining = remaining
        self._alive = alive

    def __repr__(self) -> str:
        dead = sorted({*range(self.craft.command_count)} - {*self._alive.tolist()})
        return f"{self._remaining!r} without thrusters {', '.join(map(str, dead))}"

    def expecting(self, conditions: Conditions | None) -> Controller:
        """The controller that knows the dead thrusters of other conditions."""
        return self._nominal.expecting(conditions)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._remaining.reset(count)

    def memory(self) -> np.ndarray:
        """What is remembered of every episode, (N, ...); `recall` takes it back, of any episodes."""
        return self._remaining.memory()

    def recall(self, memory: np.ndarray) -> None:
        """Go on from a `memory`, of as many episodes as it has."""
        self._remaining.recall(memory)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; dead thrusters have command 0."""
        commands = self._remaining.act(state, goal, observation)
        everything = np.zeros((len(commands), self.craft.command_count))
        everything[:, self._alive] = commands
        return everything


def expecting_dead(
    nominal: Any, conditions: Conditions | None, make: Callable[[Spacecraft], MemoryController]
) -> Controller:
    """A controller that knows the thrusters that are dead from the start in every episode of some conditions.

    Where the others cannot push and turn the craft in every direction, the nominal controller flies on.

    Args:
        nominal: a controller that expects all thrusters to work.
        conditions: of its flights; None: nominal ones.
        make: makes a controller of the same kind and settings for another craft.
    """
    craft = nominal.craft
    dead = () if conditions is None else conditions.dead
    left = [k for k in range(craft.thruster_count) if k not in dead]
    if not dead or not left:
        return nominal
    with warnings.catch_warnings(action="ignore"):  # of a craft that cannot be steered
        reduced = replace(craft, thrusters=tuple(craft.thrusters[k] for k in left))
    if not is_steerable(reduced):
        return nominal
    others = range(craft.thruster_count, craft.command_count)
    with warnings.catch_warnings(
        action="ignore"
    ):  # the nominal controller has warned of constraints
        remaining = make(reduced)
    return WithoutDead(nominal, remaining, np.array([*left, *others]), craft)
