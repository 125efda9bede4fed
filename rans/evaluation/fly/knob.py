"""An agent with a knob, its knob held: it then flies what needs no knob, beside everybody else."""

from __future__ import annotations

from typing import Any

import numpy as np

from rans.evaluation.fly.agent import LoadedRun
from rans.flight import Controller
from rans.tasks import GoToPosePriced


class HeldKnob:
    """An agent that sees its knob where it is held, after all that a task without a knob shows."""

    def __init__(self, agent: Controller, knob: float) -> None:
        self.name = f"{agent.name}#{knob:g}"
        self.knob = knob
        self._agent = agent
        self.slow = getattr(agent, "slow", False)  # one that looks ahead

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._agent.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        knob = np.full((len(observation), 1), self.knob, observation.dtype)
        return self._agent.act(state, goal, np.hstack((observation, knob)))


def without_knob(run: LoadedRun) -> LoadedRun:
    """The same for the plain task if its knob is held, so that it is compared with whoever has none."""
    task = run.task
    if not (isinstance(task, GoToPosePriced) and task.is_held):
        return run
    return run._replace(controller=HeldKnob(run.controller, task.knob[0]), task=task.plain())
