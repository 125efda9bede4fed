"""Agents with a fixed trade-off, which are compared with agents without one."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.episode.flight import Controller, informed
from rans.randomization.conditions import Conditions


class FixedTradeOff:
    """An agent whose observation is that of a task without a trade-off, followed by its fixed trade-off."""

    def __init__(self, agent: Controller, trade_off: float) -> None:
        self.name = f"{agent.name}#{trade_off:g}"
        self.trade_off = trade_off
        self._agent = agent

    def expecting(self, conditions: Conditions | None) -> FixedTradeOff:
        """This agent for flights under these conditions, if it can expect them (`rans.episode.flight.informed`)."""
        return FixedTradeOff(informed(self._agent, conditions), self.trade_off)

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._agent.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        trade_off = np.full((len(observation), 1), self.trade_off, observation.dtype)
        return self._agent.act(state, goal, np.hstack((observation, trade_off)))
