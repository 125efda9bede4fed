"""What a flight remembers belongs to the flight: flights of one object that meet end as they do alone."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import rans

SEEDS = 1, 2
PERIODS = 12
"""Control periods of a flight: as many as every memory needs to differ from an empty one."""


@pytest.mark.parametrize(
    "who", ["go-to-pose-2d-faults", "switching:go-to-pose-2d", "mpc:go-to-pose-2d"]
)
def test_pilots_of_one_agent_by_turns(who):
    """With an evaluation in between, and with more environments than one."""
    agent = rans.load_agent(who)

    def flights(seeds):
        envs = [gymnasium.make("rans/GoToPose2D-v0", task=agent.task) for _ in seeds]
        seen = [env.reset(seed=seed)[0] for env, seed in zip(envs, seeds, strict=True)]
        pilots = [rans.Pilot(agent, env) for env in envs]
        given = []
        for k in range(PERIODS):
            given.append([pilot.act(x) for pilot, x in zip(pilots, seen, strict=True)])
            seen = [env.step(act)[0] for env, act in zip(envs, given[-1], strict=True)]
            if len(seeds) > 1 and k == PERIODS // 2:
                agent.fly(3)
        return np.array(given)

    together = flights(SEEDS)
    for k, seed in enumerate(SEEDS):
        np.testing.assert_array_equal(together[:, k], flights((seed,))[:, 0])
