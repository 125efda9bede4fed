"""An agent as a module of Basilisk: its frames by hand, golden pairs through messages, and flights."""

from __future__ import annotations

import importlib
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rans.base.pretrained import pretrained_folder
from rans.base.registry import typed
from rans.deploy.columns import state_quantities
from rans.deploy.export import write_export
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.metrics import impulses
from rans.extend import Setup, is_installed, map_leaves
from rans.model.fields import unflatten

AGENT = pretrained_folder("go-to-pose-3d")
FORM = typed("rans_missions.basilisk_module:write_basilisk")
PERIOD = 200_000_000
"""Control period, ns."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("basilisk")
    write_export(AGENT, folder, FORM, episodes=8)
    return folder


@pytest.fixture
def file(folder, monkeypatch) -> Any:
    """The exported file as a module."""
    if not is_installed("Basilisk"):  # frames are tested without it
        parts: Any = SimpleNamespace(messaging=None, sysModel=SimpleNamespace(SysModel=object))
        monkeypatch.setitem(sys.modules, "Basilisk.architecture", parts)
    monkeypatch.syspath_prepend(folder)
    return importlib.import_module("agent_basilisk")


def send(module: Any, now: float, own: dict[str, Any], goal: dict[str, Any]) -> None:
    """Let a module have messages of a state and of a goal that does not move, as golden.json has them."""
    messaging = importlib.import_module("Basilisk.architecture.messaging")

    def message(name: str, **fields: Any) -> Any:
        return getattr(messaging, name)().write(getattr(messaging, f"{name}Payload")(**fields))

    sigma, sigma_goal = (
        Rotation.from_quat(one["attitude"], scalar_first=True).as_mrp() for one in (own, goal)
    )
    p, v, w = (own[name] for name in ("position", "velocity", "spin"))
    attitude = message("NavAttMsg", timeTag=now, sigma_BN=sigma, omega_BN_B=w)
    module.navAttInMsg.subscribeTo(attitude)
    module.navTransInMsg.subscribeTo(message("NavTransMsg", timeTag=now, r_BN_N=p, v_BN_N=v))
    module.attRefInMsg.subscribeTo(message("AttRefMsg", sigma_RN=sigma_goal))
    module.transRefInMsg.subscribeTo(message("TransRefMsg", r_RN_N=goal["position"]))


def test_frames_by_hand(file):
    """A quarter about z lets B's x point along N's y; a third about the diagonal turns x to y and y to z."""
    quarter = file.rotation((0.0, 0.0, np.sqrt(2.0) - 1.0))
    np.testing.assert_allclose(quarter[:, 0], (0.0, 1.0, 0.0), atol=1e-15)
    third = np.full(3, 1.0 / 3.0)
    for same in (third, -third / (third @ third)):  # and its shadow set
        np.testing.assert_allclose(file.rotation(same), np.eye(3)[[2, 0, 1]], atol=1e-15)


def test_golden_pairs_through_messages(file, folder):
    pytest.importorskip("Basilisk")
    module = file.AgentModule()
    pairs = json.loads((folder / "golden.json").read_text("utf-8"))
    rows = zip(*(pairs[name] for name in ("begins", "state", "goal", "command")), strict=True)
    for k, (begins, own, goal, command) in enumerate(rows):
        if begins:
            module.Reset(k * PERIOD)
        send(module, k * 0.2, own, goal)
        for now in (k * PERIOD, k * PERIOD + 1):  # the second changes nothing
            module.UpdateState(now)
            on_times = module.onTimeOutMsg.read().OnTimeRequest[: len(command)]
            np.testing.assert_array_equal(on_times, np.array(command) * 0.2)
    assert k == 499
    module.UpdateState((k + 3) * PERIOD)  # readings are old
    assert not any(module.onTimeOutMsg.read().OnTimeRequest)


@pytest.mark.slow
def test_flights_in_basilisk(file):
    """Basilisk and the fast engine solve the same of 64 starts, with impulse within 2 % in every flight."""
    simulation = pytest.importorskip("Basilisk.simulation")
    utilities = pytest.importorskip("Basilisk.utilities.SimulationBaseClass")
    for name in ("simpleNav", "spacecraft", "thrusterDynamicEffector"):
        importlib.import_module(f"Basilisk.simulation.{name}")
    run = load_policy(AGENT)
    craft = run.craft
    own = fly_episodes(run.controller, Setup(craft, run.task.for_evaluation(), run.timing), 7, 64)
    sim = utilities.SimBaseClass()
    sim.CreateNewProcess("all").addTask(sim.CreateNewTask("all", PERIOD // 20))
    flights = []
    for k in range(64):
        start, goal = (
            state_quantities(map_leaves(lambda x, k=k: float(np.ravel(x)[k]), one))
            for one in (own.states, own.goals)
        )
        body = simulation.spacecraft.Spacecraft()
        body.hub.mHub = craft.mass
        body.hub.IHubPntBc_B = np.array(craft.inertia)
        body.hub.r_CN_NInit = start["position"]
        body.hub.sigma_BNInit = Rotation.from_quat(start["attitude"], scalar_first=True).as_mrp()
        thrusters = simulation.thrusterDynamicEffector.ThrusterDynamicEffector()
        for thruster in craft.thrusters:
            nozzle = simulation.thrusterDynamicEffector.THRSimConfig()
            nozzle.MaxThrust = thruster.force
            nozzle.steadyIsp = 300.0  # without a tank nothing depends on it
            nozzle.thrLoc_B = np.subtract(thruster.position, craft.centre_of_mass)
            nozzle.thrDir_B = thruster.direction
            thrusters.addThruster(nozzle)
        body.addDynamicEffector(thrusters)
        navigation = simulation.simpleNav.SimpleNav()
        navigation.scStateInMsg.subscribeTo(body.scStateOutMsg)
        module = file.AgentModule()
        send(module, 0.0, start, goal)
        module.navAttInMsg.subscribeTo(navigation.attOutMsg)
        module.navTransInMsg.subscribeTo(navigation.transOutMsg)
        thrusters.cmdsInMsg.subscribeTo(module.onTimeOutMsg)
        logs = body.scStateOutMsg.recorder(PERIOD), module.onTimeOutMsg.recorder(PERIOD)
        # A command is of the state at its instant: larger numbers go first.
        flights.append((*logs, module, navigation, body, thrusters))
        for number, model in enumerate(flights[-1]):
            sim.AddModelToTask("all", model, number)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(PERIOD * len(own.commands))
    sim.ExecuteSimulation()
    rows = []
    commands = []
    for states, times, *_ in flights:
        turned = Rotation.from_mrp(states.sigma_BN).as_quat(scalar_first=True)
        rows.append(np.hstack([states.r_CN_N, turned, states.v_CN_N, states.omega_BN_B]))
        commands.append(times.OnTimeRequest[:-1, : craft.command_count] / 0.2)
    flight = replace(
        own,
        states=unflatten(own.states, [*np.transpose(rows, (2, 1, 0))]),
        commands=np.stack(commands, axis=1),
    )
    assert own.verdict.solved.sum() > 60
    np.testing.assert_array_equal(flight.verdict.solved, own.verdict.solved)
    np.testing.assert_allclose(impulses(flight), impulses(own), rtol=0.02)
