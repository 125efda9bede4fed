"""Sloshing liquid as a spherical pendulum: against Drake, by what a free pair conserves, and in every engine."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import rans
from rans.effectors.motion import effectors_of, held
from rans.errors import ConfigError
from rans.flight import fly
from rans.model.actuators import Wheel
from rans.model.body import Body
from rans.model.fields import leaves
from rans.model.random import Draws
from rans.model.spacecraft_file import parse_spacecraft, to_toml
from rans.model.timing import Timing
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    EffectorConditions,
)
from rans.reference.flight import fly_in_drake
from rans.scenario import draws, scenarios
from rans.structure import Range
from tests.support.effector_crafts import commands, states
from tests.support.effector_flights import Scripted
from tests.support.host_kernels import (
    needs_compiler,
    on_host,  # noqa: F401  (a fixture)
)
from tests.support.pairs import FallingInSpace
from tests.support.slosh import IN_SPACE, IN_SPACE_SLOSH, sums_in_space

WHEELED = replace(
    IN_SPACE,
    wheels=(
        Wheel((1.0, 0.0, 0.0), 0.02, 0.1, 4e-4),
        Wheel((0.0, 0.6, 0.8), 0.03, 0.2, 5e-4),
    ),
)
UNEVEN = Conditions(
    body=BodyConditions(
        mass=(0.8, 1.1),
        inertia=(0.9, 1.2),
        centre=(0.0, 0.01),
    ),
    effectors=(
        EffectorConditions("slosh mass", (0.5, 1.0)),
        EffectorConditions("slosh damping", (0.0, 2.0)),
    ),
    disturbances=DisturbanceConditions(force=(0.1, 0.3), torque=(0.003, 0.01)),
)


def moving(craft: Any, count: int = 4) -> Any:
    """States with spins, rods in any direction, and rates across them."""
    random = np.random.default_rng(4)
    rod, slip = random.normal(size=(2, 3, count))
    rod /= np.linalg.norm(rod, axis=0)
    slip -= rod * (rod * slip).sum(axis=0)
    return replace(states(craft, count), stores=(*rod, *slip))


def coasted(craft: Any) -> list[Any]:
    """States of a coast of 2 s, the start first."""
    results = [moving(craft)]
    for _ in range(10):
        timing = Timing(control_period=0.2, substeps=8)
        still = (0.0,) * craft.command_count
        results.append(held(results[-1], craft, Body.of(craft), still, timing))
    return results


def test_its_states_are_those_of_its_effectors() -> None:
    stores = [store.name for store in WHEELED.stores]
    axes = [f"slosh {what} {axis}" for what in ("direction", "rate") for axis in "xyz"]
    assert stores == ["momentum of wheel 0", "momentum of wheel 1", *axes]
    assert tuple(x for e in effectors_of(WHEELED) for x in e.stores) == WHEELED.stores
    assert [store.initial for store in WHEELED.stores[2:5]] == [-0.48, 0.6, 0.64]


def test_a_coast_conserves_momentum_and_angular_momentum_and_friction_takes_energy() -> None:
    path = coasted(IN_SPACE)
    sums = [sums_in_space(IN_SPACE, state) for state in path]
    for one in sums[1:]:
        np.testing.assert_allclose(one.momentum, sums[0].momentum, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.angular, sums[0].angular, rtol=0, atol=2e-6)
    energies = np.array([one.energy for one in sums])
    assert (np.diff(energies, axis=0) < 0.0).all()
    # The rod has the length 1 and turns only.
    rod, slip = np.array(path[-1].stores[:3]), np.array(path[-1].stores[3:])
    np.testing.assert_allclose((rod * rod).sum(axis=0), 1.0, rtol=1e-14)
    np.testing.assert_allclose((rod * slip).sum(axis=0), 0.0, atol=1e-14)


def test_without_friction_energy_stays() -> None:
    craft = replace(IN_SPACE, further_effectors=(replace(IN_SPACE_SLOSH, damping=0.0),))
    path = coasted(craft)
    first, last = (sums_in_space(craft, state).energy for state in (path[0], path[-1]))
    np.testing.assert_allclose(last, first, rtol=1e-5)


def test_small_swings_in_both_directions_have_the_frequency_of_a_pendulum() -> None:
    """A light mass in a heavy craft that accelerates along x swings with sqrt(a / l) along y and z."""
    slosh = rans.Slosh(1e-5, 0.1, (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    craft = replace(rans.load_spacecraft("free-flyer"), further_effectors=(slosh,))
    columns = np.array(craft.wrench_map)
    ahead = [i for i in range(craft.thruster_count) if columns[i, 0] > 0]
    total = columns[ahead].sum(axis=0)
    np.testing.assert_allclose(total[1:], 0.0, atol=1e-12)
    command = tuple(float(i in ahead) for i in range(craft.thruster_count))
    still = states(craft, 2, spin=0.0)
    # 0.01 rad towards y, and towards z.
    away = 0.01 * np.eye(2)
    zeros = (np.zeros(2),) * 3
    rod = (-np.sqrt(1.0 - (away**2).sum(axis=0)), *away)
    start = replace(
        still, w=replace(still.w, x=zeros[0], y=zeros[0], z=zeros[0]), stores=(*rod, *zeros)
    )
    period = 2.0 * math.pi / slosh.frequency(total[0] / craft.mass)
    state = held(start, craft, Body.of(craft), command, Timing(control_period=period, substeps=64))
    # The period of a swing of 0.01 rad is longer by 0.01^2 / 16.
    np.testing.assert_allclose(state.stores[1:3], away, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(state.stores[3:], 0.0, atol=1e-5)


def test_a_rod_that_friction_holds_moves_as_the_rigid_craft() -> None:
    """At rest the mass is a part of the craft's mass, inertia and centre of mass."""
    held_rod = replace(IN_SPACE, further_effectors=(replace(IN_SPACE_SLOSH, damping=0.5),))
    rigid = replace(IN_SPACE, further_effectors=())
    still = replace(states(rigid, 3), stores=())
    rest = tuple(np.full(3, store.initial) for store in held_rod.stores)
    command = tuple(commands(rigid, 3, seed=2).T)
    timing = Timing(control_period=0.2, substeps=60)
    one = held(replace(still, stores=rest), held_rod, Body.of(held_rod), command, timing)
    other = held(still, rigid, Body.of(rigid), command, timing)
    loose = held(replace(still, stores=rest), IN_SPACE, Body.of(IN_SPACE), command, timing)
    for a, b in zip(leaves(replace(one, stores=())), leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=2e-3)
    gaps = [a - b for a, b in zip(leaves(loose.w), leaves(other.w), strict=True)]
    assert np.abs(gaps).max() > 0.01


