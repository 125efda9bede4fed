"""What refining a mesh says about the error of an optimum's cost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rans.errors import ConfigError
from rans.evaluation.compare.refinement import (
    MOST_HALVINGS,
    Mesh,
    refined_objectives,
    remaining_errors,
)


def meshes(*costs: float) -> list[Mesh]:
    nothing = np.zeros(1)
    return [Mesh(2**k, np.array([cost]), nothing, 0.0) for k, cost in enumerate(costs)]


@given(st.floats(1.0, 10.0), st.floats(0.1, 1.0), st.floats(0.05, 0.6))
def test_the_rest_of_a_geometric_series_is_found(limit: float, first: float, ratio: float) -> None:
    """Costs limit + first ratio^k are off by first ratio^k: the estimate is exact from the third mesh on."""
    costs = [limit + first * ratio**k for k in range(4)]
    errors = remaining_errors(meshes(*costs))
    np.testing.assert_allclose(errors[1:, 0], [first * ratio**2, first * ratio**3], rtol=1e-6)


def test_a_cost_that_does_not_settle_keeps_its_change_as_error() -> None:
    """Changes 0.1, 0.2: no series that ends."""
    errors = remaining_errors(meshes(1.0, 1.1, 0.9))
    assert errors[:, 0] == pytest.approx([0.1, 0.2])


def test_equal_costs_have_no_error() -> None:
    assert remaining_errors(meshes(2.0, 1.9, 1.9))[1, 0] == 0.0


def test_every_mesh_covers_the_same_time() -> None:
    coarse, fine = refined_objectives("fuel", 1, 10.0, 0.5, "exact", 50)
    assert (coarse.intervals, fine.intervals) == (20, 40)
    coarse, fine = refined_objectives("time", 1, None, 0.5, "exact", 50)
    assert (coarse.intervals, fine.intervals) == (50, 100)


@pytest.mark.parametrize("halvings", [0, -1, MOST_HALVINGS + 1])
def test_halvings_are_few(halvings: int) -> None:
    with pytest.raises(ConfigError, match="1 to 4 times"):
        refined_objectives("fuel", halvings, 10.0, 0.5, "exact", 50)
