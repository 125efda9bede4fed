"""EnvPool's LunarLander-v3: a lander with three on/off engines comes down in the plane (Box2D)."""

from __future__ import annotations

import os

import envpool
import numpy as np
from stopwatch import options, say, steps_per_second


def main() -> None:
    """Measure and print."""
    given = options()
    threads = len(os.sched_getaffinity(0))
    envs = envpool.make_gymnasium(
        "LunarLander-v3", num_envs=given.num_envs, num_threads=threads, seed=0
    )
    envs.reset()
    action = np.random.default_rng(0).integers(envs.action_space.n, size=given.num_envs)
    say(
        "envpool",
        "LunarLander-v3, 50 Hz",
        f"step of all in C++, threads: {threads}, auto-reset, constant actions",
        given.num_envs,
        "cpu",
        steps_per_s=steps_per_second(lambda: envs.step(action), given.num_envs, given.seconds),
    )


if __name__ == "__main__":
    main()
