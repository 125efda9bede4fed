"""The table of iterations."""

from __future__ import annotations

from dataclasses import replace

import pytest

from campaigns.speed import iteration as module
from campaigns.speed.iteration import Iteration, iteration, table
from rans.fast.learn.fused_gradient import MatrixGradient
from rans.fast.learn.recipes import recipe
from validation.speed.measurement import Clock


@pytest.mark.parametrize(
    ("with_backend", "way"), [(True, "products of matrices"), (False, "autograd")]
)
def test_an_update_is_what_a_rollout_leaves_of_an_iteration(
    with_backend: bool, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """16 environments x 8 steps in 8 ms, 5 of them the rollout's; a CPU is given what a GPU would have."""
    config = recipe("go-to-pose-2d-robust", "cpu")
    config = replace(config, ppo=replace(config.ppo, n_envs=16, n_steps=8, batch_size=64))
    monkeypatch.setattr(module.FusedGradient, "made", lambda *given: MatrixGradient(*given[:3]))
    took = iter((0.008, 0.005))
    monkeypatch.setattr(Clock, "time", lambda _, function: (next(took), function()))
    found = iteration(config, Clock("cpu"), with_backend)
    assert found.backend == way
    assert found[1:] == pytest.approx((5.0, 3.0, 16 * 8 / 0.008 / 1e6))


def test_a_row_an_iteration() -> None:
    rows = table([Iteration("autograd", 5.214, 9.49, 17.83)]).splitlines()
    assert rows[2] == "| autograd | 5.21 | 9.49 | 17.8 |"
