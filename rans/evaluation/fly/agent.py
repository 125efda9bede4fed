"""A trained agent as a controller: the policy of a run folder, which flies on any engine.

Memory and weights are as in training: observations (N, width) float32 in, commands (N, n) out.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from rans.base.errors import ConfigError
from rans.effectors.commands import is_identity, of_outputs
from rans.episode.flight import Controller, informed
from rans.episode.safety_filters import safety_filter
from rans.episode.step import Guard, Setup
from rans.fast.agent_files.agent import read_policy
from rans.fast.learn.run_folder import RunFolder
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.policy.network import Network
from rans.randomization.conditions import Conditions
from rans.randomization.plausible import warn_of_implausible
from rans.tasks import Task
from rans.tasks.derived import layout
from rans.tasks.observation_terms import Layout


class Agent:
    """Controller that gives the deterministic actions of a policy: a network, on the CPU."""

    def __init__(self, network: Network, name: str, craft: Spacecraft | None = None) -> None:
        self.name = name
        self.network = network
        self.remark = ""
        """What flights of the craft decided about an agent for any craft, in a line; empty: nothing."""
        self._craft = craft
        """Spacecraft whose commands the agent gives; None: all of its commands are from 0 to 1."""
        self._as_designed = self
        """The agent as it was loaded, whatever conditions it expects."""
        self._memory: torch.Tensor | None = None

    def __repr__(self) -> str:
        return f"<Agent {self.name}>"

    def expecting(self, conditions: Conditions | None) -> Agent:
        """The agent for conditions: where thrusters fail, its network flies as its backbone does then."""
        designed = self._as_designed
        architecture = designed.network.architecture
        if conditions is None or not conditions.has_faults:
            return designed
        for_faults = architecture.kind.for_faults(architecture)
        if for_faults is architecture:
            return designed
        network = Network(for_faults, designed.network.tensors, at=designed.network.at)
        agent = Agent(network, self.name, self._craft)
        agent.remark = self.remark
        agent._as_designed = designed
        return agent

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`; an agent with a memory forgets."""
        self._memory = self.network.initial_state(count)

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) for observations (N, width).

        Remembers the policy's memory, and reads neither state nor goal.

        Raises:
            ConfigError: the observation has another width than those that it was trained on.
        """
        self.network.architecture.check_width(self.name, observation)
        command, self._memory = self.network.deterministic_action(
            torch.from_numpy(observation), self._memory
        )
        outputs = command.numpy()
        if self._craft is None or is_identity(self._craft):
            return outputs
        return np.stack(of_outputs(self._craft, tuple(outputs.T)), axis=1)


class LoadedRun(NamedTuple):
    """A controller with the setup that it was made for: the agent of a run, or another contestant."""

    controller: Controller
    craft: Spacecraft
    task: Task
    """Task with the settings of the training; for evaluation see `judged`."""
    timing: Timing
    conditions: Conditions | None = None
    """Randomization, disturbances, faults and sensor errors of its episodes; None: everything is as designed."""
    guard: Guard | None = None
    """Safety filter between the controller and the effectors; None: every command passes."""

    def __repr__(self) -> str:
        return f"<{self.controller.name}: {type(self.task).__name__} for {self.craft.name}>"

    @property
    def judged(self) -> Setup:
        """Setup of its evaluation: the task's evaluation starts, and integration as accurate as the craft needs.

        A timing with a single substep, the usual one of a training, is refined; a timing with more is kept.
        """
        timing = replace(self.timing, substeps=None) if self.timing.substeps == 1 else self.timing
        return Setup(self.craft, self.task.for_evaluation(), timing, self.conditions, self.guard)

    @property
    def network(self) -> Network:
        """Network of the agent.

        Raises:
            ConfigError: another contestant flies, which has none.
        """
        if not isinstance(self.controller, Agent):
            raise ConfigError(
                f"{self.controller.name} has no network of RANS: name a run folder or an agent that comes with it."
            )
        return self.controller.network

    def under(self, conditions: Conditions | None) -> LoadedRun:
        """The run under other conditions; None: under its own.

        A controller that can expect conditions is informed of them (`rans.episode.flight.informed`).
        """
        if conditions is None:
            return self
        loaded = conditions.or_none
        if loaded is not None:
            warn_of_implausible(loaded, self.craft)
        return self._replace(controller=informed(self.controller, loaded), conditions=loaded)

    def guarded(self, guard: bool = True) -> LoadedRun:
        """The run with the safety filter for its setup (`rans.safety_filters.safety_filter`), if ``guard``.

        Raises:
            ConfigError: the task has no constraints, or no filter knows the craft.
        """
        if guard:
            return self._replace(guard=safety_filter(self.judged))
        return self


def run_of(candidate: object) -> LoadedRun | None:
    """The object if it is a `LoadedRun`, else its ``run``, as of `rans.Agent`, or None."""
    result = candidate if isinstance(candidate, LoadedRun) else getattr(candidate, "run", None)
    return result if isinstance(result, LoadedRun) else None


def load_policy(path: Path) -> LoadedRun:
    """Load the agent in a run folder.

    Raises:
        ConfigError: the folder holds no run, or no policy that fits its spacecraft.
    """
    run = RunFolder(path)
    config = run.config()
    craft = run.spacecraft()
    if not run.agent_file.exists():
        raise ConfigError(
            f"{path} has no agent.safetensors: its training has not reached its first checkpoint "
            "yet, or was stopped before."
        )
    network = read_policy(run.agent_file).network
    _check_fit(network, craft, layout(config.settings, craft.dimension), run)
    return LoadedRun(
        Agent(network, path.resolve().name, craft),
        craft,
        config.settings,
        config.timing,
        config.conditions.or_none,
    )


def _check_fit(network: Network, craft: Spacecraft, expected: Layout, run: RunFolder) -> None:
    """Reject (`ConfigError`) an agent whose observation or commands are not those of its task and spacecraft."""
    architecture = network.architecture
    observed = architecture.layout.width
    commands = architecture.thrusters
    needed = expected.width, craft.command_count
    if (observed, commands) != needed:
        raise ConfigError(
            f"{run.agent_file} observes {observed} columns and gives {commands} commands, but "
            f"{run.spacecraft_file} needs {needed[0]} and {needed[1]}: they are of different runs."
        )
    if architecture.layout != expected:
        raise ConfigError(
            f"{run.agent_file} observes other columns than the task in {run.config_file} "
            "has: they are of different runs."
        )
    if architecture.continuous != craft.is_continuous:
        raise ConfigError(
            f"{run.agent_file} does not command the {craft.actuators.kind} actuators of "
            f"{run.spacecraft_file}: they are of different runs."
        )
