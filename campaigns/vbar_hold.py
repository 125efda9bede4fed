"""RANS's guidance on the hold-point approach of V-BAR, scored by V-BAR: ``python -m campaigns.vbar_hold``.

V-BAR (J. Hammoudeh, "Verified Benchmark for Autonomous Rendezvous", 2026) needs Python 3.12 or later, and is no
dependency of RANS. The scenario is ``approach-vbar`` of its suites, which asks for 600 s within 5 m and 5 cm/s. In
an environment of its own::

    python3.12 -m venv vbar
    vbar/bin/pip install vbar==0.3.1 cattrs tyro
    vbar/bin/python -m campaigns.vbar_hold
"""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import tyro

from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.control.mission_guidance import MissionGuidance
from rans.tasks.hold import Hold


@dataclass(frozen=True)
class Scored:
    """Fly V-BAR's episodes and print what V-BAR says of them."""

    episodes: int = 50
    """Number of episodes, of V-BAR's validation split, which its suites fly with 50."""
    deadline: Annotated[float, tyro.conf.arg(metavar="S")] = 1900.0
    """By when guidance plans to arrive, s. V-BAR allows an hour, of which the last ten minutes are the hold."""

    def run(self) -> None:
        """Print one line for V-BAR's own controller and one for guidance."""
        vbar: Any = importlib.import_module("vbar")
        agents: Any = importlib.import_module("vbar.agents")
        scenarios: Any = importlib.import_module("vbar.scenarios")
        seeds: Any = importlib.import_module("vbar.scenarios.seeds")
        for agent in (agents.PDAgent(), Guidance(self.deadline)):
            scenario = scenarios.make("approach-vbar")
            held, results = [], []
            for seed, own in seeds.SeedSplit("approach-vbar", "validation", self.episodes).pairs():
                results += vbar.run_many(scenario, agent, [seed], [own])
                # An episode ends once the dwell is complete, or after an hour.
                dwell = scenario.unwrapped.params.hold_time
                held.append(scenario.unwrapped.dwell >= dwell - 1e-9)
            entered = np.mean([one["keep_out_violated"] for one in results])
            spent = [one["dv_used_mps"] for one in results]
            time = np.mean([one["time_s"] for one in results])
            sys.stdout.write(
                f"{agent.name}: {self.episodes} episodes, held {100.0 * np.mean(held):.1f} %, keep-out entered "
                f"{100.0 * entered:.1f} %, {np.mean(spent):.3f} m/s (worst {np.max(spent):.3f}), {time:.0f} s\n"
            )
            sys.stdout.flush()


class Guidance:
    """Mission guidance as an agent of V-BAR: commands are shares of the largest acceleration along each axis."""

    name = "rans mission guidance"

    def __init__(self, deadline: float) -> None:
        hold = Hold().for_evaluation()
        assert isinstance(hold, Hold)
        self._task = replace(hold, deadline=(deadline, deadline))
        self._guidance = MissionGuidance(load_spacecraft("vbar-chaser"), self._task)
        self._deadline = deadline
        self._goal: Any = None

    def reset(self, view: Any, rng: np.random.Generator | None = None) -> None:
        """Begin an episode."""
        self._goal = None

    def act(self, obs: np.ndarray, info: Any) -> np.ndarray:
        """Three numbers from -1 to 1 for the relative state that V-BAR observes, m and m/s."""
        state = _state(obs[:3], obs[3:6])
        if self._goal is None:
            behind = np.array([0.0, -self._task.hold_distance, 0.0])
            goal = _state(behind, np.zeros(3))
            self._guidance.reset(1)
            self._goal = self._task.plan(state, goal, np.full(1, self._deadline))
        commands = self._guidance.act(state, self._goal, np.zeros((1, 0)))[0]
        # V-BAR's own clock counts the hold: guidance is not told of success or of an end.
        self._goal = self._task.later(self._goal, self._task.timing.control_period)
        # Thrusters are along x, -x, y, -y, z, -z.
        return commands[0::2] - commands[1::2]


def _state(p: np.ndarray, v: np.ndarray) -> SpatialState:
    """One craft at a position and velocity, without rotation."""
    zero = np.zeros(1)
    still = Vec3(zero, zero, zero)
    place, speed = (Vec3(*(zero + float(x) for x in one)) for one in (p, v))
    return SpatialState(place, Quat(zero + 1.0, zero, zero, zero), speed, still)


if __name__ == "__main__":
    tyro.cli(Scored).run()
