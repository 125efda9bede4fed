"""On/off thrusters that follow a flight of throttled ones: beginnings of the search over pulses."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np

from rans.extend import Flight, Spacecraft, Vec2, Vec3, coordinates, map_leaves


class Manner(NamedTuple):
    """How pulses follow a flight."""

    ahead: float
    """Time after which the position should be that of the flight, s."""
    turned: float
    """Time after which the attitude should be, s."""
    price: float
    """Price of a pulse, in squares of `_NEAR` or `_AIMED`."""


MANNERS = tuple(Manner(*one) for one in itertools.product((2.0, 4.0), (0.7, 1.5), (0.3, 1.0, 3.0)))
"""Manners of following that are tried from every start; none of them is the best from all starts."""
_NEAR = 0.05
"""Distance from the flight that costs 1, m."""
_AIMED = 0.09
"""Angle from the flight that costs 1, rad."""


class Following:
    """Controller that follows flights by pulses, of at most two thrusters in a control period.

    Each period it opens those thrusters with which a coast from there would be nearest to the flight a little
    later, less a price of each pulse. After the end of the flight it follows its last state.

    Args:
        craft: spacecraft with on/off thrusters.
        flight: flights of N starts.
        manner: how to follow.
    """

    name = "following"
    observes = False

    def __init__(self, craft: Spacecraft, flight: Flight, manner: Manner) -> None:
        self._states = flight.states
        self._last = len(flight.commands)
        self._manner = manner
        period = flight.timing.control_period
        wrenches = np.array(craft.wrenches)
        axes = craft.dimension
        turns = wrenches.shape[1] - axes
        inertia = np.diag(np.array(craft.inertia))[-turns:]
        self._speeds = wrenches[:, :axes] * (period / craft.mass)
        count = craft.thruster_count
        singles = np.eye(count)
        pairs = [singles[k] + singles[j] for k, j in itertools.combinations(range(count), 2)]
        self._choices = np.stack([np.zeros(count), *singles, *pairs])
        self._spins = self._choices @ (wrenches[:, axes:] * period / inertia)
        self._step = 0

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) of the patterns that bring the next states nearest to the planned ones.

        Counts periods.
        """
        step = min(self._step, self._last)
        self._step += 1
        planned = map_leaves(lambda x: x[step] if np.ndim(x) == 2 else x, self._states)
        away = np.stack(np.broadcast_arrays(*coordinates(state, planned)))
        axes = self._speeds.shape[1]
        turns = self._spins.shape[1]
        p, turn, v, spin = np.split(away, np.cumsum([axes, turns, axes]))
        # Change of velocity in W of every thruster, (thrusters, axes, N), and of every choice.
        vector = Vec2 if axes == 2 else Vec3
        turned = [state.attitude.rotate(vector(*map(float, one))) for one in self._speeds]
        changes = np.stack([np.stack(np.broadcast_arrays(*one.columns())) for one in turned])
        kicks = np.einsum("ck,kan->can", self._choices, changes)
        manner = self._manner
        misses = (p + manner.ahead * (v + kicks)) / _NEAR
        angles = (turn + manner.turned * (spin + self._spins[:, :, None])) / _AIMED
        value = np.square(misses).sum(axis=1) + np.square(angles).sum(axis=1)
        value += manner.price * self._choices.sum(axis=1)[:, None]
        return self._choices[value.argmin(axis=0)]
