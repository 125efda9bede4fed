"""How much of the noise a filter takes off agents in space that were trained without one.

``python -m campaigns.filtered AGENT...`` flies each in noise and in `lab`, as it is and behind a Kalman
filter that knows the spacecraft as designed and its commands, and prints what is held of the same episodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tyro.conf import Positional

from campaigns.robustness import rows
from rans.episode import Setup, World, step
from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.measure.metrics import solved
from rans.flight import Controller, fly
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.randomization.conditions import Conditions
from rans.scenario import EVALUATION_SEED, draws, scenarios
from rans.terminal import Terminal, table

_DRIFT = 1e-3
"""Variance by which a velocity wanders in a period, in units of its noise's: little, in a known world."""
_PERIODS = 200
"""After so many the gains no longer change."""


def gains(period: float, drift: float = _DRIFT, count: int = _PERIODS) -> np.ndarray:
    """(count, 2, 2) gains of position and velocity, read with noise of one size, from the first reading on.

    Kalman, "A new approach to linear filtering and prediction problems", 1960: of an axis that moves on as
    its velocity says.
    """
    moves = np.array([[1.0, period], [0.0, 1.0]])
    noise = np.eye(2)
    wander = np.diag([drift * (0.5 * period) ** 2, drift])
    doubt = np.eye(2)
    found = [np.eye(2)]
    for _ in range(count - 1):
        doubt = moves @ doubt @ moves.T + wander
        found.append(doubt @ np.linalg.inv(doubt + noise))
        doubt = (np.eye(2) - found[-1]) @ doubt
    return np.array(found)


class Filtered:
    """A controller in space that is shown, for what sensors tell, what a Kalman filter makes of it.

    Translation and rotation are filtered alike: errors of attitude are rotation vectors in B.
    """

    def __init__(self, controller: Controller, setup: Setup) -> None:
        self.name = f"{controller.name}, filtered"
        self._controller = controller
        self._world = World(Setup(*setup[:3]))
        self._gains = gains(setup.timing.control_period)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._controller.reset(count)
        self._state: SpatialState | None = None
        self._periods = 0

    def act(self, state: SpatialState, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; of the observation nothing is used."""
        if self._state is None:
            self._state = state
        else:
            now = step(self._world, self._world.begin(self._state, goal), tuple(self._command.T))
            self._periods = min(self._periods + 1, len(self._gains) - 1)
            self._state = corrected(now.episode.state, state, self._gains[self._periods])
        seen = np.stack(self._world.observe(self._world.begin(self._state, goal)), axis=1).astype(
            np.float32
        )
        self._command = np.asarray(self._controller.act(self._state, goal, seen), dtype=np.float64)
        return self._command


def corrected(expected: SpatialState, measured: SpatialState, gain: np.ndarray) -> SpatialState:
    """The state expected, moved towards that measured by these gains (2, 2) of pose and velocity."""
    turn = expected.attitude.inverse().times(measured.attitude)
    side = np.where(
        np.asarray(turn.w) < 0.0, -2.0, 2.0
    )  # twice the vector part, the short way round
    off = (
        (measured.p - expected.p, measured.v - expected.v),
        (Vec3(turn.x * side, turn.y * side, turn.z * side), measured.w - expected.w),
    )
    moved, turned = (
        [pose.scale(row[0]) + velocity.scale(row[1]) for row in gain] for pose, velocity in off
    )
    half = turned[0].scale(0.5)
    small = Quat(np.ones_like(side), *half.columns()).normalised()
    return replace(
        expected,
        p=expected.p + moved[0],
        v=expected.v + moved[1],
        w=expected.w + turned[1],
        attitude=expected.attitude.times(small).normalised(),
    )


@dataclass(frozen=True)
class Behind:
    """Fly agents in space as they are and behind a filter; print what they hold."""

    agents: Positional[tuple[str, ...]]
    """Run folders, or pretrained:NAME."""
    episodes: int = 1024
    seed: int = EVALUATION_SEED

    def run(self) -> int:
        """Print it.

        Raises:
            ConfigError: there is no such agent, or it flies in the plane.
        """
        found = [
            (name, row, *(f"{held:.2f}" for held in self.held(name, rows()[row])))
            for name in self.agents
            for row in ("noise", "lab")
        ]
        Terminal(room=100).print(
            table("Held, %", ("agent", "in", "as it is", "behind the filter"), found)
        )
        return 0

    def held(self, name: str, conditions: Conditions) -> list[float]:
        """Shares of the same episodes, %, without and with the filter."""
        run = contestant(name)
        if run.craft.dimension != 3:
            raise ConfigError(
                f"{name} flies in the plane; the filter is one of attitudes in space."
            )
        craft, task, timing, _, _ = setup = run.judged
        starts = scenarios(task, craft, self.seed, self.episodes)
        own = draws(self.seed, self.episodes)
        flights = (
            fly(craft, task, one, starts, timing, conditions=conditions, draws=own)
            for one in (run.controller, Filtered(run.controller, setup))
        )
        return [100.0 * float(solved(flight).mean()) for flight in flights]


if __name__ == "__main__":
    import sys

    import tyro

    from campaigns.command import ended

    sys.exit(ended("python -m campaigns.filtered", tyro.cli(Behind).run))
