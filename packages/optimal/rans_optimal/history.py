"""Optimal trajectories and certified on/off commands as arrays, figures, tables and flights."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rans.api.pages import Replay
from rans.extend import (
    Bound,
    ConfigError,
    Flight,
    Scenario,
    Spacecraft,
    Task,
    Timing,
    each,
    fly,
    leaves,
)
from rans_optimal.optima import Optimum, episode
from rans_optimal.transcription import Trajectory


class ControlHistory(ABC):
    """Commands from one start, each held for a control period, with arrays, a figure, a table and flights."""

    @property
    @abstractmethod
    def u(self) -> np.ndarray:
        """(T, thrusters) commands."""

    @property
    @abstractmethod
    def x(self) -> np.ndarray:
        """(T + 1, k) states: position (m), heading (rad) or quaternion, velocity (m/s), spin (rad/s)."""

    @property
    @abstractmethod
    def period(self) -> float:
        """Time that a command is held, s."""

    @property
    def t(self) -> np.ndarray:
        """(T + 1,) times, s."""
        return np.arange(len(self.u) + 1) * self.period

    @abstractmethod
    def replay(self) -> Flight:
        """The commands flown by Drake from the same start; `ConfigError` where there are none."""

    def plot(self) -> Any:
        """A figure of path, errors and commands; `ConfigError` where nothing was found."""
        return self.replay().plot()

    def view(self) -> Replay:
        """A page that replays the commands in three dimensions, flown by Drake; see `rans.view`.

        Raises:
            ConfigError: there are no commands.
        """
        flight = self.replay()
        return Replay([flight], f"{flight.controller}, {flight.craft.name}")

    def to_csv(self, file: str | Path) -> Path:
        """Write the flight in Drake, see `rans.episode.flight.Flight.to_csv`, and return the file."""
        return self.replay().to_csv(file)


@dataclass(frozen=True, repr=False)
class OptimalTrajectory(Optimum, ControlHistory):
    """An optimal trajectory with thrust between 0 and 1, flown in Drake; `rans.optimal_trajectory` returns it.

    >>> found = rans.optimal_trajectory("go-to-pose", objective="time", intervals=20)
    >>> found.t.shape, found.x.shape, found.u.shape
    ((21,), (21, 6), (20, 8))
    """

    @property
    def period(self) -> float:
        """Time that a command is held, s."""
        return self.trajectory.control_period

    @property
    def x(self) -> np.ndarray:
        """(T + 1, k) states: position (m), heading (rad) or quaternion, velocity (m/s), spin (rad/s)."""
        return np.stack([np.asarray(leaf) for leaf in leaves(self.trajectory.states)], axis=-1)

    @property
    def u(self) -> np.ndarray:
        """(T, thrusters) commands, 0 to 1."""
        return self.trajectory.commands

    @property
    def status(self) -> str:
        """Either "solved", or the reason why there is no solution."""
        return self.sentence

    def replay(self) -> Flight:
        """The flight in Drake; `ConfigError` where there is no trajectory."""
        if self.flight is None:
            raise ConfigError(f"there is no flight in Drake: {self.sentence}.")
        return self.flight


@dataclass(frozen=True, repr=False)
class CertifiedBound(Bound, ControlHistory):
    """Certified bounds of one start, and the best on/off commands that were found; `rans.certify` returns it.

    >>> found = rans.certify("go-to-pose", start=3, control_period=0.5)
    >>> found.lower, found.upper, found.u.shape
    (5.5, 5.5, (11, 8))
    """

    craft: Spacecraft | None = None
    """The spacecraft."""
    task: Task | None = None
    """The task."""
    scenario: Scenario | None = None
    """Start and goal, fields of arrays (1,)."""
    control_period: float = 0.2
    """Time that a command is held, s."""

    @property
    def u(self) -> np.ndarray:
        """(T, thrusters) zeros and ones; `ConfigError` where none were found."""
        if self.commands is None:
            raise ConfigError(
                "no on/off commands were found from this start: there is a bound only; more seconds may "
                "find some, and none are needed where the start is in the goal set."
            )
        return np.array(self.commands, dtype=float)

    @property
    def period(self) -> float:
        """Time that a command is held, s."""
        return self.control_period

    @property
    def x(self) -> np.ndarray:
        """(T + 1, k) states, as the engines' equations fly the commands; see `ControlHistory.x`."""
        assert self.craft is not None
        assert self.task is not None
        assert self.scenario is not None
        open_loop = _OpenLoop(self.u)
        states = fly(self.craft, self.task, open_loop, self.scenario, self._timing).states
        return np.stack([np.asarray(leaf)[:, 0] for leaf in leaves(states)], axis=-1)

    @property
    def _timing(self) -> Timing:
        """The commands, one a control period, from the first to the last."""
        return Timing(control_period=self.control_period, episode_steps=len(self.u))

    def replay(self) -> Flight:
        """The flight in Drake; `ConfigError` where no commands were found."""
        assert self.craft is not None
        assert self.task is not None
        assert self.scenario is not None
        path = Trajectory(
            objective=f"certified {self.event.text}",
            status="",
            solved=True,
            cost=self.upper,
            states=None,
            commands=self.u,
            control_period=self.control_period,
            iterations=0,
            seconds=self.seconds,
        )
        (scenario,) = each(self.scenario)
        return episode(self.craft, self.task, self._timing, scenario, path)


class _OpenLoop:
    """Commands (T, thrusters) that were chosen beforehand, as a controller."""

    name = "certified"
    observes = False

    def __init__(self, commands: np.ndarray) -> None:
        self._commands = commands[:, None]
        self._step = 0

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        self._step += 1
        return self._commands[self._step - 1]
