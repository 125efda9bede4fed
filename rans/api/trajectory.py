"""An optimal trajectory as arrays, a figure, a table, and a flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.errors import ConfigError, one_of
from rans.evaluation.compare.optima import Optimum
from rans.files import write_text
from rans.flight import Flight, fly
from rans.model.fields import leaves, map_leaves
from rans.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rans.evaluation.fly.episodes import EngineName

_COLUMNS = {2: "x y heading v_x v_y w", 3: "x y z q_w q_x q_y q_z v_x v_y v_z w_x w_y w_z"}
"""Names of a state's numbers, by the dimension."""


class OptimalTrajectory(Optimum):
    """A trajectory that the optimiser found, with thrust between 0 and 1, flown in Drake.

    >>> found = rans.optimal_trajectory("go-to-pose", objective="time", intervals=20)
    >>> found.t.shape, found.x.shape, found.u.shape
    ((21,), (21, 6), (20, 8))
    """

    @property
    def t(self) -> np.ndarray:
        """(T + 1,) times, s."""
        return np.arange(len(self.u) + 1) * self.trajectory.control_period

    @property
    def x(self) -> np.ndarray:
        """(T + 1, k) states: position (m), heading (rad) or quaternion, velocity (m/s), spin (rad/s)."""
        return np.stack([np.asarray(one) for one in leaves(self.trajectory.states)], axis=-1)

    @property
    def u(self) -> np.ndarray:
        """(T, thrusters) commands, 0 to 1."""
        return self.trajectory.commands

    @property
    def status(self) -> str:
        """How it ended, in words."""
        return self.sentence

    def plot(self) -> Figure:
        """A figure of path, errors and commands; `ConfigError` where nothing was found."""
        from rans.show.figures.figures import episode_figure

        return episode_figure(self.replay("drake"))

    def to_csv(self, file: str | Path) -> Path:
        """Write a row for each instant: time, state and the command that is held from then on.

        Raises:
            ConfigError: the disk refused.
        """
        names = _COLUMNS[2 if self.x.shape[1] < len(_COLUMNS[3].split()) else 3].split()
        names += [f"x_{k}" for k in range(len(names), self.x.shape[1])]
        header = ["t", *names, *(f"u_{k}" for k in range(self.u.shape[1]))]
        commands = np.vstack([self.u, np.zeros(self.u.shape[1])])
        rows = np.column_stack([self.t, self.x, commands])
        lines = [",".join(header), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
        write_text(Path(file), "\n".join(lines) + "\n")
        return Path(file)

    def replay(self, engine: EngineName = "drake") -> Flight:
        """The commands flown from the same start, in Drake or by our equations.

        Raises:
            ConfigError: there is no such engine, or no trajectory.
        """
        one_of("engine", engine, ("fast", "drake"))
        flight = self.flight
        if flight is None:
            raise ConfigError(f"there is no trajectory to fly: {self.sentence}.")
        if engine == "drake":
            return flight
        first = map_leaves(lambda x: x[0], flight.states)
        goal = map_leaves(lambda x: x[0] if np.ndim(x) == 2 else x, flight.goals)
        return fly(
            flight.craft,
            flight.task,
            _OpenLoop(flight.controller, flight.commands),
            Scenario(first, goal),
            flight.timing,
        )


class _OpenLoop:
    """Commands that were chosen beforehand, as a controller."""

    def __init__(self, name: str, commands: np.ndarray) -> None:
        self.name = name
        self._commands = commands
        self._step = 0

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        self._step += 1
        return self._commands[self._step - 1]
