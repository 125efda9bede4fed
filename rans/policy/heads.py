"""Heads: what the last layer's outputs mean for the commands, in training and when an agent flies.

A head is one class here and its name in `HEADS`. Its deterministic command is written in operations on fields,
from which every executor takes it: torch in training, machine code, CUDA kernels and exported files.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, Protocol

import torch
from torch import Tensor
from torch.nn import functional

from rans.model.fields import Field, where, within

_TEMPERATURE = 0.1
"""Difference of a demand's squared errors by which a pattern is e times less likely."""


class Distribution(Protocol):
    """The commands of N spacecraft with n commands each, as random numbers."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-probability or log-density (N,) of actions (N, n)."""
        ...

    def entropy(self) -> Tensor:
        """Entropy (N,) of the joint distribution, nats."""
        ...

    def sample(self, uniform: Tensor) -> Tensor:
        """The action (N, n) that uniform random numbers (N, n) in [0, 1) choose."""
        ...

    def mode(self) -> Tensor:
        """Deterministic command (N, n), of numbers from 0 to 1."""
        ...

    def command(self, action: Tensor) -> Tensor:
        """The command (N, n) that an action is, of numbers from 0 to 1."""
        ...

    def margin(self) -> Tensor:
        """Distance of each output from where rounding would switch its command, (N, n); 0: nowhere."""
        ...

    def placed(self, site: Tensor) -> Distribution:
        """Distribution with its commands permuted by their sites (N, n) in a view of the spacecraft."""
        ...


class OnOff(NamedTuple):
    """N commands of n independent on/off thrusters."""

    logit: Tensor
    """(N, n): log-odds of opening each thruster."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-probability (N,) of an action (N, n) of zeros and ones."""
        return -functional.softplus(self.logit.addcmul(self.logit, action, value=-2.0)).sum(dim=1)

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
        """Commands of the thrusters, (N, n)."""
        return action

    def margin(self) -> Tensor:
        """See `Distribution`."""
        return self.logit.abs()

    def placed(self, site: Tensor) -> OnOff:
        """Distribution with its thrusters permuted by their sites (N, n) in a view of the spacecraft."""
        return OnOff(self.logit.gather(1, site))


class Patterns(NamedTuple):
    """N commands of n on/off thrusters, which open together: one of S patterns, after a demanded twist.

    A pattern's probability falls with what it leaves of the demand and with its thrust. Thrusters that are chosen
    one by one cannot say which of them go together: with a shared supply a valve too many takes the others' thrust.
    """

    demand: Tensor
    """(N, d)."""
    offset: Tensor
    """(S,) and the next: linear functions of the demand (`rans.policy.subsets.Subsets`)."""
    slope: Tensor
    """(d, S)."""
    opened: Tensor
    """(S, n): zeros and ones."""

    @property
    def logit(self) -> Tensor:
        """(N, n): above 0 for the thrusters of the most likely pattern."""
        return self.mode() - 0.5

    def _scores(self) -> Tensor:
        return (self.demand @ self.slope + self.offset) / _TEMPERATURE

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-probability (N,) of an action (N, n) of zeros and ones; minus infinity where it is no pattern."""
        differing = action @ (1.0 - 2.0 * self.opened).T + self.opened.sum(dim=1)
        log_probs = functional.log_softmax(self._scores(), dim=1)
        return log_probs.masked_fill(differing > 0.5, -torch.inf).amax(dim=1)

    def entropy(self) -> Tensor:
        """Entropy (N,), nats."""
        log_probs = functional.log_softmax(self._scores(), dim=1)
        return -(log_probs.exp() * log_probs).sum(dim=1)

    def sample(self, uniform: Tensor) -> Tensor:
        """The action (N, n), zeros and ones, that the first of uniform random numbers (N, n) in [0, 1) chooses."""
        below = torch.softmax(self._scores(), dim=1).cumsum(dim=1) <= uniform[:, :1]
        # Rounding may leave the last sum below 1.
        return self.opened[below.sum(dim=1).clamp(max=len(self.opened) - 1)]

    def mode(self) -> Tensor:
        """Most likely action (N, n), zeros and ones."""
        return self.opened[torch.argmax(self.demand @ self.slope + self.offset, dim=1)]

    def command(self, action: Tensor) -> Tensor:
        """Commands of the thrusters, (N, n)."""
        return action

    def margin(self) -> Tensor:
        """See `Distribution`: that of the best pattern's function over the second's, of all thrusters."""
        best = torch.topk(self.demand @ self.slope + self.offset, 2, dim=1).values
        return (best[:, :1] - best[:, 1:]).expand(-1, self.opened.shape[1])

    def placed(self, site: Tensor) -> Patterns:
        """See `Distribution`: a demand is in B, whatever the spacecraft looks like from its sides."""
        raise NotImplementedError


class ClippedGaussian(NamedTuple):
    """N commands of n thrusters that are open for a share of the control period, or throttled to one.

    A diagonal Gaussian, as SB3's; what lies beyond shut or open is clipped where it acts.
    """

    mean: Tensor
    """(N, n)."""
    log_std: Tensor
    """Logarithm of the standard deviation of the commands, (N, n), or (n,) for all."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-density (N,) of an action (N, n) before it is clipped."""
        return _log_density(action, self.mean, self.log_std).sum(dim=1)

    def entropy(self) -> Tensor:
        """Differential entropy (N,) of commands, nats."""
        return (0.5 + 0.5 * math.log(2 * math.pi) + self.log_std).expand_as(self.mean).sum(dim=1)

    def sample(self, uniform: Tensor) -> Tensor:
        """The action (N, n) that uniform random numbers (N, n) in [0, 1) choose."""
        return self.mean + self.log_std.exp() * _normal(uniform)

    def mode(self) -> Tensor:
        """Most likely command (N, n)."""
        return self.command(self.mean)

    def command(self, action: Tensor) -> Tensor:
        """Commands of the thrusters, (N, n), in [0, 1]."""
        return action.clamp(0.0, 1.0)

    def margin(self) -> Tensor:
        """See `Distribution`: there is no jump."""
        return self.mean * 0

    def placed(self, site: Tensor) -> ClippedGaussian:
        """Distribution with its thrusters permuted, see `OnOff.placed`."""
        spread = self.log_std.expand_as(self.mean)
        return ClippedGaussian(self.mean.gather(1, site), spread.gather(1, site))


