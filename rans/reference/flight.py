"""Flights in Drake: the same controllers from the same starts, moved by the judge."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.flight import Controller, Flight
from rans.model.drift import FREE, Drift
from rans.model.dynamics import State
from rans.model.fields import leaves, unflatten
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.reference.plant import Plant
from rans.scenario import Scenario
from rans.tasks.base import Task, observation


def fly_in_drake(craft: Spacecraft, task: Task, controller: Controller, starts: Scenario,
                 timing: Timing) -> Flight:
    """Fly a batch of scenarios in Drake, as `rans.flight.fly` does with our equations.

    Args:
        craft: what flies.
        task: gives the observations.
        controller: sees all N episodes at once, with headings wrapped and quaternions normalised.
        starts: fields of float64 arrays (N,), as `rans.flight.scenarios` gives them.
        timing: control period and length; its substeps do not concern Drake.
    """
    goal, count = starts.goal, len(leaves(starts.start)[0])

    def act(rows: np.ndarray) -> np.ndarray:
        state = states_from_rows(rows, starts.start).normalised()
        seen = np.stack(observation(task, state, goal), axis=1).astype(np.float32)
        return controller.act(state, goal, seen)

    controller.reset(count)
    rows, commands = Plant(craft, count).follow(
        rows_from_states(starts.start), act, timing.episode_steps, timing.control_period)
    states = states_from_rows(rows, starts.start).normalised()
    return Flight(craft, task, timing, states, goal, commands, controller.name, "drake")


def replay(craft: Spacecraft, start: State, commands: np.ndarray, timing: Timing,
           drift: Drift = FREE) -> Any:
    """Where commands given beforehand take one spacecraft, in Drake.

    Args:
        craft: what flies.
        start: a state of floats.
        commands: (T, thrusters), 0 to 1, each held for one control period.
        timing: gives the control period.
        drift: how a free point moves.

    Returns:
        The `State` with fields (T + 1,), the start first; headings are not wrapped.
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
