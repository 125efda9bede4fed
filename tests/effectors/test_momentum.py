"""No control period changes a craft's momentum by more than all of its thrusters can."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import rans
from rans import Timing
from rans.model.actuators import Propellant
from tests.support.effector_crafts import platform


@pytest.mark.parametrize("kind", ["program", "double"])
def test_no_engine_loses_a_craft_with_a_tank_and_slow_valves(kind):
    """The conditions that come with RANS for a hard day; a tank of 70 kg of 116.8, and nozzles of 7.3 N."""
    force = 7.3
    craft = platform()
    craft = replace(
        craft,
        mass=16.0 * force,
        inertia=tuple((x * force, y * force, z * force) for x, y, z in craft.inertia),
        thrusters=tuple(replace(nozzle, force=force) for nozzle in craft.thrusters),
        propellant=Propellant(70.0, 200.0),
    )
    dtype = torch.float64 if kind == "double" else torch.float32
    engine = rans.Engine(
        craft,
        "go-to-pose",
        512,
        Timing(0.1),
        conditions="harsh",
        seed=3,
        dtype=dtype,
    )
    random = np.random.default_rng(1)
    for _ in range(20):
        before = np.array([engine.state.v.x, engine.state.v.y])
        shut = random.integers(0, 2, (512, craft.thruster_count))
        result = engine.step(torch.from_numpy(shut).to(dtype))
        going = ~np.asarray(result.terminated | result.truncated)
        assert going.all()
        change = np.hypot(*(np.array([engine.state.v.x, engine.state.v.y]) - before))
        # All nozzles at 1.25 of their force, a push and a kick, on the lightest craft: 0.7 times its mass.
        assert change.max() < (8.0 * 1.25 * force * 0.1 + 0.3 * 0.1 + 0.5) / (0.69 * craft.mass)
