"""Very many flights, against flights of the evaluation and against stepping."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from rans_any_craft.networks import for_craft

from rans import GoToPose, Timing, run_on
from rans.episode.flight_statistics import QUANTITIES, FlightStatistics
from rans.episode.step import Setup
from rans.episode.verdict import Failure
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure import metrics
from rans.fast import flights as module
from rans.fast.flights import Flights
from rans.fast.stepping.step import Backend
from rans.model.spacecraft_file import load_spacecraft
from rans.policy.network import Network
from tests.support.engines import PLATFORM, both_crafts
from tests.support.kernel_flights import WIDE, policy, setup
from tests.support.worlds import EFFECTS

COUNT = 300


def alike(
    a: FlightStatistics, b: FlightStatistics, different: int = 0, share: float = 1e-5
) -> None:
    """The same flights failed, but for so many, and means agree."""
    assert a.flights == b.flights
    failed = [set(zip(found.numbers, found.kinds, strict=True)) for found in (a, b)]
    assert len(failed[0] ^ failed[1]) <= different
    assert np.abs(a.settled_at - b.settled_at).sum() <= 2 * different
    for name in QUANTITIES:
        np.testing.assert_allclose(a.sums[name].mean, b.sums[name].mean, rtol=share, err_msg=name)


def as_stepped(found: FlightStatistics, network: Network, given: Setup, seed: int = 1) -> None:
    """Programs round in another order; a command near to zero changes, and with it one flight of hundreds."""
    expected = Flights(network, given, generated=False).fly(0, COUNT, seed)
    alike(found, expected, different=2, share=1e-3)
    assert expected.ways == {"stepping, cpu"}


@both_crafts
def test_they_are_the_evaluations_flights(craft):
    """Scenario by scenario, in float64 there; no task of these ends a flight."""
    task = replace(WIDE, fail_distance=1e3, fail_spin=1e3)
    network = policy(craft, task)
    given = Setup(*setup(craft, task))
    found = Flights(network, given).fly(7, COUNT, 3)
    flight = fly_episodes(Agent(network, ""), given, 3, COUNT, first=7)
    failed = 7 + np.flatnonzero(~metrics.solved(flight))
    # float32 and float64 may differ in a command, and in a state within rounding of a bound.
    assert len(set(found.numbers.tolist()) ^ set(failed.tolist())) <= COUNT // 100
    assert 0 < len(failed) < COUNT
    expected = {
        "return": metrics.returns(flight),
        "impulse": metrics.impulses(flight),
        "duty at rest": flight.commands[-2:].mean(axis=(0, 2)),
    }
    for name, values in expected.items():
        assert found.sums[name].mean == pytest.approx(values.mean(), rel=2e-3)
        assert found.sums[name].squares == pytest.approx(np.square(values).sum(), rel=2e-3)
    times = metrics.settling_times(flight)
    at = np.bincount(np.round(times[np.isfinite(times)] / 0.2).astype(int), minlength=13)
    assert np.abs(found.settled_at - at).sum() <= COUNT // 100


@pytest.mark.parametrize("name", ["floating-platform", "pingu"])
def test_allocation_is_flown(name):
    """On/off thrusters, and throttled ones beside a wheel; an uneven craft has more subsets than pay."""
    craft = load_spacecraft(name)
    agent = contestant("pretrained:any-craft-2d").controller
    assert isinstance(agent, Agent)
    network = for_craft(agent.network, craft, 0.1)
    given = Setup(craft, GoToPose(), Timing(0.1, 1, 40))
    found = Flights(network, given).fly(0, COUNT, 5)
    assert found.ways == {"CPU, float32"}
    as_stepped(found, network, given, 5)
    uneven = replace(
        PLATFORM,
        thrusters=tuple(
            replace(one, force=1.0 + 0.07 * k) for k, one in enumerate(PLATFORM.thrusters)
        ),
    )
    network = for_craft(agent.network, uneven, 0.1)
    assert Flights(network, Setup(uneven, GoToPose(), Timing(0.1, 1, 40)))._whole is None


@cache
def perfect() -> FlightStatistics:
    """Statistics of the flights of this file without conditions."""
    return Flights(policy(PLATFORM), setup(PLATFORM)).fly(0, COUNT, 1)


@pytest.mark.parametrize(
    "effect",
    # What is left out differs from one of these in its ranges alone.
    [
        one
        for one in EFFECTS
        if one
        not in ("thrust", "rise", "named", "recoverable", "push", "swing", "sensors", "dropout")
    ],
)
def test_conditions_are_flown(effect):
    """Valves that hold and sensors that are late remember several periods, each moved on by the next."""
    network = policy(PLATFORM)
    given = setup(PLATFORM, conditions=EFFECTS[effect])
    found = Flights(network, given).fly(0, COUNT, 1)
    as_stepped(found, network, given)
    assert perfect().sums["return"] != found.sums["return"]


def test_stepping_on_torch_is_stepping_on_numpy():
    """As on a GPU, where nothing is compiled."""
    network = policy(PLATFORM, history=1)
    given = setup(PLATFORM, conditions=EFFECTS["body"])
    numpy, torches = (Flights(network, given, generated=False) for _ in range(2))
    torches.backend = Backend(torch.device("cpu"), torch.float32)
    alike(torches.fly(0, COUNT, 5), numpy.fly(0, COUNT, 5), different=2, share=1e-3)


def test_parts_add_up_to_the_whole(monkeypatch):
    network = policy(PLATFORM, zoom=8.0)
    given = setup(PLATFORM)
    whole = Flights(network, given).fly(0, COUNT, 1)
    monkeypatch.setitem(module.BATCH, "cpu", 64)
    told = []
    flights = Flights(network, given)
    parts = flights.fly(0, COUNT, 1, told.append)
    assert sum(told) == COUNT
    assert len(told) == 5
    alike(parts, whole)
    two = flights.fly(0, 100, 1) + flights.fly(100, COUNT - 100, 1)
    alike(two, whole)


def test_many_are_divided_among_processes(monkeypatch):
    network = policy(PLATFORM)
    given = setup(PLATFORM)
    whole = Flights(network, given).fly(5, COUNT, 1)
    monkeypatch.setattr(module, "_processors", lambda: 2)
    monkeypatch.setattr(module, "_MANY", 200)
    monkeypatch.setattr(module, "_SHARE", 128)
    told = []
    with ThreadPoolExecutor(1) as pool, run_on(pool):
        alike(Flights(network, given).fly(5, COUNT, 1, told.append), whole)
    assert sorted(told) == [44, 128, 128]


def test_a_state_that_is_not_finite_ends_its_flight():
    """Starts so far away that float32 squares of them overflow."""
    task = GoToPose(spawn_distance=(1.0, 1e31), fail_distance=1e38)
    for how in (True, False):
        found = Flights(policy(PLATFORM, task), setup(PLATFORM, task), generated=how).fly(0, 50, 1)
        assert found.failures[Failure.NOT_FINITE] > 0
        assert np.isfinite([found.sums["impulse"].total, found.sums["duty at rest"].total]).all()
