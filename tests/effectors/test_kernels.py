"""Kernels of craft with wheels, propellant and throttle levels, compiled for a CPU."""

import numpy as np
import pytest
import torch

from rans import Engine, Timing
from rans.episode.flight import Setup
from rans.fast.flights import Flights
from rans.model.accuracy import chosen
from rans.tasks import load_task
from tests.support.effector_crafts import CUBESAT, LANDER, commands
from tests.support.effector_flights import BOTH, task_of, untrained_policy
from tests.support.host_flight import HostFlights
from tests.support.host_kernels import (
    compare,
    engine_on_host,  # noqa: F401  (a fixture)
    needs_compiler,
)

pytestmark = needs_compiler
every_craft = pytest.mark.parametrize(
    "craft", [CUBESAT, LANDER, BOTH], ids=["cubesat", "lander", "both"]
)


@every_craft
def test_a_kernel_steps_as_numpy(craft, on_host):
    made = (craft, task_of(craft), 16, Timing(episode_steps=5))
    how = {"seed": 3, "dtype": torch.float64}
    given = torch.from_numpy(np.stack([commands(craft, 16, seed=k) for k in range(7)]))
    assert compare(Engine(*made, **how), on_host(*made, **how), form=torch.float64, given=given) > 8


def test_a_kernel_flies_as_stepping_does(tmp_path):
    network = untrained_policy(BOTH)
    task = load_task(task_of(BOTH)).for_evaluation()
    given = Setup(BOTH, task, chosen(BOTH, Timing(episode_steps=10)))
    stepped = Flights(network, given, generated=False)
    kernel = HostFlights(stepped.world, network, tmp_path, products="bf16x6")
    ours, theirs = kernel.fly(0, 40, 7, 1000), stepped.fly(0, 40, 7)
    assert ours.failures == theirs.failures
    for name in ("impulse", "return"):
        assert ours.sums[name].mean == pytest.approx(theirs.sums[name].mean, rel=2e-3)
