"""Craft with wheels, propellant and throttle levels in every executor: engines, environments, flights, exports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

import rans
from rans import Spacecraft, Timing
from rans.deploy.contract import golden
from rans.deploy.export import write_agent
from rans.episode.flight import Setup, fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.agent import Agent
from rans.evaluation.measure.metrics import impulses, samples
from rans.fast.agent_files.agent import SavedPolicy
from rans.fast.flights import Flights
from rans.model.accuracy import chosen
from rans.model.fields import leaves
from rans.policy.network import Network
from tests.support.effector_crafts import WHEELED, commands
from tests.support.effector_flights import ALL, BOTH, task_of, untrained_policy
from tests.support.played import Played
from tests.support.scripts import module_of
from tests.support.torquer import TURNED, TURNED_IN_SPACE

OWN = [TURNED, TURNED_IN_SPACE]
"""With an effector of a kind that RANS does not know."""
NAMES = ["cubesat", "lander", "wheel", "tank", "both", "own", "own in space"]
every_craft = pytest.mark.parametrize("craft", [*ALL, *OWN], ids=NAMES)


@every_craft
def test_engines_step_alike(craft):
    """The program in single precision, torch as it is written, and NumPy in double precision."""
    found = {}
    for kind in ("program", "plain", "double"):
        dtype = torch.float64 if kind == "double" else torch.float32
        engine = rans.Engine(craft, task_of(craft), 32, seed=3, plain=kind == "plain", dtype=dtype)
        for k in range(8):
            engine.step(torch.from_numpy(commands(craft, 32, seed=k)).to(dtype))
        found[kind] = np.array([np.asarray(x, dtype=np.float64) for x in leaves(engine.state)])
    assert np.abs(found["double"][-1]).max() > 1e-3
    np.testing.assert_allclose(found["program"], found["double"], rtol=0, atol=2e-4)
    np.testing.assert_allclose(found["plain"], found["program"], rtol=0, atol=2e-4)


@every_craft
def test_an_episode_begins_with_full_tanks_and_still_wheels(craft):
    engine = rans.Engine(craft, task_of(craft), 8, Timing(episode_steps=3))
    initial = [store.initial for store in craft.stores]
    for _ in range(2):
        np.testing.assert_array_equal(np.array(engine.state.stores)[:, 0], initial)
        given = [torch.from_numpy(commands(craft, 8, seed=k)).float() for k in range(3)]
        steps = [engine.step(action) for action in given]
        assert steps[-1].truncated.all()


@pytest.fixture(scope="module", params=[0, 1, 4], ids=["cubesat", "lander", "both"])
def untrained(request) -> tuple[Spacecraft, Network]:
    """A craft and a policy for it."""
    craft = ALL[request.param]
    return craft, untrained_policy(craft)


def test_whole_flights_are_those_of_the_agent(untrained):
    craft, network = untrained
    task = rans.load_task(task_of(craft)).for_evaluation()
    timing = chosen(craft, Timing(episode_steps=25))
    setup = Setup(craft, task, timing)
    flight = fly(craft, task, Agent(network, "", craft), scenarios(task, craft, 7, 64), timing)
    for generated in (True, False):
        flown = Flights(network, setup, generated=generated).fly(0, 64, 7)
        assert flown.flights == 64
        assert flown.sums["impulse"].mean == pytest.approx(impulses(flight).mean(), rel=2e-3)


def test_exported_programs_command_in_the_ranges(untrained, tmp_path):
    craft, network = untrained
    seen = np.random.default_rng(0).normal(size=(5, 8, network.architecture.layout.width))
    seen = seen.astype(np.float32)
    saved = SavedPolicy(network, 0)
    write_agent(tmp_path, "numpy", saved, "title", craft=craft)
    module = module_of(tmp_path / "agent.py")
    pairs = golden(network, seen, craft)
    for row, command in zip(pairs["observation"], pairs["command"], strict=True):
        answered = np.asarray(module.Agent().act(np.array(row, np.float32)[None])).ravel()
        np.testing.assert_allclose(answered, command, rtol=0, atol=1e-5)
    low, high = np.array([(one.low, one.high) for one in craft.commands]).T
    given = np.array(pairs["command"])
    assert (given >= low - 1e-6).all()
    assert (given <= high + 1e-6).all()
    assert np.ptp(given[:, -1]) > 0.1 * (high[-1] - low[-1])


def test_metrics_tell_of_propellant_and_wheels():
    """By hand: full thrust of all eight for 5 s, and a wheel that is filled up to its limit."""
    task = rans.GoToPose()
    timing = Timing(episode_steps=25)
    full = Played(lambda _, count: np.tile([one.high for one in BOTH.commands], (count, 1)))
    flight = fly(BOTH, task, full, scenarios(task, BOTH, 5, 3), timing)
    found = {one.name: one.values for one in samples(flight)}
    used = 8.0 * 5.0 / (20.0 * 9.80665)
    np.testing.assert_allclose(found["propellant"], used, rtol=1e-9)
    np.testing.assert_allclose(found["wheel momentum"], 100.0, rtol=1e-12)
    np.testing.assert_allclose(found["duty"], 100.0)
    assert found["on-time"].tolist() == [40.0] * 3


def test_optimal_control_keeps_to_throttle_levels():
    """Always lit at 10 to 90 %: no command of the optimum is beyond, and some are at both ends."""
    from rans_optimal.objectives import MinimumFuel
    from rans_optimal.transcription import Transcription

    from rans.model.actuators import Throttle
    from tests.support.effector_crafts import platform

    craft = platform(actuators=Throttle(0.1, 0.9, always_lit=True))
    task = rans.GoToPose()
    starts = scenarios(task.for_evaluation(), craft, 0, 1)
    from rans.episode.scenario import each

    (one,) = each(starts)
    found = Transcription(craft, task, MinimumFuel()).solve(one.start, one.goal)
    assert found.solved
    assert found.commands.min() == pytest.approx(0.1, abs=1e-6)
    assert 0.5 < found.commands.max() <= 0.9


def test_a_policy_without_wheels_has_no_view_to_turn():
    from rans.policy.symmetry import symmetries

    assert symmetries(replace(WHEELED, wheels=())) is not None
    assert symmetries(WHEELED) is None
