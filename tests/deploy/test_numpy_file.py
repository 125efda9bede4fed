"""The agent.py of an export, in wrong hands."""

import numpy as np
import pytest

from tests.support.exports import exported, remembering, written


def test_the_exported_file_refuses_observations_of_another_shape(tmp_path):
    network, _, seen = remembering()
    written(tmp_path, network, "numpy")
    agent = exported(tmp_path)["Agent"]()
    rows = np.asarray(seen[0])[:3]
    assert agent.act(rows[0]).shape == (8,)
    with pytest.raises(ValueError, match=r"is 10 numbers, or \(N, 10\), got \(9,\)"):
        agent.act(rows[0, :9])
    with pytest.raises(ValueError, match=r"reset\(1\) began .* got observations \(3, 10\)"):
        agent.act(rows)
    agent.reset(3)
    assert agent.act(rows).shape == (3, 8)
