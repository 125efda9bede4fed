"""An agent for any craft in the setup of one craft: as a contestant, or as a run folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rans.errors import ConfigError
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.fast.agent_files.agent import AGENT, actor_bytes, read_policy
from rans.fast.learn.config import to_table
from rans.fast.learn.run_folder import RunFolder
from rans.files import read_json, ready_folder, replace_file, write_json, write_text
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import to_toml
from rans.model.timing import Timing
from rans.policy.any_craft import for_craft, is_for_any_craft
from rans.policy.any_craft import frugal as at_value
from rans.policy.network import Network
from rans.policy.timing import flies_to_a_pose, timing_for
from rans.pretrained import ADAPTIVE, FOR_ANY_CRAFT
from rans.tasks import Task, registered_name

_ADAPTS = f"name one that can adapt, such as {ADAPTIVE}:{FOR_ANY_CRAFT[2]}"


def adapting(run: LoadedRun) -> LoadedRun:
    """The run of an agent for any craft that estimates lost thrusters and other masses (`rans.policy.adaptation`).

    Raises:
        ConfigError: it is another agent, or no package with an estimator is installed.
    """
    if not isinstance(run.controller, Agent):
        raise ConfigError(f"{run.controller.name} is no agent for any craft: {_ADAPTS}.")
    name = f"{ADAPTIVE}:{run.controller.name}"
    agent = Agent(_adapting(run.network), name, run.craft)
    return run._replace(controller=agent)


def _adapting(network: Network) -> Network:
    if not is_for_any_craft(network.architecture):
        raise ConfigError(f"the agent flies its own spacecraft only: {_ADAPTS}.")
    return Network(replace(network.architecture, adapts=True), network.tensors, at=network.at)


def flies_any_craft(folder: Path) -> bool:
    """Whether a run folder has an agent for any craft.

    Raises:
        ConfigError: its agent cannot be read.
    """
    return is_for_any_craft(read_policy(RunFolder(folder).agent_file).network.architecture)


def frugal(run: LoadedRun, value: float) -> LoadedRun:
    """The run of an agent for any craft that takes more time to spend less thrust.

    Args:
        run: the agent, with the craft and the task that it flies.
        value: from 0, fast, to 1, frugal (`rans.policy.any_craft.frugal`).

    Raises:
        ConfigError: it is another agent, or the value is not from 0 to 1.
    """
    network = _frugal(run.network, value, run.task, run.timing)
    return run._replace(controller=Agent(network, f"{run.controller.name}#{value:g}", run.craft))


def _frugal(network: Network, value: float, task: Task, timing: Timing) -> Network:
    """The network at a frugality from 0 to 1, for the distances at which the task starts."""
    if not is_for_any_craft(network.architecture):
        raise ConfigError(
            f"the agent has no frugality from 0 to 1, as #{value:g} would be: name {FOR_ANY_CRAFT[2]} or "
            f"{FOR_ANY_CRAFT[3]}."
        )
    low, high = task.for_evaluation().spawn_distance  # type: ignore[attr-defined]  # it flies to a pose
    seconds = timing.control_period * timing.episode_steps
    bounds = task.tolerances()
    tolerances = bounds["position"], bounds["attitude"]
    return at_value(network, value, 0.5 * (low + high), seconds, tolerances)


def for_spacecraft(run: LoadedRun, craft: Spacecraft, timing: Timing | None = None) -> LoadedRun:
    """The run with another craft, in its own task, with the timing or else one for the craft (`timing_for`).

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
    if not (is_for_any_craft(run.network.architecture) or flies_to_a_pose(run.task, craft)):
        task = registered_name(run.task)
        raise ConfigError(
            f"{run.controller.name} flies its own spacecraft only, and no agent for {task} flies any craft: type "
            f"lqr:{task}-{craft.dimension}d@FILE, or rans train {task} --spacecraft FILE."
        )
    timing = timing or timing_for(craft, run.timing)
    network = for_craft(run.network, craft, timing.control_period)
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
    table = to_table(replace(config, timing=run.timing)) | {"spacecraft": craft.name}
    write_json(folder / "config.json", table)
    write_text(folder / "spacecraft.toml", to_toml(craft))
    # The agent stays the same one; the other figures of the card are those of another craft.
    card = read_json(source / "card.json")
    write_json(
        folder / "card.json", {key: card[key] for key in ("name", "training") if key in card}
    )
    return folder


def _is_own_with_a_moving_mass(craft: Spacecraft, own: Spacecraft) -> bool:
    """Whether a craft differs from an agent's own in a mass that moves, its name and its pictures only.

    Then the agent keeps its weights for its own craft, as the liquid is what it has to cope with.
    """
    if craft.is_rigid or craft.acting_effectors or craft.thruster_count != own.thruster_count:
        return False
    # Directions are normalised again when a file is read, which changes their last digits.
    alike = np.allclose(craft.wrench_map, own.wrench_map, rtol=1e-9, atol=1e-12)
    passed = ("further_effectors", "name", "radius", "shape", "thrusters")
    same = replace(craft, **{key: getattr(own, key) for key in passed}) == own
    return same and alike and craft.supplies == own.supplies
