"""PPO's loss (Schulman et al., 2017), equal to SB3's on the same minibatch."""

from __future__ import annotations

from typing import NamedTuple

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor
from torch.nn import functional

from rans.fast.learn.rollout import Batch
from rans.fast.policy import evaluate_seen


class Losses(NamedTuple):
    """The loss and what it is made of, by SB3's names; scalars."""

    loss: Tensor
    policy_gradient_loss: Tensor
    value_loss: Tensor
    entropy_loss: Tensor
    approx_kl: Tensor
    """Estimate of the divergence from the policy that collected (Schulman, "Approximating KL
    divergence", 2020)."""
    clip_fraction: Tensor


def ppo_loss(policy: ActorCriticPolicy, batch: Batch, clip_range: float, ent_coef: float,
             vf_coef: float, normalize_advantage: bool) -> Losses:
    """Clipped surrogate, squared value error and entropy bonus of one minibatch."""
    output = evaluate_seen(policy, batch.seen)
    advantage = batch.advantage
    if normalize_advantage:
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    log_ratio = output.log_prob(batch.action) - batch.log_prob
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1 - clip_range, 1 + clip_range)
    surrogate = -torch.minimum(advantage * ratio, advantage * clipped).mean()
    value = functional.mse_loss(batch.target, output.value)
    loss, entropy = surrogate + vf_coef * value, surrogate.detach() * 0.0
    if ent_coef != 0.0:
        entropy = -output.entropy().mean()
        loss = loss + ent_coef * entropy
    with torch.no_grad():
        approx_kl = ((ratio - 1) - log_ratio).mean()
        clip_fraction = ((ratio - 1).abs() > clip_range).to(ratio.dtype).mean()
    return Losses(loss, surrogate, value, entropy, approx_kl, clip_fraction)
