"""A bound that comparisons set beside flights, and a command that prints it."""

from typing import Any

import numpy as np

from rans import load_spacecraft, scenarios
from rans.extend import (
    EVALUATION_SEED,
    Bound,
    Comparison,
    Contest,
    Options,
    Problem,
    Scenario,
    Spacecraft,
    SpacecraftLike,
    Table,
    Terminal,
    command_of,
)
from rans_example.task import KeepDistance


def least_times(craft: Spacecraft, task: KeepDistance, starts: Scenario) -> np.ndarray:
    """No flight from rest is at the distance sooner, (N,) s.

    All thrusters together push with at most the sum of their forces, and the table with f^2 r at its rim, so that
    accelerations are at most their sum a, and a way s takes sqrt(2 s / a).
    """
    most = sum(thruster.force for thruster in craft.thrusters) / craft.mass
    most += task.sag**2 * task.fail_distance
    way = task.errors(starts.start, starts.goal)["position"] - task.position_tolerance
    return np.sqrt(2.0 * np.maximum(way, 0.0) / most)


def add_bounds(comparison: Comparison, *, certified: int, **_: Any) -> None:
    """Add the least settling time of the first starts to a comparison, which then holds flights against it."""
    contest: Any = comparison.contest
    times = least_times(contest.craft, contest.task, contest.starts)[:certified]
    for start, time in enumerate(times.tolist()):
        comparison.certified.append(Bound(start, None, hull=time, kind="settling"))


def _is_bounded(contest: Contest) -> bool:
    """Whether nothing but thrusters and the table moves the craft."""
    return contest.conditions is None


KEEP_DISTANCE = Problem(_is_bounded, add_bounds)
"""Bounds of the task `KeepDistance`: `optimal_problem` of a task is the name of its entry point."""


def least(spacecraft: SpacecraftLike = "puck", episodes: int = 8) -> Table:
    """Say how soon a craft could be at the distance of keep-distance.

    Args:
        spacecraft: name, TOML file or `rans.Spacecraft`.
        episodes: number of starts.
    """
    craft, task = load_spacecraft(spacecraft), KeepDistance()
    times = least_times(craft, task, scenarios(task, craft, EVALUATION_SEED, episodes))
    rows = [(str(start), f"{time:.2f} s") for start, time in enumerate(times)]
    return Table(("start", "least time"), rows)


@command_of(least)
class Least(Options):
    """Print the least times of keep-distance, which no flight can beat."""

    group = "Limits"
    guide = "examples/plugin/README.md"
    examples = ("rans least --spacecraft puck",)
    following = ("rans compare steer:keep-distance-2d@puck",)

    def run(self) -> int:
        """Print them; the exit code is 0."""
        Terminal().table(self.call())
        return 0
