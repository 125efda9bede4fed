"""The oracle of filters itself."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from tests.support.state_filter import corrected, gains


def test_gains_become_those_of_the_algebraic_riccati_equation() -> None:
    drift = 0.01
    h = 0.2
    moves = np.array([[1.0, h], [0.0, 1.0]])
    wander = np.diag([drift * (0.5 * h) ** 2, drift])
    doubt = solve_discrete_are(moves.T, np.eye(2), wander, np.eye(2))
    expected = doubt @ np.linalg.inv(doubt + np.eye(2))
    np.testing.assert_allclose(gains(h, drift)[-1], expected, atol=1e-9)


def test_without_wandering_a_reading_counts_as_all_before_it() -> None:
    """Of velocities alone the k-th estimate is the mean of k readings; positions tell more of them yet."""
    found = gains(1e-9, 0.0, 50)[:, 1, 1]
    np.testing.assert_allclose(found, 1.0 / np.arange(1, 51), rtol=1e-6)


def test_attitudes_are_corrected_along_the_shortest_turn() -> None:
    """Half of a turn of 0.2 rad, told as either of the quaternions that mean it."""

    def state(attitude: Quat) -> SpatialState:
        none = Vec3(*np.zeros((3, 1)))
        return SpatialState(p=none, attitude=attitude, v=none, w=none)

    def quat(turn: Rotation, sign: float = 1.0) -> Quat:
        x, y, z, w = sign * turn.as_quat()
        return Quat(*(np.array([part]) for part in (w, x, y, z)))

    first = Rotation.from_rotvec([0.3, -0.2, 0.5])
    turn = Rotation.from_rotvec([0.0, 0.2, 0.0])
    for sign in (1.0, -1.0):
        found = corrected(
            state(quat(first)), state(quat(first * turn, sign)), np.diag([0.5, 0.5])
        ).attitude
        reached = Rotation.from_quat(
            [float(part[0]) for part in (found.x, found.y, found.z, found.w)]
        )
        # Half of the vector part is half of the angle but for a hundredth of it.
        np.testing.assert_allclose((first.inv() * reached).as_rotvec(), [0.0, 0.1, 0.0], atol=1e-3)
