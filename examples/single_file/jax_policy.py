"""A policy in JAX on `rans.Engine`: tensors and arrays share memory by DLPack, on a CPU or a GPU.

``pip install jax`` (``jax[cuda13]`` for a GPU), then ``python jax_policy.py``: a law written in `jax.numpy` flies
4,096 floating platforms to their poses. Put a network of Flax or Equinox in place of `law`; nothing else changes.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import torch

import rans

SPEED = 0.6
"""Largest speed towards the goal, m/s."""


@jax.jit
def law(observation: jax.Array, changes: jax.Array) -> jax.Array:
    """Commands (N, 8), 0 or 1, to observations (N, 10) of go-to-pose in the plane.

    Args:
        observation: cos and sin of the heading, velocity in W, spin, task flag, displacement to the goal in W,
            cos and sin of the turn that is left; `rans list go-to-pose` names the columns.
        changes: (8, 3), what each open valve changes in a control period: velocity in B, m/s, and spin, rad/s.
    """
    cosine, sine, v_x, v_y, spin, _, d_x, d_y, cos_left, sin_left = observation.T
    distance = jnp.hypot(d_x, d_y)
    pull = jnp.minimum(SPEED, 0.5 * distance) / jnp.maximum(distance, 1e-6)
    x, y = pull * d_x - v_x, pull * d_y - v_y
    turn = jnp.clip(0.7 * jnp.arctan2(sin_left, cos_left), -0.5, 0.5) - spin
    sizes = jnp.abs(changes).max(axis=0)
    wanted = jnp.stack((cosine * x + sine * y, cosine * y - sine * x, turn)) / sizes[:, None]
    return ((changes / sizes @ wanted).T > 1.0).astype(jnp.float32)


def main() -> None:
    """Fly one episode of every platform, and print how many end within the tolerances."""
    device = "cuda" if torch.cuda.is_available() else "cpu"
    engine = rans.Engine("floating-platform", "go-to-pose", num_envs=4096, device=device)
    craft = engine.craft
    period = engine.timing.control_period
    inertia = jnp.array((craft.mass, craft.mass, craft.inertia[2][2]))
    changes = jnp.array(craft.wrench_map) / inertia * period
    observation = engine.observe()
    ended, won = 0.0, 0.0
    for _ in range(engine.timing.episode_steps):
        # The engine overwrites its tensors in the next step: both sides are done with them before it.
        action = law(jax.dlpack.from_dlpack(observation.contiguous()), changes).block_until_ready()
        step = engine.step(torch.from_dlpack(action))
        observation = step.observation
        ended += float((step.terminated | step.truncated).sum())
        won += float(step.at_goal.sum())
    print(f"{won / ended:.1%} of {ended:,.0f} end within the tolerances")


if __name__ == "__main__":
    main()
