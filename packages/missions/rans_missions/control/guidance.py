"""Guidance to a place by a deadline: burn the velocity to gain, coast, correct, and brake in time.

Arrays are (d, N) in W; its law needs no network, so that bounds, missions and comparisons start from it.
"""

from __future__ import annotations

import itertools
import math
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.errors import checked
from rans.extend import (
    ConfigError,
    Heading,
    Quat,
    Spacecraft,
    Task,
    Timing,
    is_finite,
    leaves,
    map_leaves,
)
from rans.optimal.control.linear_motion import LinearMotion
from rans.optimal.control.regulator import Deadband, ModelBased, Regulator, Weights
from rans.optimal.trajectory.allocation import Allocation, inertia, rounding
from rans.optimal.trajectory.guess import rotation_vector

_DEADBAND = Deadband()
_DEFAULT_SHARE = 0.4
"""Deadline as a share of the episode."""
_BURNS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Lengths of burns that are tried, control periods."""
_LATER = 1.25
"""Arrivals that are tried after the deadline are later by this factor each."""
_ATTEMPTS = 24
"""Arrivals that are tried at most: the last is 200 times as far away as the first."""
_FULL = 0.95
"""Share of the thrusters' authority that a planned burn takes: the rest corrects it."""


class VelocityToGain(ModelBased):
    """Flies to a goal by a deadline with two burns, under the task's drift, and holds it then.

    >>> rans.VelocityToGain("floating-platform", "go-to-position", deadline=12.0)
    <guidance: GoToPosition for floating-platform>

    In every control period it computes the burn that begins now and the burn that ends at the deadline with
    which the craft arrives where the goal will be, at the goal's velocity (Battin, "An Introduction to the
    Mathematics and Methods of Astrodynamics", 1999, chapter 11: velocity to be gained). Burns are as short as
    the thrusters allow, each constant in W, and are computed exactly for drifts that are affine in position
    and velocity, so that no thrust is spent between them but on what went wrong. Where the deadline cannot be
    kept, or is over, the soonest arrival that can be counts. Between commands at least one period passes, so
    an arrival is never sooner than the burns last.

    In a mission on an orbit it stays at the goal after a deadline, and from the arrival on where it does not stop
    there (`rans_missions.control.afterwards`).

    The attitude, where the task asks for one, is turned as by the `LQR`. Thrusters that are throttled or
    pulsed give shares of their thrust; on/off thrusters open where half or more is wanted.

    Args:
        craft: by name, TOML file or as such.
        task: by name or as such; it must have a tolerance for the position.
        timing: control period, and length of the episode.
        deadline: time of arrival after `reset`, s; None: what the task has planned
            (`rans.tasks.base.Task.arrival`), or 0.4 of the episode.
        stop: whether to arrive at the goal's velocity; without, there is no second burn. None: unless the
            task is a mission that is over once it is won (`rans.tasks.base.Task.done`) and asks for no braking
            (`rans_missions.tasks.orbital.OrbitalMission.brakes`).
        deadband: when to leave all thrusters shut.

    Raises:
        ConfigError: the task has no place to go to, the thrusters cannot push the spacecraft in every
            direction or cannot turn it as the task asks, or the deadline is no finite number > 0.
    """

    name = "guidance"
    tunable: ClassVar = {**Deadband.tunable}
    """Bounds for `rans tune`."""

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        deadline: float | None = None,
        stop: bool | None = None,
        deadband: Deadband = _DEADBAND,
    ) -> None:
        super().__init__(craft, task, timing)
        if "position" not in self._task.tolerances():
            raise ConfigError(
                f"guidance flies to places, and {type(self._task).__name__} has no tolerance for the "
                "position; fly LQR, MPC or switching."
            )
        craft = self._craft
        period = self._timing.control_period
        self._planned = deadline is None
        if deadline is None:
            deadline = _DEFAULT_SHARE * period * self._timing.episode_steps
        if not (is_finite(deadline) and deadline > 0):
            raise ConfigError(f"guidance: deadline must be finite and > 0 s, got {deadline!r}.")
        self._deadline = max(1, round(deadline / period))
        lasts = type(self._task).done is Task.done
        self._stop = (lasts or getattr(self._task, "brakes", False)) if stop is None else stop
        self._deadband = checked("deadband", deadband, Deadband)
        self._identity = Heading(0.0) if craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._allocation = Allocation(craft)
        self._inertia = inertia(craft)
        self._rotation = Regulator.of(craft, self._task, self._timing, Weights()).rotation
        # A velocity that was not given is wanted anew; an angle that is held adds up to pulses.
        integrated = np.zeros(craft.degrees_of_freedom, bool)
        integrated[craft.dimension :] = self._rotation.price[0] > 0
        self._rounding = rounding(craft, period, integrated)
        self._afterwards = self._task.afterwards(craft, self._timing)
        self._motions: dict[int, LinearMotion] = {}
        self._flown = 0

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; the time to the deadline begins anew."""
        self._rounding.reset(count)
        self._flown = 0
        if self._afterwards is not None:
            self._afterwards.reset(count)

    def memory(self) -> np.ndarray:
        """What is owed to every episode and the periods flown, (N, 4 or 7); see `recall`."""
        debt = self._rounding.owed
        return np.column_stack([debt, np.full(len(debt), self._flown)])

    def recall(self, memory: np.ndarray) -> None:
        """Go on from a `memory`, of as many episodes as it has, all as far on their way."""
        self._rounding.owed = memory[:, :-1]
        self._flown = int(memory[0, -1]) if len(memory) else 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from the state, not the observation; counts periods, and remembers what rounding owes.

        One call a control period: called twice, it would believe a period gone and owe two roundings.
        """
        period = self._timing.control_period
        if self._afterwards is not None:
            goal = self._afterwards.goal(state, goal, exact=not self._stop)
        rest = self._deadband.holds(self._craft, self._task, state, goal, period=period)
        commands = self._rounding.round(self.wrench(state, goal), rest, state.stores)
        if self._afterwards is not None:
            commands = self._afterwards.commands(state, goal, commands)
        self._flown += 1
        return commands

    def wrench(self, state: Any, goal: Any) -> np.ndarray:
        """Force and torque on B that are wanted now, (N, 3 or 6), N and N m; see the class."""
        forces = self._forces(state, self._burn(state, goal))
        turn = -rotation_vector(state.attitude.to(goal.attitude))
        spin = np.array(state.spin()) - np.array(goal.spin())
        spin_up = self._rotation.acceleration(turn, spin)
        forces[:, self._craft.dimension :] = (self._inertia @ spin_up).T
        return forces

    def _burn(self, state: Any, goal: Any) -> np.ndarray:
        """Acceleration in W of the burn that begins now, (d, N) m/s^2, each episode by its own planned arrival."""
        planned = self._task.arrival(goal) if self._planned else None
        if planned is None:
            return self._burn_by(self._deadline - self._flown, state, goal)
        # Episodes whose plans are as many control periods away burn together.
        whole = np.round(np.asarray(planned) / self._timing.control_period).astype(int)
        left = np.broadcast_to(whole, np.shape(state.p.x))
        burns = np.zeros((self._craft.dimension, len(left)))
        for periods in np.unique(left):
            these = left == periods
            chosen = partial(_of, these)
            burns[:, these] = self._burn_by(
                int(periods), map_leaves(chosen, state), map_leaves(chosen, goal)
            )
        return burns

    def _burn_by(self, left: int, state: Any, goal: Any) -> np.ndarray:
        """As `_burn` for episodes that should arrive after so many periods, or later where thrust is too weak.

        Burns and arrivals are tried from the shortest and soonest on, and the first that thrust suffices for
        counts.

        Episodes for which none suffices keep the last that was tried.
        """
        state_now = np.array([*leaves(state.p), *leaves(state.v)])
        first = np.zeros((self._craft.dimension, state_now.shape[1]))
        open_ = np.ones(state_now.shape[1], dtype=bool)
        for periods in self._arrivals(left):
            goal_then = self._task.later(goal, periods * self._timing.control_period)
            whole = self._motion(periods)
            missing = np.array([*leaves(goal_then.p), *leaves(goal_then.v)]) - whole.offset[:, None]
            missing = missing - whole.matrix @ state_now
            for burns in self._burn_lengths(periods):
                # Episodes that no shorter burns and no sooner arrival suffice for take these.
                ours, last = self._solved(periods, burns, missing[:, open_])
                first[:, open_] = ours
                load = np.maximum(*(self._load(state, burn, open_) for burn in (ours, last)))
                open_[np.flatnonzero(open_)[load <= _FULL]] = False
                if not open_.any():
                    return first
        return first

    def _arrivals(self, left: int) -> list[int]:
        """Whole periods until arrivals that are tried, the soonest first: the deadline, then later ones."""
        soonest = max(left, 2 if self._stop else 1)
        grown = itertools.accumulate(
            range(_ATTEMPTS - 1), lambda k, _: max(k + 1, math.ceil(k * _LATER)), initial=soonest
        )
        return list(grown)

    def _burn_lengths(self, periods: int) -> list[tuple[int, int]]:
        """Pairs of lengths of the first and the last burn, control periods, the shortest together first."""
        if not self._stop:
            return [(first, 0) for first in _BURNS if first <= periods]
        pairs = itertools.product(_BURNS, _BURNS)
        return sorted((pair for pair in pairs if sum(pair) <= periods), key=sum)

    def _solved(
        self, periods: int, burns: tuple[int, int], missing: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations of the first and the last burn, (d, M), that make up for (2 d, M) at the arrival."""
        first, last = burns
        by_first = self._motion(periods - first).matrix @ self._motion(first).effect
        size = self._craft.dimension
        if not last:  # the position alone
            ours = np.linalg.solve(by_first[:size], missing[:size])
            return ours, np.zeros_like(ours)
        both = np.linalg.solve(np.hstack([by_first, self._motion(last).effect]), missing)
        return both[:size], both[size:]

    def _load(self, state: Any, push: np.ndarray, which: np.ndarray) -> np.ndarray:
        """(M,) accelerations (d, M) as shares of what the thrusters give with the attitude of now."""
        everybody = np.zeros((len(push), len(which)))
        everybody[:, which] = push
        return self._allocation.load(self._forces(state, everybody)[which])

    def _forces(self, state: Any, push: np.ndarray) -> np.ndarray:
        """(N, 3 or 6) wrenches on B that give accelerations (d, N) in W."""
        force = type(state.p)(*(self._craft.mass * push))
        in_body = np.array(leaves(state.attitude.to(self._identity).rotate(force)))
        return np.pad(in_body.T, ((0, 0), (0, self._craft.degrees_of_freedom - len(push))))

    def _motion(self, periods: int) -> LinearMotion:
        """Motion of a free point for whole control periods."""
        if periods not in self._motions:
            time = periods * self._timing.control_period
            self._motions[periods] = LinearMotion.of(self._task.drift, self._craft.dimension, time)
        return self._motions[periods]


def _of(these: np.ndarray, x: Any) -> Any:
    """A field of some episodes only."""
    return x[these] if np.shape(x) else x