@pytest.mark.parametrize(
    ("craft", "task", "conditions"),
    [
        (IN_SPACE, rans.GoToPose(), None),
        (WHEELED, FallingInSpace(), None),
        (IN_SPACE, rans.GoToPose(), UNEVEN),
    ],
    ids=["free", "wheels and gravity", "drawn bodies and disturbances"],
)
def test_drake_flies_it_alike(craft: Any, task: Any, conditions: Any) -> None:
    """A point mass on a universal joint with friction, in Drake's own multibody equations."""
    timing = Timing(episode_steps=12, checks=2)
    starts = scenarios(task, craft, 5, 3)
    seeds: Draws | None = None if conditions is None else draws(5, 3)
    how: Any = {"conditions": conditions, "draws": seeds}
    ours = fly(craft, task, Scripted(craft), starts, timing, **how)
    drake = fly_in_drake(craft, task, Scripted(craft), starts, timing, **how)
    *motion, x, y, z = zip(leaves(ours.states), leaves(drake.states), strict=True)
    for one, other in motion:
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5)
    # The liquid itself turns at some 9 rad/s.
    for one, other in (x, y, z):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-4)
    assert np.ptp(ours.states.stores[-4]) > 0.3


def test_engines_step_alike() -> None:
    found = {}
    for kind, dtype in (("program", torch.float32), ("plain", torch.float64)):
        how: Any = {"seed": 3, "plain": kind == "plain", "dtype": dtype}
        engine = rans.Engine(IN_SPACE, "go-to-pose", 16, Timing(control_period=0.05), **how)
        for k in range(8):
            engine.step(torch.from_numpy(commands(IN_SPACE, 16, seed=k)).to(dtype))
        found[kind] = np.array([np.asarray(x, dtype=np.float64) for x in leaves(engine.state)])
    assert np.abs(found["plain"][-1]).max() > 0.1
    np.testing.assert_allclose(found["plain"], found["program"], rtol=0, atol=2e-4)


@needs_compiler
@pytest.mark.slow
def test_a_kernel_steps_as_numpy(on_host: Any) -> None:  # noqa: F811
    """The source of the GPU's kernel, compiled for a CPU."""
    made: Any = (IN_SPACE, "go-to-pose", 16, Timing(control_period=0.05, episode_steps=5))
    how: Any = {"seed": 3, "dtype": torch.float64}
    ours = rans.Engine(*made, **how)
    theirs = on_host(*made, **how)
    for k in range(7):
        action = torch.from_numpy(commands(IN_SPACE, 16, seed=k))
        expected = ours.step(action)
        found = theirs.step(action)
        torch.testing.assert_close(found.observation, expected.observation, rtol=0, atol=1e-9)
    for one, other in zip(leaves(theirs.state), leaves(ours.state), strict=True):
        np.testing.assert_allclose(np.asarray(one), np.asarray(other), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("inertia", "damping"), [((0.05, 1.0), 1.0), (1.0, (1.0, 20.0))], ids=["inertia", "damping"]
)
@pytest.mark.parametrize("is_alone", [True, False])
def test_bodies_for_which_friction_is_too_fast_are_refused(
    inertia: Range, damping: Range, is_alone: bool
) -> None:
    """Steps are those of the designed craft; this flight would end in NaN."""
    slosh = replace(IN_SPACE_SLOSH, length=0.5, hinge=(0.0, -0.5, 0.0), direction=(0.0, 1.0, 0.0))
    craft = replace(IN_SPACE, further_effectors=(replace(slosh, damping=2.0),))
    rans.Engine(craft, "go-to-pose", 2)
    usual = Conditions(effectors=(EffectorConditions("slosh damping"),))
    friction = EffectorConditions("slosh damping", damping)
    conditions = Conditions(body=BodyConditions(inertia=inertia), effectors=(friction,))
    conditions = conditions if is_alone else replace(usual, others=(conditions,))
    with pytest.raises(ConfigError, match=r"stop the rod of .*narrow the ranges"):
        rans.Engine(craft, "go-to-pose", 2, conditions=conditions)


def test_its_file_says_what_it_is() -> None:
    assert (
        parse_spacecraft(to_toml(IN_SPACE), "a file").further_effectors
        == IN_SPACE.further_effectors
    )


def test_a_mass_that_leaves_no_rigid_craft_is_refused() -> None:
    far = replace(IN_SPACE_SLOSH, hinge=(0.3, 0.0, 0.0))
    with pytest.raises(ConfigError, match=r"slosh mass must be .* adds"):
        replace(IN_SPACE, further_effectors=(far,))
    light = Conditions(body=BodyConditions(inertia=0.1))
    with pytest.raises(ConfigError, match=r"leave no inertia to 'sloshing in space'"):
        rans.Engine(IN_SPACE, "go-to-pose", 2, conditions=light)
