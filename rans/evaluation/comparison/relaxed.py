"""Relaxed optima: trajectories whose thrust may be anything between shut and open, flown in Drake.

They are locally optimal, know the future and, but for the greatest reward, arrive at the exact goal:
marks to measure by, neither controllers nor certificates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rans.evaluation.comparison.protocol import Protocol
from rans.evaluation.metrics import final_errors, impulses, settling_times
from rans.fields import map_leaves
from rans.flight import Flight
from rans.optimal.objectives import MaximumReward, MinimumFuel, MinimumTime, Objective
from rans.optimal.pool import solve_all
from rans.optimal.transcription import Trajectory
from rans.reference.flight import replay
from rans.timing import Timing


@dataclass(frozen=True)
class Relaxed:
    """One optimum from one start; NaN for what an unsolved problem does not have."""

    objective: Objective
    start: int
    status: str
    """How the optimiser ended."""
    solved: bool
    seconds: float
    """Wall time of the optimiser."""
    arrival: float = math.nan
    """At the exact goal, s."""
    settling: float = math.nan
    """When all errors enter their tolerances for good, in Drake, s."""
    thrust: float = math.nan
    """Thrust-time, N s."""
    total: float = math.nan
    """Sum of the task's rewards over the episode, in Drake; NaN if it acts at a rate of its own."""
    replay_error: float = math.nan
    """Largest distance between the optimised path and the one flown in Drake, m."""
    errors: dict[str, float] | None = None
    """Mean over the last fifth, in Drake, SI units."""


def objectives(protocol: Protocol, horizons: Sequence[float]) -> list[Objective]:
    """Least time, least thrust-time for each horizon (s), and the greatest sum of the task's rewards."""
    period = protocol.timing.control_period
    greatest: Any = MaximumReward(protocol.duration, period)
    return [MinimumTime(), *(MinimumFuel(horizon, period) for horizon in horizons), greatest]


def solve(protocol: Protocol, objective: Objective, workers: int | None = None,
          progress: Callable[[], object] = lambda: None) -> list[Relaxed]:
    """The optimum from every start.

    Args:
        protocol: gives the starts.
        objective: what to minimise.
        workers: see `rans.optimal.pool.solve_all`.
        progress: called once per start.
    """
    [trajectories] = solve_all(protocol.craft, protocol.task, [objective], protocol.starts, workers, progress)
    return [_flown(protocol, objective, k, trajectory) for k, trajectory in enumerate(trajectories)]


def _flown(protocol: Protocol, objective: Objective, k: int, trajectory: Trajectory) -> Relaxed:
    head = (objective, k, trajectory.status, trajectory.solved, trajectory.seconds)
    if not trajectory.solved:
        return Relaxed(*head)
    flight = _in_drake(protocol, k, trajectory)
    planned = len(trajectory.commands)
    same_rate = math.isclose(trajectory.control_period, protocol.timing.control_period)
    gap = map_leaves(lambda x: x[:planned + 1, 0], flight.states).p - trajectory.states.p
    total = float(np.sum(list(flight.rewards().values())))
    return Relaxed(
        *head, arrival=planned * trajectory.control_period, settling=float(settling_times(flight)[0]),
        thrust=float(impulses(flight)[0]), total=total if same_rate else math.nan,
        replay_error=float(np.max(gap.norm())),
        errors={name: float(error[0]) for name, error in final_errors(flight).items()})


def _in_drake(protocol: Protocol, k: int, trajectory: Trajectory) -> Flight:
    """The trajectory flown open loop for a whole episode, thrusters shut once it has arrived."""
    period, planned = trajectory.control_period, len(trajectory.commands)
    steps = max(planned, math.ceil(protocol.duration / period - 1e-9))
    commands = np.vstack([trajectory.commands, np.zeros((steps - planned, trajectory.commands.shape[1]))])
    own = Timing(control_period=period, episode_steps=steps)
    begin = protocol.start(k)
    states = replay(protocol.craft, map_leaves(lambda x: float(x[0]), begin.start), commands, own)
    return Flight(protocol.craft, protocol.task, own, map_leaves(lambda x: x[:, None], states), begin.goal,
                  commands[:, None], trajectory.objective, "drake")
