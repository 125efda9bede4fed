"""From a wanted wrench to thrusters that are open or shut."""

from __future__ import annotations

import numpy as np

from rans.spacecraft import Spacecraft


class SigmaDelta:
    """Opens the thrusters that best pay what is owed, and carries the rest to the next period.

    Sigma-delta modulation of the wrench as a vector: what rounding gave too much or too little is
    carried on, so that over any time the impulse is the wanted one to within a few pulses. What is
    left over is weighed by the kinetic energy it is worth. Carrying it for every thruster by
    itself (sum-up rounding: Sager, J. Process Control 19, 2009) lets several thrusters turn the
    spacecraft in the same period without need: it rests three times less quietly.

    Args:
        craft: what flies; where its thrust is shared one thruster is opened at a time, as opening
            more gives no more.
    """

    def __init__(self, craft: Spacecraft) -> None:
        self._wrenches = np.array(craft.wrench_map)
        inertia = np.array(craft.inertia if craft.dimension == 3 else [[craft.inertia[2][2]]])
        self._metric = np.zeros((craft.degrees_of_freedom,) * 2)
        self._metric[:craft.dimension, :craft.dimension] = np.eye(craft.dimension) / craft.mass
        self._metric[craft.dimension:, craft.dimension:] = np.linalg.inv(inertia)
        self._prices = np.einsum("ti,ij,tj->t", self._wrenches, self._metric, self._wrenches)
        self._at_once = 1 if craft.thrust_sharing == "split" else len(self._wrenches)
        self._owed = np.zeros((0, craft.degrees_of_freedom))

    def reset(self, count: int) -> None:
        """Forget what is owed: ``count`` new episodes start."""
        self._owed = np.zeros((count, self._owed.shape[1]))

    def round(self, wrench: np.ndarray) -> np.ndarray:
        """Open (1.0) or shut (0.0) for every episode: one thruster after the other, best first.

        Args:
            wrench: (N, 3 or 6), force then torque on B, within the thrusters' reach.

        Returns:
            (N, thrusters).
        """
        owed, episodes = self._owed + wrench, np.arange(len(wrench))
        pulse = np.zeros((len(wrench), len(self._wrenches)))
        for _ in range(self._at_once):
            gain = 2.0 * owed @ self._metric @ self._wrenches.T - self._prices
            gain[pulse > 0] = -np.inf
            best = gain.argmax(axis=1)
            worth = gain[episodes, best] > 0
            if not worth.any():
                break
            pulse[episodes[worth], best[worth]] = 1.0
            owed = self._owed + wrench - pulse @ self._wrenches
        self._owed = owed
        return pulse
