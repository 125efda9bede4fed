"""MuJoCo Playground's PointMass: a point is pushed through the plane to its centre; MuJoCo in JAX (MJX)."""

from __future__ import annotations

import jax
from jax_loop import device_name, loop_rate
from mujoco_playground import registry, wrapper
from stopwatch import options, say

_STEPS = 10
"""In one compiled loop."""


def main() -> None:
    """Measure and print."""
    given = options()
    engine = "jax" if given.device == "cpu" else "warp"  # warp, its default, is made for GPUs
    env = wrapper.wrap_for_brax_training(
        registry.load("PointMass", config_overrides={"impl": engine})
    )
    action = jax.random.uniform(jax.random.key(1), (given.num_envs, env.action_size), minval=-1.0)
    # its wrapper takes no keys of the new kind
    keys = jax.random.split(jax.random.PRNGKey(0), given.num_envs)
    first = jax.jit(env.step)(jax.jit(env.reset)(keys), action)
    rate = loop_rate(
        lambda state: env.step(state, action), first, given.num_envs, _STEPS, given.seconds
    )
    say(
        "playground",
        f"PointMass, {engine} backend, 50 Hz",
        f"jit of {_STEPS} steps of the batch, auto-reset, constant actions",
        given.num_envs,
        device_name(),
        steps_per_s=rate,
    )


if __name__ == "__main__":
    main()
