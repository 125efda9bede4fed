"""Flights and environments in Drake: the same controllers from the same starts, moved by the judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.environment import Environment
from rans.episode import Influences, Mover
from rans.flight import Controller, Flight, fly
from rans.model.body import Body
from rans.model.conditions import Conditions
from rans.model.drift import FREE, Drift
from rans.model.dynamics import State
from rans.model.fields import leaves, unflatten
from rans.model.random import Draws
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.plant import Plant
from rans.scenario import Scenario
from rans.tasks.base import Task


def fly_in_drake(craft: Spacecraft, task: Task, controller: Controller, starts: Scenario,
                 timing: Timing, body: Body | None = None, conditions: Conditions | None = None,
                 draws: Draws | None = None) -> Flight:
    """As `rans.flight.fly`, moved by Drake; substeps do not concern it."""
    plant = Plant(craft, len(leaves(starts.start)[0]), body=body, drift=task.drift)
    return fly(craft, task, controller, starts, timing, "drake", mover(plant, timing), body, conditions,
               draws)


def mover(plant: Plant, timing: Timing) -> Mover:
    """Drake as what moves the spacecraft of an episode."""
    def move(state: Any, influences: Influences) -> Any:
        rows, commands = rows_from_states(state), np.stack(influences.commands[0], axis=-1)
        moved = plant.advance(np.atleast_2d(rows), np.atleast_2d(commands), timing.control_period)
        return states_from_rows(moved.reshape(rows.shape), state).normalised()

    return move


class DrakeEnv(Environment):
    """`Environment` whose motion an independent judge computes.

    Made by ``gymnasium.make("rans/GoToPose2D-Drake-v0")``. It flies the same episodes as
    `rans.fast.SpacecraftEnv`, observes, rewards and ends them in the same way, and needs about a
    millisecond a step. Its motion is as accurate as `Plant` is: ``timing.substeps`` does not concern it.

    Raises:
        ConfigError: see `Environment`; or Drake refuses the spacecraft's mass properties.
    """

    def _mover(self) -> Mover:
        return mover(Plant(self.craft, drift=self.task.drift), self.timing)


def replay(craft: Spacecraft, start: State, commands: np.ndarray, timing: Timing,
           drift: Drift = FREE) -> Any:
    """Where commands (T, thrusters), each held for one control period, take one spacecraft in Drake.

    The start is of floats, the result of fields (T + 1,), the start first. Headings are not wrapped.
    """
    starts = np.array([leaves(start)], dtype=np.float64)
    rows = Plant(craft, drift=drift).rollout(starts, np.asarray(commands)[:, None], timing.control_period)
    return states_from_rows(rows[:, 0], start)


def rows_from_states(states: State) -> np.ndarray:
    """The rows of `rans.reference.plant`, (..., 6 or 13), from fields of shape (...)."""
    return np.stack(leaves(states), axis=-1)


def states_from_rows(rows: np.ndarray, like: State) -> Any:
    """A state of the same kind whose fields have shape (...), from rows (..., 6 or 13)."""
    return unflatten(like, np.moveaxis(rows, -1, 0))
