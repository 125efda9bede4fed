"""The shipped agents as parameters of tests: one of each kind by default, the others among the slow tests."""

from __future__ import annotations

from typing import Any

import pytest

from rans.base.pretrained import pretrained_names

ONE_OF_EACH_KIND = {
    "avoid-2d",  # constraints, and an observation of zones
    "dock-port-2d",  # an episode that ends in success
    "go-to-pose-2d",
    "go-to-pose-2d-trade-off",  # an input that chooses between time and impulse
    "go-to-pose-3d-faults",  # a history, in space
    "land-3d",  # throttles
    "multi-task-2d",
    "track-velocity-2d",
}


def shipped_agents() -> list[Any]:
    """Names of all shipped agents, for ``parametrize`` or a fixture."""
    names = pretrained_names()
    assert set(names) >= ONE_OF_EACH_KIND
    return [
        pytest.param(
            name,
            marks=[] if name in ONE_OF_EACH_KIND else [pytest.mark.slow],
        )
        for name in names
    ]
