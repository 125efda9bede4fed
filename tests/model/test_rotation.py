"""Rotations by series, against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.model.fields import Vec3, leaves
from rans.model.rotation import exponential, turned


@pytest.mark.parametrize(("angle", "error"), [(0.1, 1e-15), (1.0, 4e-8), (-1.0, 4e-8)])
def test_a_turn_is_that_of_scipy(angle, error):
    """What the series leave out at 1 rad is 1 / 11! of the sine, 1 / 12! of the cosine."""
    random = np.random.default_rng(1)
    axes = random.normal(size=(50, 3))
    axes *= angle / np.linalg.norm(axes, axis=1, keepdims=True)
    vectors = random.normal(size=(50, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    theirs = Rotation.from_rotvec(axes)
    found = np.transpose(turned(Vec3(*axes.T), Vec3(*vectors.T)).columns())
    np.testing.assert_allclose(found, theirs.apply(vectors), rtol=0, atol=error)
    quaternions = np.transpose(leaves(exponential(Vec3(*axes.T))))
    expected = theirs.as_quat(scalar_first=True)
    np.testing.assert_allclose(quaternions, expected, rtol=0, atol=error)
