"""Controllers that know which thrusters are dead from the start, and allocate without them."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from rans.episode.flight import Controller
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions
from rans.tasks.base import Task


class ExpectsDead:
    """Base of controllers that can be made for their craft without its dead thrusters.

    A class of them is made of a craft, a task, a timing and its settings.
    """

    _craft: Spacecraft
    _task: Task
    _timing: Timing
    _settings: tuple[Any, ...]

    def expecting(self, conditions: Conditions | None) -> Controller:
        """This controller without the thrusters that are dead from the start in every episode of the conditions.

        Where the others cannot push and turn the craft in every direction, it flies as if none were dead.
        """
        made: Any = type(self)
        nominal: Any = self
        craft = self._craft
        dead = () if conditions is None else conditions.dead
        left = [k for k in range(craft.thruster_count) if k not in dead]
        if not dead or not left:
            return nominal
        # The craft warns that it cannot be steered, and the nominal controller has warned of constraints.
        with warnings.catch_warnings(action="ignore"):
            reduced = replace(craft, thrusters=tuple(craft.thrusters[k] for k in left))
            if not reduced.is_steerable:
                return nominal
            remaining = made(reduced, self._task, self._timing, *self._settings)
        others = range(craft.thruster_count, craft.command_count)
        return _WithoutDead(nominal, remaining, np.array([*left, *others]))


class _WithoutDead:
    """A controller of a craft whose dead thrusters stay shut.

    Args:
        nominal: the controller that expects all thrusters to work.
        remaining: one of the same kind and settings, for the craft without its dead thrusters.
        alive: numbers of the thrusters and further effectors that ``remaining`` commands.
    """

    def __init__(self, nominal: Any, remaining: Controller, alive: np.ndarray) -> None:
        self.name = nominal.name
        self.slow = getattr(nominal, "slow", False)
        self.observes = nominal.observes
        self.heeds_constraints = nominal.heeds_constraints
        self.craft: Spacecraft = nominal.craft
        self.expecting = nominal.expecting
        self.reset = remaining.reset
        self._remaining = remaining
        self._alive = alive

    def __repr__(self) -> str:
        dead = sorted({*range(self.craft.command_count)} - {*self._alive.tolist()})
        return f"{self._remaining!r} without thrusters {', '.join(map(str, dead))}"

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`; dead thrusters have command 0."""
        commands = self._remaining.act(state, goal, observation)
        everything = np.zeros((len(commands), self.craft.command_count))
        everything[:, self._alive] = commands
        return everything
