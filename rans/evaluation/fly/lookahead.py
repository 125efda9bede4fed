"""An agent that looks ahead: it flies in its mind what it might do, and does what pays most."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.episode import World, step
from rans.errors import ConfigError, checked, is_finite
from rans.evaluation.fly.agent import Agent, LoadedRun
from rans.fast.learn.selection import likeliest
from rans.model.actuators import ON_OFF
from rans.model.fields import map_leaves
from rans.tasks import GoToPosePriced
from rans.tasks.derived import paid

PREFIX = "lookahead"
"""Before an agent's text, with a colon: the same agent, looking ahead."""
HORIZON = 8.0
"""How far it looks, s: going to a pose takes about six, and what rest there is worth shows soon after."""


class Lookahead:
    """An agent that weighs its own command against those that differ from it in one thruster.

    >>> rans.Lookahead(rans.load_agent("go-to-pose-2d-fast"), horizon=4.0)
    <Lookahead: go-to-pose-2d-fast, 4 s ahead>

    Of these it takes the one after which it earns most within the horizon if it goes on as it is used to: one
    step of policy improvement, the rollout algorithm (Bertsekas, Tsitsiklis and Wu, "Rollout algorithms for
    combinatorial optimization", J. Heuristics 3, 1997). What is earned are the task's rewards, undiscounted,
    in a perfect world from the state that sensors tell. Its own command stands where none is better.

    Args:
        run: an agent, and what it flies; its conditions are not looked at.
        horizon: how far it looks, s, rounded up to whole control periods.

    Raises:
        ConfigError: it is no trained agent or has a knob, thrusters are not on or off, or the horizon is no
            finite number > 0.
    """

    slow = True
    """Many episodes are flown by many processes."""

    def __init__(self, run: LoadedRun, horizon: float = HORIZON) -> None:
        agent, craft, task, timing, _ = checked("who looks ahead", run, LoadedRun)
        if not isinstance(agent, Agent):
            raise ConfigError(f"{agent.name} cannot look ahead: only trained agents do.")
        if isinstance(task, GoToPosePriced):
            raise ConfigError(f"{agent.name} cannot look ahead: it has a knob; name an agent of one price.")
        if craft.actuators != ON_OFF:
            raise ConfigError(f"{agent.name} cannot look ahead: it would open and shut single thrusters, and "
                              f"those of {craft.name} are {craft.actuators.kind}.")
        if not (is_finite(horizon) and horizon > 0):
            raise ConfigError(f"the horizon must be finite and > 0 s, got {horizon!r}.")
        self.name, self._horizon = f"{PREFIX}:{agent.name}", horizon
        self._network, self._world = agent.network, World(craft, task, timing)
        self._periods = math.ceil(horizon / timing.control_period - 1e-9)
        count = len(craft.thrusters)
        self._flips = torch.cat((torch.zeros(1, count), torch.eye(count)))
        self.reset(0)

    def __repr__(self) -> str:
        return f"<Lookahead: {self.name.removeprefix(f'{PREFIX}:')}, {self._horizon:g} s ahead>"

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; an agent with a memory forgets."""
        self._memory, self._last = self._network.blank(count), np.zeros((count, self._flips.shape[1]))

    @torch.no_grad()
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the observation and at the state."""
        count, choices = len(observation), len(self._flips)
        # Every episode so often as there are choices, its own command first.
        seen = torch.from_numpy(np.repeat(observation, choices, axis=0))
        memory = None if self._memory is None else self._memory.repeat_interleave(choices, dim=0)
        output, columns = self._network.shown(seen, memory)
        command = (output.policy.mode() - self._flips.repeat(count, 1)).abs()
        after = self._network.remember(columns, memory, command, output)
        here, there = (map_leaves(lambda x: np.repeat(x, choices), s) for s in (state, goal))
        worth = self._worth(here, there, command, after).reshape(count, choices)
        best = np.arange(count) * choices + worth.argmax(axis=1)
        self._memory, self._last = None if after is None else after[best], command[best].double().numpy()
        return self._last

    def _worth(self, state: Any, goal: Any, command: Tensor, memory: Tensor | None) -> np.ndarray:
        """(M,) what is earned after commands (M, thrusters), with what the agent remembers after them."""
        now = self._world.begin(state, goal)
        if now.commands:  # the reward looks at what was open before
            now = replace(now, commands=(tuple(np.repeat(self._last, len(self._flips), axis=0).T),))
        earned, lost = np.zeros(len(command)), np.zeros(len(command), dtype=bool)
        for _ in range(self._periods):
            outcome = step(self._world, now, tuple(command.double().numpy().T))
            now = outcome.episode
            earned += np.where(lost, 0.0, paid(outcome.terms, outcome.terminated)[1])
            lost |= outcome.terminated
            seen = np.stack(self._world.observe(now), axis=1).astype(np.float32)
            command, memory = likeliest(self._network, torch.from_numpy(seen), memory)
        return earned
