"""The number of substeps: what it follows from, and that it does what it is for."""

from __future__ import annotations

import itertools
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import torch

from rans import (
    Conditions,
    DisturbanceConditions,
    Engine,
    FaultConditions,
    GoToPose,
    Spacecraft,
    Thruster,
    ThrusterConditions,
    Timing,
)
from rans.episode.step import Setup, World
from rans.model.accuracy import MOST, chosen, fastest, spin_up
from rans.model.body import Body
from rans.model.spacecraft_file import load_spacecraft
from tests.support.crafts import heavier, nasty_planar, nasty_spatial

FLYER = load_spacecraft("free-flyer")


def rod(moment: float) -> Spacecraft:
    """Slim about x, with couples of 1 N m about every axis in either sense: two nozzles of 1 N, 1 m apart."""
    axes = np.eye(3)
    nozzles = [
        (0.5 * side * axes[k], side * sense * axes[k - 1])
        for k in range(3)
        for sense in (1.0, -1.0)
        for side in (1.0, -1.0)
    ]
    return Spacecraft(
        "rod",
        3,
        5.0,
        ((moment, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        tuple(
            Thruster((p[0], p[1], p[2]), (d[0], d[1], d[2]), 1.0)
            for p, d in ((position.tolist(), direction.tolist()) for position, direction in nozzles)
        ),
    )


def test_shipped_spacecraft_take_one_step(shipped):
    assert chosen(shipped, Timing()).substeps == 1


@pytest.mark.parametrize(
    "craft", [nasty_planar(), nasty_spatial(), rod(0.1)], ids=lambda craft: craft.name
)
def test_the_fastest_command_is_that_of_all(craft):
    """By trying every subset of at most twelve thrusters."""
    craft = replace(craft, thrusters=craft.thrusters[:12])
    torques = np.array(craft.wrench_map)[:, craft.dimension :]
    inertia = np.array(craft.inertia)[-torques.shape[1] :, -torques.shape[1] :]
    commands = np.array(list(itertools.product((0.0, 1.0), repeat=len(craft.thrusters))))
    accelerations = np.linalg.solve(inertia, (commands @ torques).T)
    assert spin_up(craft) == pytest.approx(np.linalg.norm(accelerations, axis=0).max(), rel=1e-12)
    alone = np.linalg.norm(np.linalg.solve(inertia, torques.T), axis=0).max()
    assert spin_up(replace(craft, thrust_sharing="split")) == pytest.approx(alone, rel=1e-12)


def test_numbers_by_hand():
    """A rod of 0.1, 1, 1 kg m^2: 1 N m about each axis gives sqrt(102) rad/s^2; moments differ by
    (1 - 0.1) / 1 = 0.9: a step may turn 1 / (1 + 1.5 * 0.9) rad, with its reserve 1 / (1 + 4 * 0.9)."""
    craft = rod(0.1)
    for period, turn in (
        (0.05, math.sqrt(math.pi * 102**0.5 * 0.05**2)),
        (0.3, 3 * 102**0.5 * 0.3**2),
    ):
        timing = chosen(craft, Timing(period))
        assert timing.substeps == math.ceil(turn * 4.6)
        assert fastest(craft, timing) == pytest.approx(math.ceil(turn * 4.6) / 2.35 / period)


@pytest.mark.filterwarnings("ignore:.*cannot push and turn it")
@pytest.mark.parametrize("craft", [nasty_planar(), nasty_spatial()], ids=lambda craft: craft.name)
def test_bodies_are_each_what_they_are(craft):
    """Of 30 that differ in everything at once the quickest, by trying every subset of eight thrusters."""
    random = np.random.default_rng(4)
    craft = replace(craft, thrusters=craft.thrusters[:8])
    nominal = Body.of(craft)
    size = craft.dimension
    count = len(craft.thrusters)
    factor, gain, leak = (random.uniform(0.5, 1.5, 30) for _ in range(3))
    centre = random.uniform(-0.1, 0.1, (size, 30))
    bodies = replace(
        nominal,
        inertia=tuple(x * factor for x in nominal.inertia),
        centre=tuple(centre),
        gain=(gain, *nominal.gain[1:]),
        leak=(*nominal.leak[1:], leak),
    )
    arms = [np.array(t.position) - craft.centre_of_mass for t in craft.thrusters]
    commands = np.array(list(itertools.product((0.0, 1.0), repeat=count)))
    most = 0.0
    for k in range(30):
        offset = np.array([*centre[:, k], 0.0][:3])
        shares = np.array([gain[k], *[1.0] * (count - 2), 1.0 + leak[k]])
        torques = [
            np.cross(arm - offset, t.direction) * t.force * share
            for arm, t, share in zip(arms, craft.thrusters, shares, strict=True)
        ]
        tensor = np.array(craft.inertia) * factor[k]
        turns = (
            (commands @ torques)[:, -1:] / tensor[2, 2]
            if size == 2
            else np.linalg.solve(tensor, (commands @ torques).T).T
        )
        most = max(most, float(np.linalg.norm(turns, axis=1).max()))
    assert spin_up(craft, bodies) == pytest.approx(most, rel=1e-12)


def test_too_fast_for_its_period_is_said_with_numbers():
    with pytest.warns(
        UserWarning,
        match=r"turns it up to 5\.05 rad in a control period of 1 s and leaves it "
        r"spinning at 10\.1 rad/s; above 1 rad .* Shorten the period",
    ):
        assert chosen(rod(0.1), Timing(1.0)).substeps == MOST


def test_faults_count_with_what_they_leave_of_each_thruster():
    """A nozzle stuck open in some episodes is no stronger in any: it takes no more steps than a sound one."""
    craft = rod(0.1)
    timing = Timing(0.2)
    nominal = Body.of(craft)
    some = replace(
        nominal,
        gain=(np.array([1.0, 0.0]), *nominal.gain[1:]),
        leak=(np.array([0.0, 1.0]), *nominal.leak[1:]),
    )
    assert spin_up(craft, some) == pytest.approx(spin_up(craft))
    leaky = replace(nominal, leak=(np.array([0.0, 0.5]), *nominal.leak[1:]))
    assert spin_up(craft, leaky) == pytest.approx(math.sqrt(100 + 1.25**2 + 1))
    faults = Conditions(faults=FaultConditions(1.0, ("stuck-open",), time=(0.0, 25.0)))
    assert World(Setup(craft, GoToPose(), timing, faults)).timing == chosen(craft, timing)
    late = replace(faults, thrusters=ThrusterConditions(thrust=(1.5, 1.5)))
    assert World(Setup(craft, GoToPose(), timing, late)).timing == chosen(
        craft, timing, replace(nominal, gain=(1.5,) * 12)
    )


def test_a_torque_that_stays_in_the_world_takes_more():
    """A ball of 0.2045 kg m^2 that steps of 1 rad fit: 3 * 0.29705 = 0.89 rad a period, 1 step. Half a
    newton metre: 25 * sqrt(0.5 / 0.2045) / 11 = 3.55 times as many, 3.2, so 4. The plane is stable."""
    timing = Timing()
    for torque, number in ((0.0, 1), (0.03, 1), (0.5, 4)):
        assert chosen(FLYER, timing, torque=torque).substeps == number
    assert chosen(load_spacecraft("floating-platform"), timing, torque=0.5).substeps == 1
    pushed = Conditions(disturbances=DisturbanceConditions(torque=(0.0, 0.5)))
    for conditions in (pushed, replace(Conditions(), others=(pushed,))):
        assert World(Setup(FLYER, GoToPose(), timing, conditions)).timing.substeps == 4


def test_worlds_and_engines_know_the_number():
    craft = rod(0.1)
    timing = Timing(0.2)
    number = chosen(craft, timing).substeps
    assert number == 6
    assert World(Setup(craft, GoToPose(), timing)).timing.substeps == number
    engine = Engine(craft, GoToPose(), 2, timing)
    assert engine._world.timing.substeps == number
    heavy = Engine(
        craft,
        GoToPose(),
        2,
        timing,
        body=replace(Body.of(craft), inertia=tuple(4 * x for x in Body.of(craft).inertia)),
    )
    assert (heavy._world.timing.substeps or 9) < number


@pytest.mark.parametrize("craft", ["floating-platform", "free-flyer"])
def test_what_is_flown_keeps_its_state(craft):
    """Just within both bounds, for some periods of random commands."""
    light = heavier(load_spacecraft(craft), 1e-6, 1.0)
    quick = heavier(load_spacecraft(craft), 1.0, spin_up(light) * 0.04 / 499.0)
    dice = torch.Generator().manual_seed(0)
    for wild in (light, quick):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "spacecraft .* can hardly be controlled")
            engine = Engine(wild, "track-velocity", 64, seed=0)
        for _ in range(5):
            told = torch.randint(0, 2, (64, len(wild.thrusters)), generator=dice)
            assert engine.step(told).final_observation.isfinite().all()
