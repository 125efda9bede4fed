"""skrl's PPO on the batched environment: a choice of two a valve."""

from __future__ import annotations

from typing import Any

import torch
from shared import N_ENVS, N_STEPS, Agent, Spacecraft, main
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, Model, MultiCategoricalMixin
from skrl.resources.preprocessors.torch import RunningStandardScaler
from skrl.resources.schedulers.torch import KLAdaptiveLR
from skrl.trainers.torch import SequentialTrainer
from torch import nn


def network(outputs: int) -> nn.Sequential:
    """Two layers of 64."""
    return nn.Sequential(
        nn.LazyLinear(64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )


class Actor(MultiCategoricalMixin, Model):
    """Two logits a valve."""

    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        MultiCategoricalMixin.__init__(self)
        self.net = network(2 * self.action_space.shape[0])

    def compute(self, inputs: Any, role: str = "") -> Any:
        """See skrl."""
        return self.net(inputs["observations"]), {}


class Critic(DeterministicMixin, Model):
    """The value."""

    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = network(1)

    def compute(self, inputs: Any, role: str = "") -> Any:
        """See skrl."""
        return self.net(inputs["observations"]), {}


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    env = wrap_env(Spacecraft(), wrapper="gymnasium", verbose=False)
    spaces = {
        "observation_space": env.observation_space,
        "action_space": env.action_space,
        "device": env.device,
    }
    models = {"policy": Actor(**spaces), "value": Critic(**spaces)}
    for model in models.values():
        model.net(torch.zeros(1, env.observation_space.shape[0]))  # makes its weights
    config = PPO_CFG(
        rollouts=N_STEPS,
        learning_epochs=4,
        mini_batches=4,
        discount_factor=0.98,
        learning_rate=1e-3,
        learning_rate_scheduler=KLAdaptiveLR,
        learning_rate_scheduler_kwargs={"kl_threshold": 0.016},
        value_preprocessor=RunningStandardScaler,
        value_preprocessor_kwargs={"size": 1, "device": env.device},
        value_loss_scale=0.5,
        time_limit_bootstrap=True,
    )
    config.experiment.write_interval = 0
    config.experiment.checkpoint_interval = 0
    memory = RandomMemory(memory_size=N_STEPS, num_envs=N_ENVS, device=env.device)
    agent = PPO(models=models, memory=memory, cfg=config, **spaces)
    timesteps = max(N_STEPS, steps // N_ENVS)
    SequentialTrainer(
        env=env,
        agents=agent,
        cfg={"timesteps": timesteps, "headless": True, "disable_progressbar": True},
    ).train()
    actor = models["policy"].net
    return Agent(lambda rows: actor(rows).unflatten(1, (-1, 2)).argmax(2), actor)


if __name__ == "__main__":
    main(train)
