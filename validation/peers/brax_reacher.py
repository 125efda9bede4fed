"""Brax's reacher: an arm of two links moves its tip to a goal in the plane."""

from __future__ import annotations

import jax
from brax import envs
from jax_loop import device_name, loop_rate
from stopwatch import options, say

_BACKEND = "spring"
"""The fastest of Brax's own on a CPU; "generalized", the default, is eight times slower."""
_STEPS = 10
"""In one compiled loop."""


def main() -> None:
    """Measure and print."""
    given = options()
    env = envs.create("reacher", episode_length=125, batch_size=given.num_envs, backend=_BACKEND)
    action = jax.random.uniform(jax.random.key(1), (given.num_envs, env.action_size), minval=-1.0)
    first = jax.jit(env.step)(jax.jit(env.reset)(jax.random.key(0)), action)
    rate = loop_rate(
        lambda state: env.step(state, action), first, given.num_envs, _STEPS, given.seconds
    )
    say(
        "brax",
        f"reacher, {_BACKEND} backend",
        f"jit of {_STEPS} steps of the batch, auto-reset, constant actions",
        given.num_envs,
        device_name(),
        steps_per_s=rate,
    )


if __name__ == "__main__":
    main()
