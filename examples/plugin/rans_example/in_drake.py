"""The drift and the effector once more for Drake, which judges agents: in Drake's words, without our equations."""

from typing import Any

import numpy as np

from rans.extend import DrakeEffector, DrakeFrame, Pushing


class BowlInDrake(DrakeFrame):
    """W does not turn, and pulls towards its origin in proportion to the distance."""

    def angle(self, drift: Any) -> float:
        """0: the pull is the same at all times."""
        return 0.0

    def motion(self, angles: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rate (N, 3) of W and its change, none, and the gradient of the pull, (N, 3, 3) 1/s^2."""
        still = np.zeros((len(angles), 3))
        pull = -(self.orbit.frequency**2) * np.eye(3)
        return still, still, np.broadcast_to(pull, (len(angles), 3, 3))


class TorquerInDrake(DrakeEffector):
    """A pure torque, which acts wherever it is."""

    def __init__(self, torquer: Any) -> None:
        self._torquer = torquer

    def places(self) -> list[Pushing]:
        """One, with a torque about its axis and no force."""
        return [Pushing((0.3, -0.2, 0.1), self._torquer.axis, 0.0, self._torquer.torque)]

    def values(self, commands: np.ndarray, stores: np.ndarray, duration: float) -> np.ndarray:
        """Share of the torque, (N, 1)."""
        most = stores / duration if np.isfinite(duration) else 1.0
        return np.clip(commands, -most, most)

    def stores_after(
        self, commands: np.ndarray, stores: np.ndarray, duration: float, time: float
    ) -> np.ndarray:
        """Charge (N, 1) a time (s) after the period began."""
        return stores - np.abs(self.values(commands, stores, duration)) * time
