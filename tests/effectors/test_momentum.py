"""No control period changes a craft's momentum by more than all of its thrusters can."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import rans
from rans.effectors.motion import states_at_checks
from rans.model.actuators import Propellant
from rans.model.body import Body
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, leaves
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.valves import Lag, failing, pieces
from tests.support.effector_crafts import platform

COUNT = 256
"""Craft that a period is computed for, each with commands, lags, faults and propellant of its own."""


def forced(force: float, left: float | None = None) -> Spacecraft:
    """The floating platform with other forces, and with a mass and inertia for the same accelerations.

    Args:
        force: of every nozzle, N.
        left: share of the mass that is propellant, of which the open nozzles burn a few percent in a period; None:
            no tank.
    """
    craft = platform()
    mass = craft.mass * force
    tank = None if left is None else Propellant(left * mass, 8.0 * force / (left * mass))
    with warnings.catch_warnings():  # that so little propellant lasts for seconds only
        warnings.simplefilter("ignore", UserWarning)
        return replace(
            craft,
            name="forced",
            mass=mass,
            inertia=tuple((x * force, y * force, z * force) for x, y, z in craft.inertia),
            thrusters=tuple(replace(nozzle, force=force) for nozzle in craft.thrusters),
            propellant=tank,
        )


def one_period(
    craft: Spacecraft, random: np.random.Generator, lag: Lag, period: float, checks: int, dtype: Any
) -> tuple[PlanarState, tuple[PlanarState, ...]]:
    """The state of craft at rest that some thrusters of which fail, and those at the checks of a period."""
    healthy = Body.of(craft)
    number = craft.thruster_count
    works = (random.uniform(size=(number, COUNT)) < 0.8).astype(dtype)
    leaks = (1.0 - works) * random.choice([0.0, 0.0, 0.3], (number, COUNT)).astype(dtype)
    broken = replace(healthy, gain=tuple(works), leak=tuple(leaks))
    healthy = replace(healthy, gain=tuple(np.ones_like(works)), leak=tuple(np.zeros_like(leaks)))
    # In many periods no nozzle is told to open, or only few.
    openness = random.choice([0.0, 0.2, 0.5], (5, 1, COUNT))
    told = [tuple(x) for x in (random.uniform(size=(5, number, COUNT)) < openness).astype(dtype)]
    sound, failed = (pieces(craft, body, told, lag, period) for body in (healthy, broken))
    late = failing(sound, failed, random.uniform(-period, 2.0 * period, COUNT).astype(dtype))
    rest = np.zeros(COUNT, dtype)
    stores = tuple(
        (store.high * random.choice([0.0, 1e-7, 1e-3, 1.0], COUNT)).astype(dtype)
        for store in craft.stores
    )
    state = PlanarState(Vec2(rest, rest), Heading(rest), Vec2(rest, rest), rest, stores=stores)
    timing = Timing(period, checks=checks, substeps=2)
    return state, states_at_checks(state, craft, healthy, told[0], timing, pieces=late)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@settings(max_examples=10)
@given(
    force=st.sampled_from([0.05, 7.3]) | st.floats(-2.0, 3.7).map(lambda x: 10.0**x),
    left=st.sampled_from([None, 0.01, 0.6, 0.99]),
    period=st.sampled_from([0.02, 0.1, 0.2, 1.0]),
    slow=st.sampled_from([0.0, 1e-9, 0.1, 0.7, 2.0]),
    late=st.sampled_from([0.0, 0.3, 1.0, 2.0]),
    ramps=st.booleans(),
    checks=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_momentum_comes_from_nothing(
    dtype: Any,
    force: float,
    left: float | None,
    period: float,
    slow: float,
    late: float,
    ramps: bool,
    checks: int,
    seed: int,
) -> None:
    """Forces whose sums are no binary numbers leave shut valves with a thrust of either sign and no size."""
    craft = forced(force, left)
    random = np.random.default_rng(seed)
    latency, rise = (
        (random.choice([0.0, 0.5, 1.0, random.uniform()], COUNT) * most * period).astype(dtype)
        for most in (late, slow)
    )
    bounded = Lag(
        latency,
        rise if ramps else None,
        late * period,
        slow * period if ramps else 0.0,
    )
    before, after = one_period(craft, random, bounded, period, checks, dtype)
    for number, state in enumerate(after, 1):
        assert all(np.isfinite(field).all() for field in leaves(state))
        gone = period * number / checks
        for stored, had in zip(state.stores, before.stores, strict=True):
            assert (stored >= 0.0).all()
            assert (stored <= had).all()
        # All nozzles push, and the craft has lost all propellant; four rounded sums of eight nozzles.
        room = 1.0 + 100.0 * float(np.finfo(dtype).eps)
        heavy = 1.0 - (left or 0.0)
        most = 8.0 * force * gone / (craft.mass * heavy) * room
        assert np.hypot(state.v.x, state.v.y).max() <= most
        assert np.hypot(state.p.x, state.p.y).max() <= most * gone
        arm = math.hypot(*craft.thrusters[0].position)
        assert abs(state.w).max() <= most * craft.mass / craft.inertia[2][2] * arm


@pytest.mark.parametrize("kind", ["program", "plain", "double"])
def test_no_engine_loses_a_craft_with_a_tank_and_slow_valves(kind: str) -> None:
    """The conditions that come with RANS for a hard day; a tank of 70 kg of 116.8, and nozzles of 7.3 N."""
    force = 7.3
    craft = replace(forced(force), mass=16.0 * force, propellant=Propellant(70.0, 200.0))
    dtype = torch.float64 if kind == "double" else torch.float32
    engine = rans.Engine(
        craft,
        "go-to-pose",
        512,
        Timing(0.1),
        conditions="harsh",
        seed=3,
        plain=kind == "plain",
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
