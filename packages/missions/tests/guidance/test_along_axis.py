"""Flight along axes that turn, judged by the matrix exponential of the equations of motion."""

from __future__ import annotations

import numpy as np
from rans_missions.guidance.along_axis import AlongAxis
from scipy.spatial.transform import Rotation

from tests.support.clohessy_wiltshire import transition

N = 0.0011
PERIOD = 5.0


def test_craft_come_down_axes_that_turn_as_stars_do_and_the_other_way() -> None:
    """From 60 m and beside the axis; a thrust of 0.02 m/s^2 along each axis of W is enough."""
    spins = np.array([[0.0, 0.0, -N], [0.0, 0.0, N], [0.0, -N, 0.0], [0.0, 0.0, 0.0]])
    first = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [0.0, 0.0, 1.0]])

    def line(now: float, later: float) -> tuple[np.ndarray, np.ndarray]:
        axis = Rotation.from_rotvec(spins * (now + later)).apply(first)
        return 2.0 * axis, axis

    law = AlongAxis(N, PERIOD)
    states = np.concatenate([60.0 * first + [3.0, 2.0, -1.0], np.zeros((4, 3))], axis=1)
    step = transition(N, PERIOD)
    beside = []
    for k in range(300):
        now = k * PERIOD
        # The period is over when the next change is asked for.
        change = law.change(
            states,
            lambda later, now=now: line(now, later),
            lambda far: np.minimum(0.05 + 0.0025 * far, 0.2),
            nearest=0.0,
        )
        assert np.abs(change).max() < 0.02 * PERIOD
        states = np.concatenate([states, change / PERIOD], axis=1) @ step.T[:, :6]
        origin, axis = line(now + PERIOD, 0.0)
        away = states[:, :3] - origin
        beside.append(np.linalg.norm(away - (away * axis).sum(axis=1)[:, None] * axis, axis=1))
    # From 3.7 m beside the axis it is there after some of the law's time constants, of half a minute. As it moves
    # along an axis that turns, one thrust a period leaves 2 cm; at the end it is nearer.
    assert np.max(beside[60:]) < 0.03
    origin, axis = line(300 * PERIOD, 0.0)
    np.testing.assert_allclose(states[:, :3], origin, atol=0.005)
    np.testing.assert_allclose(states[:, 3:], np.cross(spins, origin), atol=1e-4)
