"""Forces and torques that stay put in the world."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.model.body import Body
from rans.model.dynamics import SpatialState, Wrench, advance
from rans.model.fields import Quat, Vec3, leaves
from tests.support.crafts import nasty_spatial

BALL = Body(5.0, (0.2, 0.0, 0.0, 0.2, 0.0, 0.2))


@pytest.mark.parametrize("swell", [None, (1.2, 2.0)], ids=["", "lighter"])
@pytest.mark.parametrize("grown", [1.0, 2.5], ids=["steady", "growing"])
@pytest.mark.parametrize("body", [Body.of(nasty_spatial()), BALL], ids=["uneven", "ball"])
def test_a_push_and_a_torque_stay_put_in_the_world_whatever_the_attitude(
    body: Body, grown: float, swell: tuple[float, float] | None
) -> None:
    """In space, beside a thrust that turns with the craft and grows, against SciPy's integrator.

    The start is half a radian from W's axes, and neither its axis nor those of the moments are W's.
    Sixteen substeps of order six leave less than 1e-10 of 0.2 s at some 0.5 rad/s.
    """
    tensor = np.array(body.inertia)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    mass = body.mass
    start = Rotation.from_rotvec([0.3, -0.2, 0.4])
    thrust = np.array([0.5, -0.3, 0.8])
    torque = np.array([0.02, 0.05, -0.03])
    push = np.array([-0.4, 0.6, 0.1])
    steady = np.array([-0.06, 0.01, 0.04])
    low, high = swell or (1.0, 1.0)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        w = y[6:9]
        matrix = y[9:].reshape(3, 3)
        share = 1.0 + (grown - 1.0) * t / 0.2
        factor = low + (high - low) * t / 0.2
        turning = np.linalg.solve(
            tensor, share * torque + factor * matrix.T @ steady - np.cross(w, tensor @ w)
        )
        turned = matrix @ np.cross(w, np.eye(3)).T
        return np.concatenate(
            [y[3:6], (matrix @ thrust * share + factor * push) / mass, turning, turned.ravel()]
        )

    first = np.concatenate([np.zeros(6), [0.3, -0.2, 0.4], start.as_matrix().ravel()])
    end = solve_ivp(slope, (0.0, 0.2), first, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    x, y, z, w = (float(part) for part in start.as_quat())
    zero = Vec3(0.0, 0.0, 0.0)
    after = advance(
        SpatialState(zero, Quat(w, x, y, z), zero, Vec3(0.3, -0.2, 0.4)),
        Wrench(Vec3(*thrust), Vec3(*torque)),
        body,
        0.2,
        16,
        disturbance=Wrench(Vec3(*push), Vec3(*steady)),
        last=None if grown == 1.0 else Wrench(Vec3(*grown * thrust), Vec3(*grown * torque)),
        growth=swell,
    )
    assert (*leaves(after.p), *leaves(after.v), *leaves(after.w)) == pytest.approx(
        end[:9], abs=1e-10
    )
    w, x, y, z = leaves(after.attitude)
    matrix = Rotation.from_quat([x, y, z, w]).as_matrix()
    np.testing.assert_allclose(matrix.ravel(), end[9:], rtol=0, atol=1e-10)
