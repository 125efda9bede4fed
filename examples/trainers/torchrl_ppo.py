"""TorchRL's PPO on the batched environment behind its GymWrapper, without glue."""

from __future__ import annotations

import torch
from shared import N_ENVS, N_STEPS, Agent, Spacecraft, main
from tensordict.nn import (
    ProbabilisticTensorDictModule,
    ProbabilisticTensorDictSequential,
    TensorDictModule,
)
from torch.distributions import Bernoulli, Independent
from torchrl.envs import GymWrapper
from torchrl.modules import MLP, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

EPOCHS = 4
MINIBATCHES = 4


def valves(logits: torch.Tensor) -> Independent:
    """A choice a valve, of one action."""
    return Independent(Bernoulli(logits=logits), 1)


def train(steps: int) -> Agent:
    """An agent that was trained for so many steps."""
    envs = Spacecraft()
    count = envs.single_action_space.shape[0]
    env = GymWrapper(envs)
    layers = {"num_cells": [64, 64], "activation_class": torch.nn.Tanh}
    policy = ProbabilisticTensorDictSequential(
        TensorDictModule(MLP(out_features=count, **layers), ["observation"], ["logits"]),
        ProbabilisticTensorDictModule(
            ["logits"],
            ["action"],
            distribution_class=valves,
            return_log_prob=True,
            default_interaction_type="random",
        ),
    )
    critic = ValueOperator(MLP(out_features=1, **layers), in_keys=["observation"])
    state = env.reset()
    critic(policy(state.clone()))  # makes their weights
    advantage = GAE(gamma=0.98, lmbda=0.95, value_network=critic)
    loss = ClipPPOLoss(
        policy,
        critic,
        normalize_advantage=True,
        entropy_bonus=False,
        loss_critic_type="l2",
        critic_coeff=0.5,
    )
    adam = torch.optim.Adam(loss.parameters(), 1e-3)
    for _ in range(max(1, steps // (N_ENVS * N_STEPS))):
        with torch.no_grad():
            rollout = env.rollout(
                N_STEPS, policy, auto_reset=False, tensordict=state, break_when_any_done=False
            )
            state = env.step_mdp(rollout[:, -1])
            advantage(rollout)
        flat = rollout.reshape(-1)
        for _ in range(EPOCHS):
            for some in torch.randperm(len(flat)).chunk(MINIBATCHES):
                found = loss(flat[some])
                adam.zero_grad()
                (found["loss_objective"] + found["loss_critic"]).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
                adam.step()
    return Agent(lambda rows: policy[0](rows) > 0, policy[0])


if __name__ == "__main__":
    main(train)
