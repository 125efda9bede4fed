"""Minibatches, what a loss takes of them, and what it gives."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from rans.model.fields import Field


class Batch(NamedTuple):
    """Transitions to learn from."""

    columns: Tensor
    """Preprocessed observations, see `Network.look`."""
    action: Tensor
    """Actions of the thrusters, in the order of that view."""
    log_prob: Tensor
    advantage: Tensor
    target: Tensor
    """Value target: the advantage plus the value at collection."""
    memory: Tensor | None
    privileged: Tensor | None


class LossInputs(NamedTuple):
    """What the loss of a transition depends on: fields, (N,) each."""

    log_prob: Field
    """Log-probability of the action."""
    entropy: Field
    """Entropy of the policy, nats."""
    value: Field
    """The critic's value."""
    old_log_prob: Field
    """Log-probability of the action under the rollout's policy."""
    advantage: Field
    """Standardised advantage."""
    target: Field
    """Target of the value."""


class Losses(NamedTuple):
    """Loss and its parts, by the names of SB3: fields."""

    loss: Field
    """The only one whose gradient is descended."""
    policy_gradient_loss: Field
    value_loss: Field
    entropy_loss: Field
    approx_kl: Field
    """KL divergence from the policy of the rollout (Schulman, "Approximating KL divergence", 2020)."""
    clip_fraction: Field
