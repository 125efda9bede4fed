"""TorchRL's PPO on the batched environment behind its GymWrapper, without glue."""

from __future__ import annotations

import argparse

import gymnasium
import torch
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

import rans  # registers the environments

N_ENVS = 128
N_STEPS = 64
EPOCHS = 4
MINIBATCHES = 4


def valves(logits: torch.Tensor) -> Independent:
    """A choice a valve, of one action."""
    return Independent(Bernoulli(logits=logits), 1)


def train(steps: int) -> list[float]:
    """Mean reward of a step in every rollout."""
    torch.manual_seed(0)
    envs = gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=N_ENVS)
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
    loss = ClipPPOLoss(policy, critic)
    adam = torch.optim.Adam(loss.parameters(), 1e-3)
    told = []
    for _ in range(max(1, steps // (N_ENVS * N_STEPS))):
        with torch.no_grad():
            rollout = env.rollout(
                N_STEPS, policy, auto_reset=False, tensordict=state, break_when_any_done=False
            )
            state = env.step_mdp(rollout[:, -1])
            advantage(rollout)
        told.append(float(rollout["next", "reward"].mean()))
        flat = rollout.reshape(-1)
        for _ in range(EPOCHS):
            for some in torch.randperm(len(flat)).chunk(MINIBATCHES):
                found = loss(flat[some])
                adam.zero_grad()
                (found["loss_objective"] + found["loss_critic"]).backward()
                adam.step()
    return told


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    for number, reward in enumerate(train(parser.parse_args().steps)):
        print(f"rollout {number}: mean reward of a step {reward:.3f}")
