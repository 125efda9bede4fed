"""What tests of assurances share."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rans.episode.step import Setup
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.contestants import contestant
from rans.randomization.conditions_file import load_conditions


@pytest.fixture(scope="module")
def robust() -> LoadedRun:
    """An agent that flies in the laboratory."""
    return contestant("pretrained:go-to-pose-2d-robust")


@pytest.fixture(scope="module")
def setup(robust) -> Setup:
    """In the laboratory, for 20 steps."""
    timing = replace(robust.judged.timing, episode_steps=20)
    return robust.judged._replace(timing=timing, conditions=load_conditions("lab"))
