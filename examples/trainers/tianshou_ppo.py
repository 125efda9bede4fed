"""tianshou's PPO on the batched environment, which its collector takes for one vector environment."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from shared import N_ENVS, N_STEPS, Agent, Spacecraft, main
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import BaseVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.discrete import DiscreteActor, DiscreteCritic
from torch.distributions import Bernoulli, Independent


class VectorEnv(BaseVectorEnv):
    """The glue. Environments have begun their next episodes when the collector asks for a reset."""

    def __init__(self) -> None:
        self.envs, self.env_num = Spacecraft(), N_ENVS
        self.is_async, self.is_closed = False, False
        self.infos = np.array([{} for _ in range(N_ENVS)])

    def get_env_attr(self, key: str, id: Any = None) -> list[Any]:
        """The spaces."""
        return [getattr(self.envs, f"single_{key}")] * N_ENVS

    def reset(self, env_id: Any = None, **_: Any) -> tuple[np.ndarray, np.ndarray]:
        """First observations of all, or of those that ended in the last step."""
        if env_id is None:
            env_id = range(N_ENVS)
            self.rows = self.envs.reset(seed=0)[0].numpy()
        return self.rows[env_id], self.infos[env_id]

    def step(self, action: Any, id: Any = None) -> Any:
        """Last observations where an episode ended."""
        rows, reward, terminated, truncated, info = self.envs.step(torch.as_tensor(action))
        self.rows, done = rows.numpy(), terminated | truncated
        rows = torch.where(done[:, None], info["final_obs"], rows)
        return *(part.numpy() for part in (rows, reward, terminated, truncated)), self.infos


def valves(logits: torch.Tensor) -> Independent:
    """A choice a valve, of one action."""
    return Independent(Bernoulli(logits=logits), 1)


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    envs = VectorEnv()
    inputs = envs.get_env_attr("observation_space")[0].shape
    valve_space = envs.get_env_attr("action_space")[0]
    layers = {"state_shape": inputs, "hidden_sizes": [64, 64], "activation": torch.nn.Tanh}
    actor = DiscreteActor(
        preprocess_net=Net(**layers), action_shape=valve_space.shape, softmax_output=False
    )
    algorithm = PPO(
        policy=ProbabilisticActorPolicy(
            actor=actor,
            dist_fn=valves,
            action_space=valve_space,
            action_scaling=False,
            action_bound_method=None,
        ),
        critic=DiscreteCritic(preprocess_net=Net(**layers)),
        optim=AdamOptimizerFactory(lr=1e-3),
        gamma=0.98,
        ent_coef=0.0,
        max_grad_norm=1.0,
        max_batchsize=N_ENVS * N_STEPS,
    )
    rollout = N_ENVS * N_STEPS
    collector = Collector(algorithm, envs, VectorReplayBuffer(rollout, N_ENVS))
    collector.reset()
    algorithm.run_training(
        OnPolicyTrainerParams(
            max_epochs=1,
            epoch_num_steps=max(rollout, steps),
            training_collector=collector,
            collection_step_num_env_steps=rollout,
            batch_size=2048,
            update_step_num_repetitions=4,
            show_progress=False,
            verbose=False,
        )
    )
    return Agent(lambda rows: actor(rows)[0] > 0, actor)


if __name__ == "__main__":
    main(train)
