"""Every shipped agent flies as it did when its commands were recorded."""

from __future__ import annotations

import numpy as np
import pytest

from rans.pretrained import pretrained_names
from tests.recorded import EPISODES, flown, recorded


@pytest.mark.parametrize("name", pretrained_names())
def test_a_shipped_agent_gives_the_recorded_commands(name: str) -> None:
    before, now = recorded(name), flown(name).commands
    assert now.shape == before.shape
    departed = [k for k in range(EPISODES) if not np.array_equal(now[:, k], before[:, k])]
    assert departed == []
