"""rejax's PPO, all of it compiled by JAX, on gymnax's PointRobot-misc with our preset's sizes."""

from __future__ import annotations

import jax
import rejax
from jax_loop import device_name
from ppo_settings import SETTINGS
from stopwatch import options, say, steps_per_second


def main() -> None:
    """Measure and print."""
    given = options()
    ours = SETTINGS[given.device]
    trainer = rejax.PPO.create(
        env="PointRobot-misc",
        num_envs=ours.n_envs,
        num_steps=ours.n_steps,
        num_epochs=ours.n_epochs,
        num_minibatches=ours.rollout // ours.batch_size,
        normalize_observations=True,
        total_timesteps=10**9,
        agent_kwargs={"hidden_layer_sizes": ours.layers, "activation": "tanh"},
    )
    state = trainer.init_state(jax.random.key(0))
    iteration = jax.jit(trainer.train_iteration)
    rate = steps_per_second(
        lambda: jax.block_until_ready(iteration(state)), ours.rollout, given.seconds
    )
    say(
        "rejax",
        "PointRobot-misc of gymnax",
        f"jit of one iteration, {ours}, actor and critic apart",
        ours.n_envs,
        device_name(),
        trained_steps_per_s=rate,
    )


if __name__ == "__main__":
    main()
