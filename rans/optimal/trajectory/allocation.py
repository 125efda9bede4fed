"""From a wanted wrench to commands between 0 and 1."""

from __future__ import annotations

import numpy as np

from rans.errors import ConfigError
from rans.model.spacecraft import Spacecraft, controls_every_direction

_STEPS = 100
"""Newton steps at most. Opposed pairs of equal thrusters need none, random layouts about ten; where
thrusters are so nearly dependent that this does not suffice the wrench is met approximately."""

_EXACT = 1e-9
"""Part of a wrench that may be missing."""


class Allocation:
    """The smallest non-negative thruster commands that together give a wrench.

    Minimises sum u_i^2 subject to B u = wrench and u >= 0, where column i of B is the wrench of
    thruster i fully on. By the Karush-Kuhn-Tucker conditions u = max(0, B^T y), where y maximises the
    concave dual y . wrench - |max(0, B^T y)|^2 / 2: a damped Newton method finds it for all episodes
    at once. For opposed pairs its first guess is exact: the pseudoinverse, of which each pair's
    positive part goes to one thruster and the negative part to the other.

    Raises:
        ConfigError: the thrusters cannot push and turn it in every direction.
    """

    def __init__(self, craft: Spacecraft) -> None:
        if not controls_every_direction(craft):
            raise ConfigError(
                f"spacecraft {craft.name!r} cannot be steered: its {len(craft.thrusters)} thrusters do "
                "not push and turn it in every direction; the usual cause is a missing or reversed "
                "thruster.")
        columns = np.array(craft.wrench_map).T
        self._size = np.abs(columns).max(axis=1)
        self._columns = columns / self._size[:, None]
        self._dimension = craft.dimension
        self._shared = craft.thrust_sharing == "split"

    def commands(self, wrench: np.ndarray) -> np.ndarray:
        """Commands that give the wrench, or as great a share of it as the thrusters can.

        The wrench is (N, 3 or 6), force then torque on B, N and N m; commands are (N, thrusters), 0 to 1.
        Where thrust is shared, so is their sum.
        """
        command = self._unbounded(wrench / self._size)
        return command / np.maximum(self._load(command), 1.0)[:, None]

    def load(self, wrench: np.ndarray) -> np.ndarray:
        """(N,) how many times as much the wrench, (N, 3 or 6), is as the thrusters can give."""
        return self._load(self._unbounded(wrench / self._size))

    def authority(self) -> tuple[float, float]:
        """Force (N) and torque (N m) that can be given along every axis of B, in both senses."""
        axes = np.diag(self._size)
        load = self._load(self._unbounded(np.vstack([axes, -axes]) / self._size))
        reach = (np.tile(self._size, 2) / load).reshape(2, -1).min(axis=0)
        return float(reach[:self._dimension].min()), float(reach[self._dimension:].min())

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

    def _damping(self, wrench: np.ndarray, dual: np.ndarray, step: np.ndarray,
                 gradient: np.ndarray) -> np.ndarray:
        """(N,) largest powers of a half at which the dual function rises enough (Armijo's rule)."""
        before, slope = self._value(wrench, dual), 1e-4 * (step * gradient).sum(axis=1)
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
