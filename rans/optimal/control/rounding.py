"""From a wanted wrench to thrusters that are open or shut."""

from __future__ import annotations

import numpy as np

from rans.model.spacecraft import Spacecraft
from rans.optimal.trajectory.allocation import Allocation
from rans.optimal.trajectory.guess import inertia

_FLIPS = 20
"""Rounds of improvement at most; three are usual."""
_SATURATED = 0.99
"""Share of what the thrusters can give from which on a wrench counts as more than they can."""


class SigmaDelta:
    """Opens the thrusters that best pay what is owed, and carries the rest to the next period.

    Sigma-delta modulation of the wrench as a vector: what rounding gave too much or too little is
    carried on, so that over any time the impulse is the wanted one to within a few pulses. What is left
    over is weighed by the kinetic energy it is worth. Carrying it for every thruster by itself (sum-up
    rounding: Sager, J. Process Control 19, 2009) lets several thrusters turn the spacecraft in the same
    period without need.

    The rest is carried on along some components of the wrench, (3 or 6,) bool, by default all, even while all
    that is wanted is within reach.
    """

    def __init__(self, craft: Spacecraft, carried: np.ndarray | None = None) -> None:
        self._wrenches, self._allocation = np.array(craft.wrench_map), Allocation(craft)
        self._shared, size = craft.thrust_sharing == "split", craft.degrees_of_freedom
        metric = np.zeros((size, size))
        metric[:craft.dimension, :craft.dimension] = np.eye(craft.dimension) / craft.mass
        metric[craft.dimension:, craft.dimension:] = np.linalg.inv(inertia(craft))
        self._root = np.linalg.cholesky(metric)
        self._flips = _none_one_or_two(len(self._wrenches))
        self._carried = np.ones(size, bool) if carried is None else carried
        self._owed = np.zeros((0, size))

    def reset(self, count: int) -> None:
        """Forget what is owed: ``count`` new episodes start."""
        self._owed = np.zeros((count, self._owed.shape[1]))

    def round(self, wrench: np.ndarray, rest: np.ndarray | None = None) -> np.ndarray:
        """Open (1.0) or shut (0.0) for every episode.

        Starts with the thrusters of which the allocation asks for half or more, then opens or shuts one
        or two at a time as long as that brings the impulse closer, best first. Two at a time find pairs
        whose torques cancel: with one at a time the LQR tracks velocities with the free flyer from 39
        instead of 50 of 50 starts, and takes the platform with shared thrust to 29 of 50 positions.

        Of the wrench, (N, 3 or 6), force then torque on B, as much is owed as the thrusters can give; those
        that rest, (N,) bool, are owed nothing and keep all thrusters shut. Returns (N, thrusters).
        """
        rest = np.zeros(len(wrench), bool) if rest is None else rest
        load = self._allocation.load(wrench)
        within_reach = wrench / np.maximum(load, 1.0)[:, None]
        owed = np.where(rest[:, None], 0.0, self._owed + within_reach)
        pulse = (self._allocation.commands(owed) >= 0.5) & ~rest[:, None]
        open_to_change = np.flatnonzero(~rest)
        for _ in range(_FLIPS):
            if not len(open_to_change):
                break
            better, changed = self._improved(pulse[open_to_change], owed[open_to_change])
            pulse[open_to_change] = better
            open_to_change = open_to_change[changed]
        carried = self._carried | (load > _SATURATED)[:, None]
        self._owed = np.where(carried, owed - self._given(pulse), 0.0)
        return pulse.astype(float)

    def _improved(self, pulse: np.ndarray, owed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The best of all pulses that differ in at most two thrusters, and whether it is another one."""
        candidates = pulse[:, None] ^ self._flips
        left = (owed[:, None] - self._given(candidates)) @ self._root
        energy, episodes = (left * left).sum(axis=2), np.arange(len(pulse))
        best = energy.argmin(axis=1)
        # by more than rounding, or equal pulses would take turns
        return candidates[episodes, best], energy[episodes, best] < energy[:, 0] - 1e-12 * (1 + energy[:, 0])

    def _given(self, pulse: np.ndarray) -> np.ndarray:
        """(..., 3 or 6) the wrench of open thrusters, as `rans.model.dynamics.thrust` shares it."""
        opened = pulse.astype(float)
        if self._shared:
            opened /= np.maximum(opened.sum(axis=-1, keepdims=True), 1.0)
        return opened @ self._wrenches


def _none_one_or_two(count: int) -> np.ndarray:
    """(choices, count) bool: every way to choose at most two, none first."""
    one = np.eye(count, dtype=bool)
    pairs = [one[i] | one[j] for i in range(count) for j in range(i, count)]
    return np.array([np.zeros(count, bool), *pairs])
