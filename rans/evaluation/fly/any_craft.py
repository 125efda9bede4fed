"""An agent for any craft in the setup of one craft: as a contestant, or as a run folder."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.base.files import package_version, ready_folder, replace_file, write_json, write_text
from rans.base.pretrained import ADAPTIVE, FOR_ANY_CRAFT
from rans.episode.flight import Controller
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.fast.agent_files.agent import AGENT, actor_bytes, read_policy
from rans.fast.learn.config import to_table
from rans.fast.learn.run_folder import RunFolder
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import to_toml
from rans.model.timing import Timing
from rans.policy.backbones import any_craft
from rans.policy.network import Network
from rans.policy.timing import flies_to_a_pose
from rans.tasks import registered_name
from rans.tasks.go_to_pose import GoToPose
from rans.tasks.go_to_position import GoToPosition

_ADAPTS = f"name one that can adapt, such as {ADAPTIVE}:{FOR_ANY_CRAFT[2]}"


def adapting(run: LoadedRun) -> LoadedRun:
    """The run of an agent for any craft that estimates lost thrusters and other masses (`rans.policy.adaptation`).

    Raises:
        ConfigError: it is another agent.
    """
    if not isinstance(run.controller, Agent):
        raise ConfigError(f"{run.controller.name} is no agent for any craft: {_ADAPTS}.")
    name = f"{ADAPTIVE}:{run.controller.name}"
    network = run.network
    if not network.architecture.authority:
        raise ConfigError(f"the agent flies its own spacecraft only: {_ADAPTS}.")
    network = Network(replace(network.architecture, adapts=True), network.tensors, at=network.at)
    return run._replace(controller=Agent(network, name, run.craft))


def flies_any_craft(folder: Path) -> bool:
    """Whether a run folder has an agent for any craft.

    Raises:
        ConfigError: its agent cannot be read.
    """
    return bool(read_policy(RunFolder(folder).agent_file).network.architecture.authority)


def frugal(run: LoadedRun, value: float) -> LoadedRun:
    """The run of an agent for any craft that takes more time to spend less thrust.

    Args:
        run: the agent, with the craft and the task that it flies.
        value: from 0, fast, to 1, frugal (`rans.policy.backbones.AnyCraft.frugal`).

    Raises:
        ConfigError: it is another agent, or the value is not from 0 to 1.
    """
    if not run.network.architecture.authority:
        raise ConfigError(
            f"the agent has no frugality from 0 to 1, as #{value:g} would be: name {FOR_ANY_CRAFT[2]} or "
            f"{FOR_ANY_CRAFT[3]}."
        )
    low, high = run.task.for_evaluation().spawn_distance  # type: ignore[attr-defined]  # it flies to a pose
    seconds = run.timing.control_period * run.timing.episode_steps
    bounds = run.task.tolerances()
    tolerances = bounds["position"], bounds["attitude"]
    network = any_craft().frugal(run.network, value, 0.5 * (low + high), seconds, tolerances)
    return run._replace(controller=Agent(network, f"{run.controller.name}#{value:g}", run.craft))


class AtAnyAttitude:
    """An agent that flies to poses in the task of flying to a position: it keeps the attitude that it has."""

    def __init__(self, agent: Controller, dimension: int) -> None:
        self.name = agent.name
        self._agent = agent
        self._turn = [1.0, 0.0] if dimension == 2 else [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        self._flag = len(self._turn) + 3 * dimension - 3

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._agent.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        pose = observation.copy()
        pose[:, self._flag] = GoToPose.flag
        pose[:, -len(self._turn) :] = self._turn
        return self._agent.act(state, goal, pose)


_UNITS: dict[str, dict[str, float]] = {
    "position_tolerance": {"mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "attitude_tolerance": {"deg": math.radians(1.0), "rad": 1.0},
}


def to_tolerances(run: LoadedRun, words: Iterable[str]) -> LoadedRun:
    """The run of an agent for any craft with tolerances such as 2cm and 2deg in its task.

    Raises:
        ConfigError: a word is none.
    """
    changes: dict[str, float] = {}
    for word in words:
        unit = word.lstrip("+-.0123456789")
        key = next((key for key, units in _UNITS.items() if unit in units), "")
        try:
            value = float(word.removesuffix(unit)) * _UNITS[key][unit]
        except (KeyError, ValueError):
            value = 0.0
        if not value > 0.0 or key in changes:
            raise ConfigError(
                "after # an agent for any craft takes a number from 0 (fast) to 1 (frugal), tolerances such as 2cm "
                f"and 2deg, one of each, and go-to-position, with commas between them, got {brief(word)}."
            )
        changes[key] = value
    return run._replace(task=replace(run.task, **changes))  # type: ignore[type-var]


def to_a_position(run: LoadedRun) -> LoadedRun:
    """The run of an agent for any craft in the task of flying to a position, with the same tolerance."""
    task = GoToPosition(position_tolerance=run.task.tolerances()["position"])
    return run._replace(controller=AtAnyAttitude(run.controller, run.craft.dimension), task=task)


def for_spacecraft(run: LoadedRun, craft: Spacecraft, timing: Timing | None = None) -> LoadedRun:
    """The run with another craft, in its own task, with the timing or else one for the craft.

    Any agent flies its own craft with a mass that moves in it, such as a sloshing liquid.

    Raises:
        ConfigError: the agent flies its own craft only, or cannot fly this one.
    """
    if _is_own_with_a_moving_mass(craft, run.craft):
        return run._replace(craft=craft, timing=timing or run.timing)
    if not isinstance(run.controller, Agent):
        raise ConfigError(
            f"{run.controller.name} flies its own spacecraft only: name {FOR_ANY_CRAFT[craft.dimension]} for "
            f"{craft.name}."
        )
    if not (run.network.architecture.authority or flies_to_a_pose(run.task, craft)):
        task = registered_name(run.task)
        who = f"no agent for {task} flies any craft: type lqr:{task}-{craft.dimension}d@FILE"
        if task == "go-to-position":
            who = f"any craft flies it: type {FOR_ANY_CRAFT[craft.dimension]}#{task}@FILE"
        raise ConfigError(
            f"{run.controller.name} flies its own spacecraft only, and {who}, or rans train {task} --spacecraft "
            "FILE."
        )
    timing = timing or any_craft().timing(craft, run.timing, None)
    network = any_craft().for_craft(run.network, craft, timing.control_period)
    agent = Agent(network, run.controller.name, craft)
    return run._replace(controller=agent, craft=craft, timing=timing)


def write_for_spacecraft(source: Path, run: LoadedRun, folder: Path) -> Path:
    """Write an agent for any craft, as it flies one, as a run folder, and return it.

    Args:
        source: run folder of the agent.
        run: the agent with what it flies (`for_spacecraft`, `adapting`, `frugal`).
        folder: to be written.

    Raises:
        ConfigError: the folder cannot be written.
    """
    steps = read_policy(RunFolder(source).agent_file).steps
    config, craft, network = RunFolder(source).config(), run.craft, run.network
    ready_folder(folder)
    content = actor_bytes(network.architecture, network.weights(), steps)
    replace_file(folder / AGENT, lambda draft: draft.write_bytes(content))
    table = to_table(replace(config, timing=run.timing, settings=run.task)) | {
        "spacecraft": craft.name,
        "rans": package_version("rans"),
    }
    write_json(folder / "config.json", table)
    write_text(folder / "spacecraft.toml", to_toml(craft))
    # The agent stays the same one; the other figures of the card are those of another craft.
    card = RunFolder(source).card().items()
    write_json(folder / "card.json", {key: x for key, x in card if key in ("name", "training")})
    return folder


def _is_own_with_a_moving_mass(craft: Spacecraft, own: Spacecraft) -> bool:
    """Whether a craft differs from an agent's own in a mass that moves, its name and its pictures only.

    Then the agent keeps its weights for its own craft, as the liquid is what it has to cope with.
    """
    if craft.is_rigid or craft.acting_effectors or craft.thruster_count != own.thruster_count:
        return False
    alike = np.allclose(craft.wrench_map, own.wrench_map, rtol=1e-9, atol=1e-12)
    passed = ("further_effectors", "name", "radius", "shape", "thrusters")
    same = replace(craft, **{key: getattr(own, key) for key in passed}) == own
    return same and alike and craft.supplies == own.supplies
