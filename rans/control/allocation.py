"""From a wanted wrench to commands, between 0 and 1 or on/off.

Wrenches are (N, d) about the centre of mass in B, N and N m; LQR, MPC and guidance of missions command by it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rans.base.errors import ConfigError
from rans.control.wheel_torques import WheelTorques, thruster_turns
from rans.model.dynamics import mean_thrust
from rans.model.spacecraft import (
    Spacecraft,
    positively_spans,
)
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
_TIE = 1e-9
"""What the impulse of all thrusters adds to the cost of a pattern, as a share of the dearest beside it: above a
double's rounding of that cost, and below any difference of wrench that could be flown."""
_SATURATED = 0.99
"""Share of what the thrusters can give from which on a wrench counts as more than they can."""


class Allocation:
    """The smallest non-negative thruster commands that together give a wrench.

    Minimises sum u_i^2 subject to B u = wrench and u >= 0, where column i of B is the wrench of
    thruster i fully on. By the Karush-Kuhn-Tucker conditions u = max(0, B^T y), where y maximises the
    concave dual y . wrench - |max(0, B^T y)|^2 / 2: a damped Newton method finds it for all episodes
    at once. For opposed pairs its first guess is exact: the pseudoinverse, of which each pair's
    positive part goes to one thruster and the negative part to the other.

    Where no thruster gives a torque (`Spacecraft.can_turn`), forces alone are met, and the torques
    of wanted wrenches are ignored. Of a craft with reaction wheels, wrenches are those that its wheels leave to
    the thrusters (`Rounding`), and torques about axes that no thruster turns are ignored. Where the thrusters
    of such a craft cannot do without its wheels, each wheel is a column of torque either way.

    Raises:
        ConfigError: the thrusters cannot push it in every direction, or turn it about some axes only, or in
            some direction a million times weaker than in others; see `check_effectors`.
    """

    def __init__(self, craft: Spacecraft) -> None:
        check_effectors(craft)
        if not craft.is_steerable:
            raise ConfigError(
                f"spacecraft {craft.name!r} cannot be steered: its {craft.thruster_count} "
                "thrusters do not push and turn it in every direction; the usual cause is a "
                "missing or reversed thruster."
            )
        self._craft = craft
        self._thrusters = craft.thruster_count
        self._basis: np.ndarray | None = None
        if craft.wheels:
            columns, self._basis = _with_wheels(craft)
        else:
            rows = craft.degrees_of_freedom if craft.can_turn else craft.dimension
            columns = craft.wrenches.T[:rows]
        self._joint = columns.shape[1] > self._thrusters
        self._size = np.abs(columns).max(axis=1)
        self._columns = columns / self._size[:, None]
        if (spread := np.linalg.cond(self._columns)) > _UNEVEN:
            raise ConfigError(
                f"spacecraft {craft.name!r} cannot be steered: its thrusters push and turn it "
                f"{spread:.2g} times harder in one direction than in another, {_UNEVEN:.0e} at "
                "most can be computed with; the usual cause is a force in other units."
            )
        self._shared = craft.thrust_sharing == "split"

    def commands(self, wrench: np.ndarray) -> np.ndarray:
        """Commands that give the wrench, or as great a share of it as the thrusters can.

        The wrench is (N, 3 or 6), force then torque on B, N and N m; commands are (N, thrusters), 0 to 1.
        Where thrust is shared, so is their sum.
        """
        command = self._unbounded(self._rows(wrench) / self._size)
        command = command / np.maximum(self._load(command), 1.0)[:, None]
        return command[:, : self._thrusters]

    def load(self, wrench: np.ndarray) -> np.ndarray:
        """(N,) how many times as much the wrench, (N, 3 or 6), is as the thrusters can give."""
        return self._load(self._unbounded(self._rows(wrench) / self._size))

    def authority(self) -> tuple[float, float]:
        """Force (N) and torque (N m) that can be given along every axis of B, in both senses.

        The torque of a craft that cannot turn is 0. Torques include reaction wheels that are not full.
        """
        reach = self._reach()
        torques = reach[self._craft.dimension :]
        return float(reach[: self._craft.dimension].min()), (
            float(torques.min()) if len(torques) else 0.0
        )

    def accelerations(self) -> tuple[float, float]:
        """Acceleration (m/s^2) along, and angular acceleration (rad/s^2) about, every axis of B that is possible.

        The latter is the least torque over the largest moment of inertia; with reaction wheels it is the least over
        the axes, since a wheel is often weak about an axis of little inertia.
        """
        craft = self._craft
        force, torque = self.authority()
        matrix = inertia(craft)
        if not craft.wheels:
            return force / craft.mass, torque / float(np.linalg.eigvalsh(matrix)[-1])
        about = self._reach()[craft.dimension :] / np.linalg.norm(matrix, axis=0)
        return force / craft.mass, float(about.min())

    def _reach(self) -> np.ndarray:
        """Force along (N) and torque about (N m) every axis of B in both senses; no torques if it cannot turn.

        Gains of regulators and the braking of `Switching` follow from it: a craft with too large a reach
        overshoots.
        """
        craft = self._craft
        if self._basis is None:
            axes = np.diag(self._size)
            load = self._load(self._unbounded(np.vstack([axes, -axes]) / self._size))
            return (np.tile(self._size, 2) / load).reshape(2, -1).min(axis=0)
        unit = np.eye(craft.degrees_of_freedom)
        rows = self._rows(np.vstack([unit, -unit]))
        load = self._load(self._unbounded(rows / self._size))
        # About an axis with a part that no thruster turns, the wheels alone count.
        whole = np.isclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-9)
        with np.errstate(divide="ignore"):
            thrusters = np.where(whole & (load > 0.0), 1.0 / load, 0.0)
        reach = thrusters.reshape(2, -1).min(axis=0)
        if self._joint:
            return reach
        wheels = np.array(craft.wheel_map)
        inverse = np.linalg.pinv(wheels)
        by_wheels = np.isclose(np.linalg.norm(inverse @ wheels, axis=1), 1.0, atol=1e-9)
        largest = np.abs(inverse).max(axis=1)
        reach[craft.dimension :] += np.where(by_wheels, 1.0 / np.maximum(largest, 1e-300), 0.0)
        return reach

    def _rows(self, wrench: np.ndarray) -> np.ndarray:
        """The components of wrenches, (..., 3 or 6), that columns have: (..., rows)."""
        if self._basis is None:
            return wrench[..., : len(self._size)]
        return wrench @ self._basis

    def _load(self, command: np.ndarray) -> np.ndarray:
        """(N,) by how much commands without upper bound ask for more than there is."""
        thrusters = command[:, : self._thrusters]
        supply = thrusters.sum(axis=1) if self._shared else thrusters.max(axis=1)
        return np.maximum(supply, command[:, self._thrusters :].max(axis=1, initial=0.0))

    def _unbounded(self, wrench: np.ndarray) -> np.ndarray:
        """Commands (N, n) >= 0 of least squares that give the wrenches (N, d), by Newton steps on the dual.

        Commands of recorded flights come from here: other steps to the same minimum change their last bits, and so
        roundings.
        """
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
        fraction = np.ones(len(wrench))
        for _ in range(40):
            short = self._value(wrench, dual + fraction[:, None] * step) < before + fraction * slope
            if not short.any():
                break
            fraction = np.where(short, 0.5 * fraction, fraction)
        return fraction

    def _value(self, wrench: np.ndarray, dual: np.ndarray) -> np.ndarray:
        push = np.maximum(0.0, dual @ self._columns)
        return (wrench * dual).sum(axis=1) - 0.5 * (push * push).sum(axis=1)


