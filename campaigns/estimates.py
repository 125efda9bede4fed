"""How far off readings are, and what Kalman filters make of them (docs/decisions/robustness.md).

``python -m campaigns.estimates`` lets spacecraft start at rest and open a few valves at random, and prints
the root mean square errors of what a policy is shown, of readings and of filters, in noise and in `lab`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from campaigns.robustness import rows
from rans.episode import Setup, World, step
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.policy.filter_bank import Filters
from rans.scenario import draws, scenarios
from rans.tasks import GoToPose
from rans.tasks.base import observation
from rans.tasks.derived import layout
from rans.terminal import Terminal, table

DRIFTS = 0.001, 0.01, 0.1, 1.0
LOOKED_FOR: dict[str, tuple[float, float]] = {
    "": (0.0, 0.0),
    ", steady too": (25.0, 0.0),
    ", responses too": (25.0, 2.0),
}
"""Variances of steady accelerations and of responses that filters look for."""
_SETTLED = 30
_STEPS = 60
"""Periods after which errors count, and all of them."""
_SEED = 5


@dataclass(frozen=True)
class Estimates:
    """Print the errors of readings and of filters."""

    spacecraft: str = "free-flyer"
    """Name or file."""
    episodes: int = 512
    open: float = 0.003
    """Share of the thrusters that are open in a period, each by itself."""

    def run(self) -> int:
        """Print them."""
        for conditions in ("noise", "lab"):
            found = [
                (who, *(f"{x:.3f}" for x in errors))
                for who, errors in self.errors(conditions).items()
            ]
            heads = "what", "velocity, m/s", "spin, rad/s", "place, m", "rotation"
            Terminal(room=100).print(table(f"{self.spacecraft} in {conditions}", heads, found))
        return 0

    def errors(self, conditions: str) -> dict[str, list[float]]:
        """Root mean squares over flights, periods and columns: velocity, spin, place and the turn to go."""
        craft = load_spacecraft(self.spacecraft)
        task = GoToPose()
        timing = Timing()
        count = self.episodes
        seen = layout(task, craft.dimension)
        own = draws(_SEED, count)
        filters = {
            f"drift {one.drift:g}{name}": one
            for name, (steady, response) in LOOKED_FOR.items()
            for one in Filters.of(
                craft,
                task,
                timing.control_period,
                DRIFTS,
                [steady] * len(DRIFTS),
                [response] * len(DRIFTS),
            ).each
        }
        chosen = scenarios(task, craft, _SEED, count)
        random = np.random.default_rng(_SEED)
        world = World(Setup(craft, task, timing, rows()[conditions]))
        now = world.begin(chosen.start, chosen.goal, 0, own)
        memory = {name: [np.zeros(count)] * one.width(seen.body) for name, one in filters.items()}
        off = []
        shown = dict[str, list[np.ndarray]]()
        for _ in range(_STEPS):
            read = seen.in_body(world.observe(now, own))
            shown = {"reading": read} | {
                name: one.estimate(seen.body, read, memory[name]) for name, one in filters.items()
            }
            columns = seen.in_body(observation(task, now.state, now.goal))
            true = np.array([x * np.ones(count) for x in columns])
            off.append([np.array(told[: len(true)]) - true for told in shown.values()])
            command = tuple(
                (random.random((len(craft.thrusters), count)) < self.open).astype(float)
            )
            memory = {
                name: one.next_memory(seen.body, read, memory[name], command)
                for name, one in filters.items()
            }
            now = step(world, now, command, own).episode
        # Columns: velocity, angular velocity, the task's flag, place, rotation.
        axes = craft.dimension
        place = axes + len(now.state.spin()) + 1
        turn = place + axes
        size = 2 * (2 * axes - 3)
        parts = slice(axes), slice(axes, place - 1), slice(place, turn), slice(turn, turn + size)
        mean = np.square(off[_SETTLED:]).mean(axis=(0, 3))
        return {
            who: [float(np.sqrt(mean[i, part].mean())) for part in parts]
            for i, who in enumerate(shown)
        }


if __name__ == "__main__":
    import sys

    import tyro

    from campaigns.command import ended

    sys.exit(ended("python -m campaigns.estimates", tyro.cli(Estimates).run))
