"""The camera sees all that it must, and stands no farther than that takes: by Drake's own camera matrix."""

# Drake's stubs write NumPy's array types with their two parameters exchanged.

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from rans.show.scene.camera import fitted_camera

places = arrays(float, st.tuples(st.integers(2, 30), st.just(3)), elements=st.floats(-50.0, 50.0))


@given(
    points=places,
    direction=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, -0.2), st.floats(-1.0, 1.0)),
    upright=st.floats(0.3, 1.5),
    aspect=st.floats(0.4, 2.5),
)
@settings(max_examples=60)
def test_everything_is_in_the_picture_and_touches_its_edge(
    points: np.ndarray, direction: tuple[float, float, float], upright: float, aspect: float
) -> None:
    points[0] += 1.0  # all in one place have no size
    camera = fitted_camera(points, direction, upright, aspect)
    height = 1000
    width = round(aspect * height)
    back = camera.position - camera.target
    assert np.cross(back, direction) @ np.ones(3) < 1e-6 * np.linalg.norm(back)
    R_WC = RotationMatrix(np.stack((camera.axes[0], -camera.axes[1], -camera.axes[2]), axis=1))
    seen = RigidTransform(R_WC, camera.position).inverse().multiply(points.T)
    x, y, depth = CameraInfo(width, height, upright).intrinsic_matrix() @ seen
    assert (depth > -1e-9).all()
    near = depth > 1e-6  # a point in the camera itself has no place in its picture
    u = x[near] / depth[near]
    v = y[near] / depth[near]
    # A pixel for the width that was rounded, and one for where Drake counts them from.
    assert u.min() > -2.0
    assert u.max() < width + 2.0
    assert v.min() > -2.0
    assert v.max() < height + 2.0
    if near.all():
        assert min(u.min(), width - u.max(), v.min(), height - v.max()) < 2.0
    assert math.isfinite(float(np.sum(camera.target)))
