"""Distributions of commands that a network ends in."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional


class OnOff(NamedTuple):
    """N commands of n independent on/off thrusters."""

    logit: Tensor
    """(N, n): log-odds of opening each thruster."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-probability (N,) of an action (N, n) of zeros and ones."""
        return -functional.softplus((1 - 2 * action) * self.logit).sum(dim=1)

    def entropy(self) -> Tensor:
        """Entropy (N,) of the joint distribution, nats."""
        return (functional.softplus(self.logit) - self.logit * torch.sigmoid(self.logit)).sum(dim=1)

    def sample(self, uniform: Tensor) -> Tensor:
        """The action (N, n), zeros and ones, that uniform random numbers (N, n) in [0, 1) choose."""
        return (uniform < torch.sigmoid(self.logit)).to(self.logit.dtype)

    def mode(self) -> Tensor:
        """Most likely action (N, n), zeros and ones in the logits' dtype."""
        return (self.logit > 0).to(self.logit.dtype)

    def command(self, action: Tensor) -> Tensor:
        """What the thrusters are told, (N, n)."""
        return action

    def placed(self, place: Tensor) -> OnOff:
        """The same with every thruster taken from its place (N, n) in a view of the spacecraft."""
        return OnOff(self.logit.gather(1, place))


class Duty(NamedTuple):
    """N commands of n thrusters that are open for a share of the control period, or throttled to one.

    A diagonal Gaussian, as SB3's; what lies beyond shut or open is clipped where it acts.
    """

    mean: Tensor
    """(N, n)."""
    log_std: Tensor
    """(N, n), or (n,) for all."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-density (N,) of an action (N, n) before it is clipped."""
        deviation = (action - self.mean) * torch.exp(-self.log_std)
        return -(0.5 * deviation.square() + self.log_std + 0.5 * math.log(2 * math.pi)).sum(dim=1)

    def entropy(self) -> Tensor:
        """Differential entropy (N,), nats."""
        return (0.5 + 0.5 * math.log(2 * math.pi) + self.log_std).expand_as(self.mean).sum(dim=1)

    def sample(self, uniform: Tensor) -> Tensor:
        """The action (N, n) that uniform random numbers (N, n) in [0, 1) choose."""
        # Six standard deviations: float32 rounds one in 3e7 uniform numbers to zero, which is infinitely far.
        normal = (math.sqrt(2) * torch.erfinv(2 * uniform - 1)).clamp(-6.0, 6.0)
        return self.mean + self.log_std.exp() * normal

    def mode(self) -> Tensor:
        """Most likely command (N, n)."""
        return self.command(self.mean)

    def command(self, action: Tensor) -> Tensor:
        """What the thrusters are told, (N, n): in [0, 1]."""
        return action.clamp(0.0, 1.0)

    def placed(self, place: Tensor) -> Duty:
        """As `OnOff.placed`."""
        return Duty(self.mean.gather(1, place), self.log_std.expand_as(self.mean).gather(1, place))
