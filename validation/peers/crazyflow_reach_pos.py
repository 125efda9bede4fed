"""Crazyflow's DroneReachPos-v0: a quadrotor flies to a goal."""

from __future__ import annotations

import crazyflow
import gymnasium
import jax
from jax_loop import device_name
from stopwatch import options, say, steps_per_second

_FREQUENCY = 500
"""Control commands a second, the simulator's own rate: one integration step an environment step."""
_STEPS = 10


def main() -> None:
    """Measure and print."""
    given = options()
    envs = gymnasium.make_vec(
        "DroneReachPos-v0",
        num_envs=given.num_envs,
        freq=_FREQUENCY,
        device="gpu" if given.device == "cuda" else "cpu",
    )
    envs.reset(seed=0)
    action = jax.numpy.asarray(envs.action_space.sample())

    def steps() -> None:
        jax.block_until_ready([envs.step(action) for _ in range(_STEPS)])

    say(
        "crazyflow",
        f"DroneReachPos-v0, {crazyflow.Dynamics.so_rpy.value}, {_FREQUENCY} Hz",
        "step of its vector environment, auto-reset, constant actions",
        given.num_envs,
        device_name(),
        steps_per_s=steps_per_second(steps, _STEPS * given.num_envs, given.seconds),
    )


if __name__ == "__main__":
    main()
