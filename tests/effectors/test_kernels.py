"""Kernels of craft with wheels, propellant and throttle levels, compiled for a CPU."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rans.fast.engine import Engine
from rans.fast.flights import Flights
from rans.flight import Setup
from rans.model.accuracy import chosen
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.tasks import load_task
from tests.support.effector_crafts import CUBESAT, LANDER, commands
from tests.support.effector_flights import BOTH, task_of, untrained_policy
from tests.support.host_flight import HostFlights
from tests.support.host_kernels import (
    engine_on_host,  # noqa: F401  (a fixture)
    needs_compiler,
)
from tests.support.worlds import EFFECTS

pytestmark = needs_compiler
every_craft = pytest.mark.parametrize(
    "craft", [CUBESAT, LANDER, BOTH], ids=["cubesat", "lander", "both"]
)


@every_craft
def test_a_kernel_steps_as_numpy(craft: Spacecraft, on_host: Any) -> None:
    made: Any = (craft, task_of(craft), 16, Timing(episode_steps=5))
    how: Any = {"seed": 3, "dtype": torch.float64}
    ours = Engine(*made, **how)
    theirs = on_host(*made, **how)
    for k in range(7):
        action = torch.from_numpy(commands(craft, 16, seed=k))
        expected = ours.step(action)
        found = theirs.step(action)
        torch.testing.assert_close(found.observation, expected.observation, rtol=0, atol=1e-9)
        torch.testing.assert_close(found.reward, expected.reward, rtol=0, atol=1e-9)
        assert torch.equal(found.truncated, expected.truncated)
    for one, other in zip(leaves(theirs.state), leaves(ours.state), strict=True):
        np.testing.assert_allclose(np.asarray(one), np.asarray(other), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "craft",
    [
        pytest.param(CUBESAT, marks=pytest.mark.slow),
        pytest.param(LANDER, marks=pytest.mark.slow),
        BOTH,
    ],
    ids=["cubesat", "lander", "both"],
)
def test_a_kernel_flies_as_stepping_does(craft: Spacecraft, tmp_path: Path) -> None:
    network: Network = untrained_policy(craft)
    task = load_task(task_of(craft)).for_evaluation()
    given = Setup(craft, task, chosen(craft, Timing(episode_steps=10)))
    stepped = Flights(network, given, generated=False)
    kernel = HostFlights(stepped.world, network, tmp_path, products="bf16x6")
    ours, theirs = kernel.fly(0, 40, 7, 1000), stepped.fly(0, 40, 7)
    assert ours.failures == theirs.failures
    for name in ("impulse", "return"):
        assert ours.sums[name].mean == pytest.approx(theirs.sums[name].mean, rel=2e-3)


@pytest.mark.parametrize("effect", ["faults", "all"])
def test_conditions_meet_wheels_and_propellant(effect: str) -> None:
    """In single and double precision alike, under what episodes draw."""
    met = EFFECTS[effect]
    ends = []
    for dtype in (torch.float32, torch.float64):
        engine = Engine(BOTH, "go-to-pose", 16, seed=3, dtype=dtype, conditions=met)
        for k in range(10):
            engine.step(torch.from_numpy(commands(BOTH, 16, seed=k)).to(dtype))
        ends.append(np.array([np.asarray(x, dtype=np.float64) for x in leaves(engine.state)]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=5e-4)
