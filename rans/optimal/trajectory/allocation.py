"""From a wanted wrench to commands, between 0 and 1 or on/off."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol

import numpy as np

from rans.errors import ConfigError, counted
from rans.model.dynamics import thrust
from rans.model.spacecraft import Spacecraft, can_turn, is_steerable
from rans.tasks.base import Task
from rans.tasks.goal_set import aims

_STEPS = 100
"""Newton steps at most. Opposed pairs of equal thrusters need none, random layouts about ten; where
thrusters are so nearly dependent that this does not suffice the wrench is met approximately."""
_UNEVEN = 1e6
"""Condition of the thrusters' wrenches at most: its square leaves four of a double's sixteen digits."""
_EXACT = 1e-9
"""Part of a wrench that may be missing."""
_FLIPS = 20
"""Rounds of improvement at most; three are usual."""
_SATURATED = 0.99
"""Share of what the thrusters can give from which on a wrench counts as more than they can."""


class Allocation:
    """The smallest non-negative thruster commands that together give a wrench.

    Minimises sum u_i^2 subject to B u = wrench and u >= 0, where column i of B is the wrench of
    thruster i fully on. By the Karush-Kuhn-Tucker conditions u = max(0, B^T y), where y maximises the
    concave dual y . wrench - |max(0, B^T y)|^2 / 2: a damped Newton method finds it for all episodes
    at once. For opposed pairs its first guess is exact: the pseudoinverse, of which each pair's
    positive part goes to one thruster and the negative part to the other.

    Where no thruster gives a torque (`rans.model.spacecraft.can_turn`), forces alone are met, and the torques
    of wanted wrenches are ignored.

    Raises:
        ConfigError: the thrusters cannot push it in every direction, or turn it about some axes only, or in
            some direction a million times weaker than in others; see `check_effectors`.
    """

    def __init__(self, craft: Spacecraft) -> None:
        check_effectors(craft)
        if not is_steerable(craft):
            raise ConfigError(
                f"spacecraft {craft.name!r} cannot be steered: its {len(craft.thrusters)} "
                "thrusters do not push and turn it in every direction; the usual cause is a "
                "missing or reversed thruster."
            )
        self._rows = slice(0, craft.degrees_of_freedom if can_turn(craft) else craft.dimension)
        columns = np.array(craft.wrench_map).T[self._rows]
        self._size = np.abs(columns).max(axis=1)
        self._columns = columns / self._size[:, None]
        if (spread := np.linalg.cond(self._columns)) > _UNEVEN:
            raise ConfigError(
                f"spacecraft {craft.name!r} cannot be steered: its thrusters push and turn it "
                f"{spread:.2g} times harder in one direction than in another, {_UNEVEN:.0e} at "
                "most can be computed with; the usual cause is a force in other units."
            )
        self._dimension = craft.dimension
        self._shared = craft.thrust_sharing == "split"

    def commands(self, wrench: np.ndarray) -> np.ndarray:
        """Commands that give the wrench, or as great a share of it as the thrusters can.

        The wrench is (N, 3 or 6), force then torque on B, N and N m; commands are (N, thrusters), 0 to 1.
        Where thrust is shared, so is their sum.
        """
        command = self._unbounded(wrench[..., self._rows] / self._size)
        return command / np.maximum(self._load(command), 1.0)[:, None]

    def load(self, wrench: np.ndarray) -> np.ndarray:
        """(N,) how many times as much the wrench, (N, 3 or 6), is as the thrusters can give."""
        return self._load(self._unbounded(wrench[..., self._rows] / self._size))

    def authority(self) -> tuple[float, float]:
        """Force (N) and torque (N m) that can be given along every axis of B, in both senses.

        The torque of a craft that cannot turn is 0.
        """
        axes = np.diag(self._size)
        load = self._load(self._unbounded(np.vstack([axes, -axes]) / self._size))
        reach = (np.tile(self._size, 2) / load).reshape(2, -1).min(axis=0)
        torques = reach[self._dimension :]
        return float(reach[: self._dimension].min()), float(torques.min()) if len(torques) else 0.0

    def _load(self, command: np.ndarray) -> np.ndarray:
        """(N,) by how much commands without upper bound ask for more than there is."""
        return command.sum(axis=1) if self._shared else command.max(axis=1)

    def _unbounded(self, wrench: np.ndarray) -> np.ndarray:
        columns = self._columns
        scale = np.abs(wrench).max(initial=1.0)
        dual = 2.0 * wrench @ np.linalg.inv(columns @ columns.T)
        for _ in range(_STEPS):
            command = np.maximum(0.0, dual @ columns)
            missing = wrench - command @ columns.T
            if np.abs(missing).max(initial=0.0) <= _EXACT * scale:
                break
            open_columns = columns * (command > 0)[:, None, :]
            curvature = open_columns @ columns.T + 1e-9 * np.eye(len(columns))
            step = np.linalg.solve(curvature, missing[..., None])[..., 0]
            dual = dual + step * self._damping(wrench, dual, step, missing)[:, None]
        return np.maximum(0.0, dual @ columns)

    def _damping(
        self, wrench: np.ndarray, dual: np.ndarray, step: np.ndarray, up: np.ndarray
    ) -> np.ndarray:
        """(N,) largest powers of a half at which the dual function rises enough (Armijo's rule)."""
        before = self._value(wrench, dual)
        slope = 1e-4 * (step * up).sum(axis=1)
        share = np.ones(len(wrench))
        for _ in range(40):
            short = self._value(wrench, dual + share[:, None] * step) < before + share * slope
            if not short.any():
                break
            share = np.where(short, 0.5 * share, share)
        return share

    def _value(self, wrench: np.ndarray, dual: np.ndarray) -> np.ndarray:
        push = np.maximum(0.0, dual @ self._columns)
        return (wrench * dual).sum(axis=1) - 0.5 * (push * push).sum(axis=1)


def check_effectors(craft: Spacecraft) -> None:
    """Refuse a craft whose commands are not those of thrusters from shut to full force.

    Raises:
        ConfigError: it has reaction wheels, or throttles with another least or largest level than 0 and 1.
    """
    _check_wheels(craft)
    if (craft.actuators.low, craft.actuators.high) != (0.0, 1.0):
        raise ConfigError(
            f"controllers open thrusters from 0 to 1, but those of {craft.name!r} take "
            f"{craft.actuators.allowed}: fly an agent or a controller of your own."
        )


def check_relaxation(craft: Spacecraft) -> None:
    """Refuse a craft for which optimal control has no equations yet.

    Raises:
        ConfigError: it has reaction wheels or propellant, or throttles that are shut below a least level.
    """
    _check_wheels(craft)
    if craft.propellant is not None:
        raise ConfigError(
            f"optimal trajectories are those of a constant mass, but {craft.name!r} uses propellant: take "
            "[propellant] out of its file for what its full mass could do."
        )
    actuators = craft.actuators
    if (
        actuators.low == 0.0
        and getattr(actuators, "least", 0.0) > 0.0
        and actuators.kind == "throttle"
    ):
        raise ConfigError(
            f"the thrusters of {craft.name!r} are shut or give a least level, and optimal trajectories "
            "have commands without gaps: set always_lit = true, or least = 0 for a bound."
        )


def _check_wheels(craft: Spacecraft) -> None:
    if craft.further_effectors:
        raise ConfigError(
            f"controllers and optimal trajectories command thrusters alone, but {craft.name!r} has effectors "
            "of other kinds: fly an agent or a controller of your own."
        )
    if craft.wheels:
        raise ConfigError(
            f"controllers and optimal trajectories command thrusters alone, but {craft.name!r} has "
            f"{counted(len(craft.wheels), 'reaction wheel')}: fly an agent or a controller of your own."
        )


def check_attitude(craft: Spacecraft, task: Task) -> None:
    """Refuse a task that asks a craft to turn which cannot.

    Raises:
        ConfigError: no thruster gives a torque, and the task has a tolerance for the attitude or the spin.
    """
    if can_turn(craft):
        return
    if wanted := sorted(aims(task) & {"attitude", "spin"}):
        raise ConfigError(
            f"{type(task).__name__} asks for {' and '.join(wanted)}, and spacecraft {craft.name!r} cannot "
            "turn: all its thrusters act through its centre of mass. Choose a task of positions or "
            "velocities, such as go-to-position or track-velocity, or give it a thruster with an arm."
        )


def inertia(craft: Spacecraft) -> np.ndarray:
    """Inertia about the axes that the craft can turn about, (1, 1) or (3, 3), kg m^2."""
    return np.array(craft.inertia if craft.dimension == 3 else [[craft.inertia[2][2]]])


class Patterns:
    """Ways to open thrusters, (..., thrusters) bool, and better ones beside them.

    Neighbours differ in at most two thrusters. Two at a time find pairs whose torques cancel: with one at a
    time the LQR tracks velocities with the free flyer from 39 instead of 50 of 50 starts, and takes the
    platform with shared thrust to 29 of 50 positions.
    """

    def __init__(self, craft: Spacecraft) -> None:
        self.wrenches = np.array(craft.wrench_map)
        self._shared = craft.thrust_sharing == "split"
        one = np.eye(len(self.wrenches), dtype=bool)  # every way to choose at most two, none first
        pairs = map(np.bitwise_or.reduce, itertools.combinations_with_replacement(one, 2))
        self._flips = np.array([one[0] & ~one[0], *pairs])

    def shares(self, pattern: np.ndarray) -> np.ndarray:
        """(..., thrusters) share of its force that each gives, as `rans.model.dynamics.thrust` has it."""
        opened = pattern.astype(float)
        if self._shared:
            opened /= np.maximum(opened.sum(axis=-1, keepdims=True), 1.0)
        return opened

    def wrench(self, pattern: np.ndarray) -> np.ndarray:
        """(..., 3 or 6) the wrench of open thrusters."""
        return self.shares(pattern) @ self.wrenches

    def best(
        self,
        pattern: np.ndarray,
        cost: Callable[[np.ndarray, np.ndarray], np.ndarray],
        free: np.ndarray,
    ) -> np.ndarray:
        """Goes from pattern to better neighbour, best first, until there is none.

        Args:
            pattern: where to start, (N, thrusters).
            cost: of episodes (M,), their numbers, and candidates (M, C, thrusters): (M, C).
            free: which episodes may change, (N,) bool.
        """
        pattern = pattern.copy()
        free = np.flatnonzero(free)
        for _ in range(_FLIPS):
            if not len(free):
                break
            candidates = pattern[free][:, None] ^ self._flips
            costs = cost(free, candidates)
            episodes = np.arange(len(free))
            first = costs.argmin(axis=1)
            pattern[free] = candidates[episodes, first]
            # by more than rounding, or equal patterns would take turns
            free = free[costs[episodes, first] < costs[:, 0] - 1e-12 * (1 + costs[:, 0])]
        return pattern


class SigmaDelta:
    """Opens the thrusters that best pay what is owed, and carries the rest to the next period.

    Sigma-delta modulation of the wrench as a vector: what rounding gave too much or too little is carried on,
    so that over any time the impulse is the wanted one to within a few pulses. What is left over is weighed
    by the kinetic energy it is worth. Carrying it for every thruster by itself (sum-up rounding: Sager, J.
    Process Control 19, 2009) lets several thrusters turn the spacecraft in the same period without need.

    The rest is carried on along some components of the wrench, (3 or 6,) bool, by default all, even while all
    that is wanted is within reach.
    """

    def __init__(self, craft: Spacecraft, carried: np.ndarray | None = None) -> None:
        self._patterns = Patterns(craft)
        self._allocation = Allocation(craft)
        size = craft.degrees_of_freedom
        metric = np.zeros((size, size))
        metric[: craft.dimension, : craft.dimension] = np.eye(craft.dimension) / craft.mass
        metric[craft.dimension :, craft.dimension :] = np.linalg.inv(inertia(craft))
        self._root = np.linalg.cholesky(metric)
        self._carried = np.ones(size, bool) if carried is None else carried
        self.owed = np.zeros((0, size))

    def reset(self, count: int) -> None:
        """Forget what is owed: ``count`` new episodes start."""
        self.owed = np.zeros((count, self.owed.shape[1]))

    def round(self, wrench: np.ndarray, rest: np.ndarray | None = None) -> np.ndarray:
        """Open (1.0) or shut (0.0) for every episode.

        Starts with the thrusters of which the allocation asks for half or more, then opens or shuts one
        or two at a time as long as that brings the impulse closer: see `Patterns.best`.

        Of the wrench, (N, 3 or 6), force then torque on B, as much is owed as the thrusters can give; those
        that rest, (N,) bool, are owed nothing and keep all thrusters shut. Returns (N, thrusters).
        """
        rest = np.zeros(len(wrench), bool) if rest is None else rest
        load = self._allocation.load(wrench)
        within_reach = wrench / np.maximum(load, 1.0)[:, None]
        owed = np.where(rest[:, None], 0.0, self.owed + within_reach)
        first = (self._allocation.commands(owed) >= 0.5) & ~rest[:, None]

        def energy(episodes: np.ndarray, candidates: np.ndarray) -> np.ndarray:
            left = (owed[episodes][:, None] - self._patterns.wrench(candidates)) @ self._root
            return (left * left).sum(axis=2)

        pulse = self._patterns.best(first, energy, ~rest)
        carried = self._carried | (load > _SATURATED)[:, None]
        self.owed = np.where(carried, owed - self._patterns.wrench(pulse), 0.0)
        return pulse.astype(float)


class Rounding(Protocol):
    """Turns wanted wrenches into commands that thrusters can follow, period by period."""

    owed: np.ndarray
    """(N, 3 or 6) wrench that each episode is still owed, N and N m."""

    def reset(self, count: int) -> None:
        """Forget what is owed: ``count`` new episodes start."""

    def round(self, wrench: np.ndarray, rest: np.ndarray | None = None) -> np.ndarray:
        """Commands (N, thrusters) for wrenches on B, (N, 3 or 6), N and N m; zero where episodes rest."""
        ...


class Proportional:
    """Allocates a wrench to thrusters that take commands between 0 and 1: throttled or pulsed ones.

    What is lost because pulses have whole lengths (`rans.model.actuators.Pulsed`) is carried to the next
    period along the components ``carried``, (3 or 6,) bool, by default all; what exceeds the thrusters'
    authority is not.
    """

    def __init__(self, craft: Spacecraft, carried: np.ndarray | None = None) -> None:
        self._craft = craft
        self._allocation = Allocation(craft)
        self._wrenches = np.array(craft.wrench_map)
        self._carried = np.ones(craft.degrees_of_freedom, bool) if carried is None else carried
        self.owed = np.zeros((0, craft.degrees_of_freedom))

    def reset(self, count: int) -> None:
        """See `Rounding`."""
        self.owed = np.zeros((count, self.owed.shape[1]))

    def round(self, wrench: np.ndarray, rest: np.ndarray | None = None) -> np.ndarray:
        """See `Rounding`."""
        rest = np.zeros(len(wrench), bool) if rest is None else rest
        within_reach = wrench / np.maximum(self._allocation.load(wrench), 1.0)[:, None]
        owed = np.where(rest[:, None], 0.0, self.owed + within_reach)
        commands = self._allocation.commands(owed)
        self.owed = np.where(self._carried, owed - self._mean(commands) @ self._wrenches, 0.0)
        return commands

    def _mean(self, commands: np.ndarray) -> np.ndarray:
        """(N, thrusters) share of its force that each thruster gives in the mean of a period."""
        mean = np.zeros(commands.shape)
        for duration, opened in self._craft.actuators.pulses(tuple(commands.T)):
            shares = np.stack(thrust(self._craft, opened), axis=1)
            mean += np.reshape(duration, (-1, 1)) * shares
        return mean


def rounding(craft: Spacecraft, carried: np.ndarray | None = None) -> Rounding:
    """Rounding for the craft's kind of thrusters.

    `SigmaDelta` where they are on or off, else `Proportional`; see these for what is carried.
    """
    kind = Proportional if craft.actuators.is_continuous else SigmaDelta
    return kind(craft, carried)