class GatedGaussian(NamedTuple):
    """N commands of n throttled thrusters: each fires or does not, and if it fires, by how much.

    An action is exactly 0 where the gate is shut, and a number of a Gaussian otherwise, which is clipped to
    [0, 1] where it acts. Probabilities are of the mixture of a point at 0 and a density, so that ratios of
    them, which PPO takes, are those of actions of the same kind.
    """

    logit: Tensor
    """(N, n): log-odds of firing each thruster."""
    level: Tensor
    """(N, n): mean of the throttle of a thruster that fires."""
    log_std: Tensor
    """(N, n), or (n,) for all: of the throttle."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log of the probability of shut gates times the density of the others' throttles, (N,)."""
        fires = action != 0
        gate = -functional.softplus(torch.where(fires, -self.logit, self.logit))
        density = _log_density(action, self.level, self.log_std)
        return (gate + torch.where(fires, density, 0.0)).sum(dim=1)

    def entropy(self) -> Tensor:
        """Entropy (N,) of the gates, and of each throttle as often as it acts; nats."""
        fires = torch.sigmoid(self.logit)
        gate = functional.softplus(self.logit) - self.logit * fires
        throttle = 0.5 + 0.5 * math.log(2 * math.pi) + self.log_std
        return (gate + fires * throttle).sum(dim=1)

    def sample(self, uniform: Tensor) -> Tensor:
        """The action (N, n) that uniform random numbers (N, n) in [0, 1) choose.

        The random number is uniform again within each choice of a gate. One number serves both choices, so that
        rollouts draw as many numbers as for other heads.
        """
        probability = torch.sigmoid(self.logit)
        fires = uniform < probability
        within = torch.where(
            fires, uniform / probability, (uniform - probability) / (1.0 - probability)
        )
        # Where the probability rounds to one, nothing is left beyond it.
        within = within.nan_to_num(0.5).clamp(0.0, 1.0)
        return torch.where(fires, self.level + self.log_std.exp() * _normal(within), 0.0)

    def mode(self) -> Tensor:
        """Deterministic command (N, n): the mean throttle of those that rather fire, 0 of the others."""
        return torch.where(self.logit > 0, self.command(self.level), 0.0)

    def command(self, action: Tensor) -> Tensor:
        """Commands of the thrusters, (N, n), in [0, 1]."""
        return action.clamp(0.0, 1.0)

    def margin(self) -> Tensor:
        """See `Distribution`."""
        return self.logit.abs()

    def placed(self, site: Tensor) -> GatedGaussian:
        """Distribution with its thrusters permuted, see `OnOff.placed`."""
        spread = self.log_std.expand_as(self.level)
        return GatedGaussian(*(x.gather(1, site) for x in (self.logit, self.level, spread)))