def _with_wheels(craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Columns (rows, effectors) of a craft with wheels, and the map of wrenches to these rows, (3 or 6, rows).

    Thrusters alone along all forces and about the axes that they turn; if they do not span these, thrusters and
    every wheel either way along all.
    """
    size = craft.degrees_of_freedom
    turns = thruster_turns(craft)
    basis = np.zeros((size, craft.dimension + turns.shape[1]))
    basis[: craft.dimension, : craft.dimension] = np.eye(craft.dimension)
    basis[craft.dimension :, craft.dimension :] = turns
    columns = basis.T @ craft.wrenches.T
    if positively_spans(columns):
        return columns, basis
    return craft.wrenches_either_way, np.eye(size)


def check_effectors(craft: Spacecraft) -> None:
    """Refuse a craft whose commands are not those of thrusters from shut to full force, and of reaction wheels.

    Raises:
        ConfigError: it has effectors of another kind, or throttles with other least or largest levels than 0 and 1.
    """
    if craft.acting_effectors:
        raise ConfigError(
            f"controllers command thrusters and reaction wheels, but {craft.name!r} has effectors of other "
            "kinds: fly an agent or a controller of your own."
        )
    if (craft.actuators.low, craft.actuators.high) != (0.0, 1.0):
        raise ConfigError(
            f"controllers open thrusters from 0 to 1, but those of {craft.name!r} take "
            f"{craft.actuators.allowed}: fly an agent or a controller of your own."
        )


def check_aims(craft: Spacecraft, task: Task) -> None:
    """Refuse a task that asks a craft to turn or to move which cannot.

    Raises:
        ConfigError: nothing gives a torque, and the task has a tolerance for the attitude or the spin; or there is
            no thruster, and it has one for the position or the velocity.
    """
    if not craft.thrusters and (asked := sorted(aims(task) & {"position", "velocity"})):
        raise ConfigError(
            f"{type(task).__name__} asks for {' and '.join(asked)}, and spacecraft {craft.name!r} has no thruster: "
            "wheels turn it and cannot push it. Choose a task of attitudes, such as go-to-attitude."
        )
    if craft.can_turn:
        return
    if asked_angles := sorted(aims(task) & {"attitude", "spin"}):
        raise ConfigError(
            f"{type(task).__name__} asks for {' and '.join(asked_angles)}, and spacecraft {craft.name!r} cannot "
            "turn: all its thrusters act through its centre of mass. Choose a task of positions or "
            "velocities, such as go-to-position or track-velocity, or give it a thruster with an arm."
        )


def inertia(craft: Spacecraft) -> np.ndarray:
    """Inertia about the axes that the craft can turn about, (1, 1) or (3, 3), kg m^2."""
    return np.array(craft.inertia if craft.dimension == 3 else [[craft.inertia[2][2]]])


class ThrusterPatterns:
    """Ways to open thrusters, (..., thrusters) bool, and better ones beside them.

    Neighbours differ in at most two thrusters. Two at a time find pairs whose torques cancel: with one at a
    time the LQR tracks velocities with the free flyer from 39 instead of 50 of 50 starts, and takes the
    platform with shared thrust to 29 of 50 positions. Of equal ones the one of least impulse is the best, or
    thrusters would stay open that push against one another.
    """

    def __init__(self, craft: Spacecraft) -> None:
        # Candidates are tried in this order, none first, and ties go to the first: recorded flights rely on it.
        self.wrenches = craft.wrenches
        forces = np.array([thruster.force for thruster in craft.thrusters])
        self._impulse = forces / max(forces.sum(), 1e-300)
        """Share that each thruster open has of the impulse of all."""
        self._shared = craft.thrust_sharing == "split"
        single = np.eye(
            len(self.wrenches), dtype=bool
        )  # every way to choose at most two, none first
        pairs = map(np.bitwise_or.reduce, itertools.combinations_with_replacement(single, 2))
        self._flips = np.array([single[0] & ~single[0], *pairs])

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
            dearest = costs.max(axis=1, keepdims=True)
            costs = costs + _TIE * dearest * (self.shares(candidates) @ self._impulse)
            episodes = np.arange(len(free))
            first = costs.argmin(axis=1)
            pattern[free] = candidates[episodes, first]
            # by more than rounding, or equal patterns would take turns
            free = free[costs[episodes, first] < costs[:, 0] - 1e-12 * dearest[:, 0]]
        return pattern


class Rounding:
    """Turns wanted wrenches into commands that a craft's effectors can follow, period by period.

    On/off thrusters: sigma-delta modulation of the wrench as a vector. Those are opened that best pay what is owed,
    and what rounding gave too much or too little is carried on, so that over any time the impulse is the wanted one
    to within a few pulses. What is left over is weighed by the kinetic energy it is worth. Carrying it for every
    thruster by itself (sum-up rounding: Sager, J. Process Control 19, 2009) lets several thrusters turn the
    spacecraft in the same period without need.

    Throttled and pulsed thrusters take what the allocation says; what is lost because pulses have whole lengths
    (`rans.model.actuators.Pulsed`) is carried on, and what exceeds the thrusters' authority is not.

    Reaction wheels take of a torque what `WheelTorques` lets them, and thrusters get the force and the rest. What
    is left over then, as pulses are too coarse or thrusters cannot push without turning, wheels take as far as they
    can; the rest is owed. While thrusters rest, wheels go on.

    Args:
        craft: any.
        period: control period, s.
        carried: components of the wrench, (3 or 6,) bool, along which the rest is carried on even while all that is
            wanted is within reach; None: all.
    """

    def __init__(self, craft: Spacecraft, period: float, carried: np.ndarray | None = None) -> None:
        self._craft = craft
        size = craft.degrees_of_freedom
        self._turns = slice(craft.dimension, None)
        """Entries of a wrench that are torques."""
        self._carried = np.ones(size, bool) if carried is None else carried
        self.owed = np.zeros((0, size))
        """(N, 3 or 6) wrench that each episode is still owed, N and N m."""
        self._wheels = WheelTorques(craft, period) if craft.wheels else None
        basis = thruster_turns(craft)
        self._turned = basis @ basis.T
        """Projection onto the torques that thrusters can give."""
        self._allocation = Allocation(craft) if craft.thrusters else None
        opens = craft.thrusters and not craft.actuators.is_continuous
        self._patterns = ThrusterPatterns(craft) if opens else None
        metric = np.zeros((size, size))
        metric[: craft.dimension, : craft.dimension] = np.eye(craft.dimension) / craft.mass
        metric[self._turns, self._turns] = np.linalg.inv(inertia(craft))
        self._root = np.linalg.cholesky(metric)

    def reset(self, count: int) -> None:
        """Forget what is owed: ``count`` new episodes start."""
        self.owed = np.zeros((count, self.owed.shape[1]))

    def round(
        self, wrench: np.ndarray, rest: np.ndarray | None = None, stores: Sequence[Any] = ()
    ) -> np.ndarray:
        """Commands (N, commands) for wrenches on B, (N, 3 or 6), N and N m; changes what is owed.

        Of a wrench as much is owed as the thrusters can give. Episodes that rest, (N,) bool, are owed nothing and
        keep all thrusters shut. ``stores`` are those of the states, of which momenta of wheels count.
        """
        rest = np.zeros(len(wrench), bool) if rest is None else rest
        if self._wheels is None:
            commands, left, kept = self._opened(wrench, rest)
            self.owed = np.where(kept, left, 0.0)
            return commands
        low, high = self._wheels.bounds(stores, rest)
        torque = wrench[:, self._turns]
        wheel_torque = self._wheels.commands(torque, low, high) @ self._wheels.map
        remainder = wrench.copy()
        remainder[:, self._turns] = (torque - wheel_torque) @ self._turned
        commands, left, kept = self._opened(remainder, rest)
        # Wheels give what they were asked for and what thrusters gave too little of or too much.
        missing = np.where(rest[:, None], 0.0, left[:, self._turns])
        wheels = self._wheels.commands(wheel_torque + missing, low, high)
        missing = missing - (wheels @ self._wheels.map - wheel_torque)
        left[:, self._turns] = np.where(rest[:, None], 0.0, missing)
        self.owed = np.where(kept, left, 0.0)
        return np.hstack([commands, wheels])

    def _opened(
        self, wrench: np.ndarray, rest: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Commands of the thrusters, the wrench that is left, and which of its components are owed.

        On/off thrusters start with those of which the allocation asks for half or more, then open or shut one
        or two at a time as long as that brings the impulse closer: see `ThrusterPatterns.best`.
        """
        if self._allocation is None:
            return wrench[:, :0], 0.0 * wrench, np.zeros(wrench.shape, bool)
        load = self._allocation.load(wrench)
        within_reach = wrench / np.maximum(load, 1.0)[:, None]
        debt = np.where(rest[:, None], 0.0, self.owed + within_reach)
        commands = self._allocation.commands(debt)
        patterns = self._patterns
        if patterns is None:
            given = np.stack(mean_thrust(self._craft, tuple(commands.T)), axis=1)
            return commands, debt - given @ self._craft.wrenches, self._carried

        def energy(episodes: np.ndarray, candidates: np.ndarray) -> np.ndarray:
            left = (debt[episodes][:, None] - patterns.wrench(candidates)) @ self._root
            return (left * left).sum(axis=2)

        pulse = patterns.best((commands >= 0.5) & ~rest[:, None], energy, ~rest)
        kept = self._carried | (load > _SATURATED)[:, None]
        return pulse.astype(float), debt - patterns.wrench(pulse), kept
