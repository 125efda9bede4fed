"""gymnax's PointRobot-misc: a point steps through the plane to a goal; it has no velocity."""

from __future__ import annotations

from typing import Any

import gymnax
import jax
from jax_loop import device_name, loop_rate
from stopwatch import options, say

_STEPS = 100
"""In one compiled loop."""


def main() -> None:
    """Measure and print."""
    given = options()
    env, parameters = gymnax.make("PointRobot-misc")
    keys = jax.random.split(jax.random.key(0), given.num_envs)
    action = jax.random.uniform(jax.random.key(1), (given.num_envs, 2), minval=-0.1, maxval=0.1)
    stepped = jax.vmap(env.step, in_axes=(0, 0, 0, None))

    def step(carried: Any) -> Any:
        keys, (_, state, *_) = carried
        keys = jax.vmap(lambda key: jax.random.split(key)[0])(keys)
        return keys, stepped(keys, state, action, parameters)

    _, state = jax.vmap(env.reset, in_axes=(0, None))(keys, parameters)
    first = keys, stepped(keys, state, action, parameters)
    rate = loop_rate(step, first, given.num_envs, _STEPS, given.seconds)
    say(
        "gymnax",
        "PointRobot-misc",
        f"jit of {_STEPS} steps of vmap, auto-reset, constant actions",
        given.num_envs,
        device_name(),
        steps_per_s=rate,
    )


if __name__ == "__main__":
    main()
