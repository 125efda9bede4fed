"""Actions and sizes that an engine does not take are refused in a sentence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.tasks import GoToPose
from rans.tasks.derived import check_dimension
from rans.tasks.inspect import Inspect
from tests.support.engines import PLATFORM
from tests.support.training import CONFIG

SHUT = torch.zeros(2, 8)


@pytest.mark.parametrize(
    ("actions", "said"),
    [
        (SHUT.to(torch.complex64), "dtype complex64"),
        (SHUT.to_sparse(), "layout sparse_coo"),
        (SHUT.to("meta"), "device meta"),
        (SHUT.clone().requires_grad_(), "must not require gradients"),
    ],
)
def test_odd_actions(actions: Any, said: str) -> None:
    for engine in (Engine(PLATFORM, GoToPose(), 2), Engine(PLATFORM, GoToPose(), 2, plain=True)):
        with pytest.raises(ConfigError, match=said):
            engine.step(actions)
    engine.step(SHUT)
    with torch.no_grad():
        engine.step(SHUT.clone().requires_grad_())


def test_a_mission_of_space_in_the_plane() -> None:
    with pytest.raises(ConfigError, match="Inspect works in space only") as error:
        check_dimension(Inspect(), 2)
    assert "zip" not in str(error.value)


@pytest.mark.parametrize("seed", [True, 1.5, -1, 2**32])
def test_a_seed_is_a_whole_number(seed: Any) -> None:
    with pytest.raises(ConfigError, match="seed must be a whole number"):
        replace(CONFIG, seed=seed)


def test_sizes_that_would_fill_the_memory() -> None:
    with pytest.raises(ConfigError, match="n_envs must be at most"):
        PPOSettings(n_envs=2_000_000_000)
    with pytest.raises(ConfigError, match="GB of memory"):
        PPOSettings(n_envs=2**20, n_steps=2**10)
    with pytest.raises(ConfigError, match="number of environments must be at most"):
        Engine(PLATFORM, GoToPose(), 2_000_000_000)
