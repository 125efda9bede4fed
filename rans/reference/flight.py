"""Flights and environments in Drake: the same controllers from the same starts, moved by the judge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rans.episode.environment import Environment
from rans.episode.flight import Controller, Flight, fly
from rans.episode.scenario import Scenario
from rans.episode.step import Mover
from rans.model.accuracy import gyroscopic_rate, spin_up
from rans.model.body import Body
from rans.model.drift import FREE, Drift
from rans.model.dynamics import State
from rans.model.fields import leaves, unflatten
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.parameters import StepInputs
from rans.randomization.valves import Lag
from rans.reference.nozzles import Failure, Nozzles
from rans.reference.parts import designed
from rans.reference.plant import Plant
from rans.tasks.base import Task

_SHORTEST = 0.01
"""Integration step of Drake, s, that no craft needs to be shorter."""
_TURN = 0.05
"""Angle turned in a longer step, rad: the error of a Runge-Kutta step of order five is then below 1e-9."""
_STRONGER = 3.0
"""How much faster a drawn or broken craft may spin up than the designed one."""


def fly_in_drake(
    craft: Spacecraft,
    task: Task,
    controller: Controller,
    starts: Scenario,
    timing: Timing,
    *,
    body: Body | None = None,
    max_step: float | None = None,
    **others: Any,
) -> Flight:
    """Fly a batch of scenarios as `rans.episode.flight.fly` does, whose keywords the others are, moved by Drake.

    Substeps do not concern Drake, but its own longest step (s) does; None: see `DrakeMover`.
    """
    move = DrakeMover(craft, timing, task.drift, max_step)
    return fly(craft, task, controller, starts, timing, move, body or designed(craft), **others)


class DrakeMover:
    """Drake as what moves the spacecraft of episodes: a `rans.episode.step.Mover`.

    Where mass properties change, which is once an episode, it builds another plant, which takes milliseconds.

    Args:
        craft: what flies.
        timing: control period and checks.
        drift: how a free point moves.
        max_step: Drake's longest integration step, s. None: a twentieth of the control period, shortened to
            `_TURN` of the fastest spin that the period can end with, but at least 0.01 s: a craft that hardly
            turns flies an orbit in steps of half a second.

    Raises:
        ConfigError: see `Plant`.
    """

    engine = "drake"

    def __init__(
        self, craft: Spacecraft, timing: Timing, drift: Drift = FREE, max_step: float | None = None
    ) -> None:
        self._craft = craft
        self._timing = timing
        self._drift = drift
        self._max_step = max_step
        self._built_for = np.zeros(0)
        self._spin_up = spin_up(craft)
        self._plant = self._plant_for(designed(craft), 1)

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy builds its own plant, because Drake's cannot be pickled; every period begins from its argument."""
        return DrakeMover, (self._craft, self._timing, self._drift, self._max_step)

    def __call__(self, state: Any, step_inputs: StepInputs) -> tuple[Any, ...]:
        """States at the checks of one control period, the last one at its end."""
        rows = rows_from_states(state)
        body = step_inputs.body
        disturbance = step_inputs.disturbance
        late = _lateness(step_inputs.lag)
        fails = step_inputs.failing
        states = np.atleast_2d(rows)
        command, *earlier = (_columns(commanded, len(states)) for commanded in step_inputs.commands)
        failure = None
        if fails is not None:
            failure = Failure(
                _columns([fails.instant], len(states)),
                Nozzles.of(self._craft, fails.body, len(states), *late),
            )
        plant = self._plant_for(body, len(states))
        if self._max_step is None:
            plant.set_max_step(self._step_for(state))
        at_checks = plant.states_at_checks(
            states,
            command,
            self._timing.control_period,
            None if disturbance is None else _columns(leaves(disturbance), len(states)),
            Nozzles.of(self._craft, body, len(states), *late),
            earlier,
            failure,
            self._timing.checks,
            step_inputs.drift,
        )
        return tuple(
            states_from_rows(some.reshape(rows.shape), state).normalised() for some in at_checks
        )

    def _step_for(self, state: Any) -> float:
        """Longest integration step, s, for one control period from this state.

        Drake's error is what engines are judged by, so that a longer step needs the figures of `rans validate`
        again.
        """
        period = self._timing.control_period
        spins = np.square(np.stack(np.broadcast_arrays(*state.spin()))).sum(axis=0)
        fastest = float(np.sqrt(np.nan_to_num(spins).max())) + _STRONGER * self._spin_up * period
        fastest += gyroscopic_rate(self._craft)
        stores = _columns(state.stores, np.size(state.p.x)) if state.stores else np.zeros((1, 0))
        fastest += self._plant.fastest_inside(stores)
        return max(_SHORTEST, min(period / 20.0, _TURN / max(fastest, 1e-9)))

    def _plant_for(self, body: Body, count: int) -> Plant:
        """The plant of these bodies, which is built again only if they differ from the last ones.

        Gains and leaks are no part of a plant, so that faults need no new one.
        """
        parts = (body.mass, body.inertia, body.centre, body.mountings)
        flying = _columns(leaves(parts), count)
        if not np.array_equal(flying, self._built_for):
            step = _SHORTEST if self._max_step is None else self._max_step
            self._plant = Plant(self._craft, count, step, body, self._drift)
            self._built_for = flying
        return self._plant


class DrakeEnv(Environment):
    """`Environment` whose motion an independent judge computes.

    Made by ``gymnasium.make("rans/GoToPose2D-Drake-v0")``. It flies the same episodes as
    `rans.SpacecraftEnv`, observes, rewards and ends them in the same way, and needs about a
    millisecond a step. Its motion is as accurate as `Plant` is: ``timing.substeps`` does not concern it.

    Raises:
        ConfigError: see `Environment`; or Drake refuses the spacecraft's mass properties.
    """

    def _mover(self) -> Mover:
        return DrakeMover(self.craft, self.timing, self.task.drift)


def _lateness(lag: Lag | None) -> tuple[Any, Any]:
    """Latency and rise, s."""
    if lag is None:
        return 0.0, 0.0
    return lag.latency, 0.0 if lag.rise is None else lag.rise


def _columns(fields: Sequence[Any], count: int) -> np.ndarray:
    """Rows of plain numbers, (N, fields), from fields of one number or of N."""
    return np.column_stack(
        [np.broadcast_to(np.asarray(x, dtype=np.float64).ravel(), count) for x in fields]
    )


def replay(
    craft: Spacecraft, start: State, commands: np.ndarray, timing: Timing, drift: Drift = FREE
) -> Any:
    """States of one spacecraft in Drake under commands (T, thrusters), each held for one control period.

    The start is of floats, the result of fields (T + 1,), the start first. Headings are not wrapped.
    """
    starts = np.array([leaves(start)], dtype=np.float64)
    rows = Plant(craft, drift=drift).rollout(
        starts, np.asarray(commands)[:, None], timing.control_period
    )
    return states_from_rows(rows[:, 0], start)


def rows_from_states(states: State) -> np.ndarray:
    """The rows of `rans.reference.plant`, (..., width), from fields of shape (...)."""
    return np.stack(leaves(states), axis=-1)


def states_from_rows(rows: np.ndarray, like: State) -> Any:
    """A state of the same kind whose fields have shape (...), from rows (..., width)."""
    return unflatten(like, np.moveaxis(rows, -1, 0))
