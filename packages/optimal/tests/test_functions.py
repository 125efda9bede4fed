"""Optimal trajectories and certificates from states of one's own."""

import numpy as np
import pytest

import rans
from rans import ConfigError


@pytest.mark.slow
def test_the_figure_of_an_optimum_draws_its_zones_from_the_goal():
    """A ball of 0.3 m at (-1, 1) is 2 m behind a goal at (1, 1)."""
    found = rans.optimal_trajectory(
        objective="time",
        start=rans.state((-3.0, 1.0)),
        goal=rans.state((1.0, 1.0)),
        zones=[(-1.0, 1.0, 0.3)],
        guesses=1,
        intervals=20,
    )
    lines = [np.asarray(line.get_xydata()) for line in found.plot().axes[0].lines]
    radii = [np.linalg.norm(line - (-2.0, 0.0), axis=1) for line in lines if len(line) > 2]
    assert any(np.allclose(radius, 0.3) for radius in radii)


def test_a_goal_of_ones_own():
    found = rans.optimal_trajectory(
        start=rans.state((0.0, 0.0)), goal=rans.state((0.5, 0.0), attitude=1.0), horizon=8.0
    )
    np.testing.assert_allclose(found.x[-1, :3], (0.5, 0.0, 1.0), atol=1e-6)


def test_an_export_to_nowhere():
    with pytest.raises(ConfigError, match="output, unless it is a name or a file"):
        rans.export("go-to-pose-2d", 3, "numpy")  # type: ignore[arg-type]
