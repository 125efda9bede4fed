"""Optimal trajectories and certificates from states of one's own."""

import numpy as np
import pytest

import rans
from rans import ConfigError


def test_a_goal_of_ones_own():
    found = rans.optimal_trajectory(
        start=rans.state((0.0, 0.0)), goal=rans.state((0.5, 0.0), attitude=1.0), horizon=8.0
    )
    np.testing.assert_allclose(found.x[-1, :3], (0.5, 0.0, 1.0), atol=1e-6)


def test_an_export_to_nowhere():
    with pytest.raises(ConfigError, match="a folder, unless it is a name or a file"):
        rans.export("go-to-pose-2d", 3, "numpy")  # type: ignore[arg-type]
