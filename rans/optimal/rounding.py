"""From a wanted wrench to thrusters that are open or shut."""

from __future__ import annotations

import numpy as np

from rans.optimal.allocation import Allocation
from rans.spacecraft import Spacecraft


class SigmaDelta:
    """Opens the thrusters that best pay what is owed, and carries the rest to the next period.

    Sigma-delta modulation of the wrench as a vector: what rounding gave too much or too little is
    carried on, so that over any time the impulse is the wanted one to within a few pulses. What is left
    over is weighed by the kinetic energy it is worth. Carrying it for every thruster by itself (sum-up
    rounding: Sager, J. Process Control 19, 2009) lets several thrusters turn the spacecraft in the same
    period without need; the platform then rests three times less quietly.

    Args:
        craft: what flies; where its thrust is shared at most one thruster is opened, as opening more
            gives no more.
    """

    def __init__(self, craft: Spacecraft) -> None:
        self._wrenches = np.array(craft.wrench_map)
        inertia = np.array(craft.inertia if craft.dimension == 3 else [[craft.inertia[2][2]]])
        self._metric = np.zeros((craft.degrees_of_freedom,) * 2)
        self._metric[:craft.dimension, :craft.dimension] = np.eye(craft.dimension) / craft.mass
        self._metric[craft.dimension:, craft.dimension:] = np.linalg.inv(inertia)
        self._prices = np.einsum("ti,ij,tj->t", self._wrenches, self._metric, self._wrenches)
        self._shared, self._allocation = craft.thrust_sharing == "split", Allocation(craft)
        self._owed = np.zeros((0, craft.degrees_of_freedom))

    def reset(self, count: int) -> None:
        """Forget what is owed: ``count`` new episodes start."""
        self._owed = np.zeros((count, self._owed.shape[1]))

    def round(self, wrench: np.ndarray) -> np.ndarray:
        """Open (1.0) or shut (0.0) for every episode.

        Starts with the thrusters of which the allocation asks for half or more, then opens or shuts one
        after the other as long as that brings the impulse closer, best first.

        Args:
            wrench: (N, 3 or 6), force then torque on B, within the thrusters' reach.

        Returns:
            (N, thrusters).
        """
        owed, episodes = self._owed + wrench, np.arange(len(wrench))
        pulse = np.zeros((len(wrench), len(self._wrenches)))
        if not self._shared:
            pulse = (self._allocation.commands(owed) >= 0.5).astype(float)
        for _ in range(1 if self._shared else len(self._wrenches)):
            left = owed - pulse @ self._wrenches
            gain = (2.0 - 4.0 * pulse) * (left @ self._metric @ self._wrenches.T) - self._prices
            best = gain.argmax(axis=1)
            worth = gain[episodes, best] > 0
            if not worth.any():
                break
            pulse[episodes[worth], best[worth]] = 1.0 - pulse[episodes[worth], best[worth]]
        self._owed = owed - pulse @ self._wrenches
        return pulse