def _normal(uniform: Tensor) -> Tensor:
    """Standard normal numbers from uniform ones in [0, 1)."""
    # Six standard deviations: float32 rounds one in 3e7 uniform numbers to zero, which is infinitely far.
    return (math.sqrt(2) * torch.erfinv(2 * uniform - 1)).clamp(-6.0, 6.0)


def _log_density(action: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Log-density of Gaussians."""
    deviation = (action - mean) * torch.exp(-log_std)
    return -(0.5 * deviation.square() + log_std + 0.5 * math.log(2 * math.pi))


class Head(ABC):
    """Map from a policy's last layer to commands from 0 to 1, one for each of a craft's n."""

    outputs: ClassVar[int]
    """Numbers a command; those of all commands of one meaning stand together."""
    weights: ClassVar[int]
    """Rows of the last layer a command, before `folded`."""
    continuous: ClassVar[bool] = True
    """Whether commands are numbers from 0 to 1, instead of 0 or 1."""
    spread: ClassVar[bool] = True
    """Whether a standard deviation is learnt for each command, the tensor ``log_std``."""

    def folded(self, weight: Any, bias: Any) -> tuple[Any, Any]:
        """Weights (..., outputs n, features) and biases (..., outputs n) that give the outputs."""
        return weight, bias

    @abstractmethod
    def expect(self, bias: Tensor, duty: float) -> None:
        """Change the biases, (weights n,), for untrained commands to be this number in the mean."""

    @abstractmethod
    def distribution(self, outputs: Tensor, log_std: Tensor | None) -> Distribution:
        """Distribution of outputs (N, outputs n)."""

    @abstractmethod
    def command(self, *outputs: Field) -> Field:
        """The deterministic command of one thruster from its outputs."""


class OnOffHead(Head):
    """Opens each thruster or not.

    SB3 gives each on/off thruster two logits and one distribution object; the probability of opening needs
    only their difference, so that the last layer shrinks to n outputs.
    """

    outputs = 1
    weights = 2
    continuous = False
    spread = False

    def folded(self, weight: Any, bias: Any) -> tuple[Any, Any]:
        """See `Head`: differences of two logits."""
        return weight[..., 1::2, :] - weight[..., 0::2, :], bias[..., 1::2] - bias[..., 0::2]

    def expect(self, bias: Tensor, duty: float) -> None:
        """See `Head`: the duty is the probability of opening."""
        bias[1::2] = bias[0::2] + math.log(duty / (1.0 - duty))

    def distribution(self, outputs: Tensor, log_std: Tensor | None) -> OnOff:
        """See `Head`."""
        return OnOff(outputs)

    def command(self, *outputs: Field) -> Field:
        """See `Head`."""
        (logit,) = outputs
        return where(logit > 0.0, logit * 0.0 + 1.0, logit * 0.0)


class GaussianHead(Head):
    """Opens each thruster for a share of the period, throttles it, or drives a wheel."""

    outputs = 1
    weights = 1

    def expect(self, bias: Tensor, duty: float) -> None:
        """See `Head`."""
        bias.fill_(duty)

    def distribution(self, outputs: Tensor, log_std: Tensor | None) -> ClippedGaussian:
        """See `Head`."""
        assert log_std is not None
        return ClippedGaussian(outputs, log_std)

    def command(self, *outputs: Field) -> Field:
        """See `Head`."""
        return within(outputs[0], 0.0, 1.0)


class GatedHead(Head):
    """Decides for each throttled thruster whether it fires at all, and by how much: 0 is exactly 0."""

    outputs = 2
    weights = 2

    def expect(self, bias: Tensor, duty: float) -> None:
        """See `Head`: half of the thrusters fire, or enough of them where the duty is above one half."""
        gates, levels = bias.chunk(2)
        fires = max(0.5, math.sqrt(duty))
        gates.fill_(math.log(fires / (1.0 - fires)))
        levels.fill_(duty / fires)

    def distribution(self, outputs: Tensor, log_std: Tensor | None) -> GatedGaussian:
        """See `Head`."""
        assert log_std is not None
        logit, level = outputs.chunk(2, dim=1)
        return GatedGaussian(logit, level, log_std)

    def command(self, *outputs: Field) -> Field:
        """See `Head`."""
        logit, level = outputs
        return where(logit > 0.0, within(level, 0.0, 1.0), level * 0.0)


HEADS: dict[str, Head] = {
    "on-off": OnOffHead(),
    "gaussian": GaussianHead(),
    "gated": GatedHead(),
}
"""By their names in settings and agents' files."""
