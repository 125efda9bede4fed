"""PPO's losses of one transition with on/off thrusters, and their derivatives by the network's outputs.

They are operations on fields, from which a GPU's kernel (`rans_machine_code.cuda.update`) and machine code of a CPU
(`rans_machine_code.gradient`) are printed. Losses are those of `rans.fast.learn.ppo.losses`, whose derivatives are
torch's.
"""

from __future__ import annotations

from typing import NamedTuple

from rans.extend import ACTIVATIONS, Field, absolute, at_least, fields, where

WITH_SLOPE = tuple(name for name, activation in ACTIVATIONS.items() if activation.slope is not None)
"""Activations between layers whose gradients need no autograd."""
STATISTICS = 5
"""Number of `TransitionLosses.statistics`."""


class Choice(NamedTuple):
    """One on/off thruster's part in an action."""

    log_prob: Field
    """Log-probability of the command."""
    entropy: Field
    """Entropy of the command, nats."""
    opening: Field
    """Probability that the thruster opens."""


class TransitionLosses(NamedTuple):
    """Losses of one transition, and their derivatives that all outputs share."""

    d_log_prob: Field
    """Derivative of the clipped surrogate by the action's log-probability."""
    d_value: Field
    """Derivative of the weighted value loss by the value."""
    statistics: tuple[Field, ...]
    """Surrogate, value loss, negative entropy, KL divergence from the rollout's policy, and 1 where the ratio is
    clipped, else 0: `rans.fast.learn.ppo.Losses` but for the sum."""


def opening_term(logit: Field, command: Field) -> Choice:
    """A thruster's part in an action, from its log-odds of opening and its command, 0 or 1."""
    # log(1 + e^x) = max(x, 0) + log(1 + e^-|x|), whose derivative is the probability.
    small = fields.exp(-absolute(logit))
    reciprocal = 1.0 / (1.0 + small)
    opening = where(logit >= 0.0, reciprocal, small * reciprocal)
    softplus = at_least(logit, 0.0) + fields.log1p(small)
    return Choice(command * logit - softplus, softplus - logit * opening, opening)


def transition_losses(
    log_prob: Field,
    entropy: Field,
    value: Field,
    old_log_prob: Field,
    advantage: Field,
    target: Field,
    clip_range: Field,
    vf_coef: Field,
) -> TransitionLosses:
    """Losses of one transition.

    Args:
        log_prob: log-probability of the action.
        entropy: entropy of the policy, nats.
        value: the critic's value.
        old_log_prob: log-probability of the action under the rollout's policy.
        advantage: standardised advantage.
        target: target of the value.
        clip_range: bound of the ratio's distance from 1.
        vf_coef: weight of the value loss.
    """
    change = log_prob - old_log_prob
    ratio = fields.exp(change)
    low = 1.0 - clip_range
    high = 1.0 + clip_range
    bounded = where(ratio < low, low, where(ratio > high, high, ratio))
    gain = advantage * ratio
    clipped = advantage * bounded
    # The derivative is zero where the ratio has left its range in the direction of the advantage.
    counts = gain <= clipped
    error = value - target
    statistics = (
        -where(counts, gain, clipped),
        error * error,
        -entropy,
        ratio - 1.0 - change,
        where(absolute(ratio - 1.0) > clip_range, 1.0, 0.0),
    )
    return TransitionLosses(where(counts, -gain, 0.0), 2.0 * vf_coef * error, statistics)


def d_logit(command: Field, opening: Field, d_log_prob: Field) -> Field:
    """Derivative of the losses by a thruster's log-odds."""
    return d_log_prob * (command - opening)
