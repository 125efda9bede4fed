"""The networks of many trainings as one: weights (K, ...) and grouped matrix products."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import chain

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from rans.fast.policy import NormalisedMlp, OnOff


class Network:
    """The actor-critics of K members, every weight and statistic stacked to (K, ...).

    Args:
        policies: one a member, all of `rans.fast.policy.network` with the same layers.
        device: torch device of the stacked weights.
    """

    def __init__(self, policies: Sequence[ActorCriticPolicy], device: torch.device) -> None:
        # A copy: its tables must lie on the device, and the policy itself must not move.
        extractor = copy.deepcopy(policies[0].features_extractor).to(device)
        assert isinstance(extractor, NormalisedMlp)
        self.look, self._looks, self._precision = extractor.seen, extractor.looks, extractor.precision
        self.activation = extractor.trunk[1]
        tables = [dict(_tensors(policy)) for policy in policies]
        self.tensors = {name: torch.stack([table[name].detach() for table in tables]).to(device)
                        for name in tables[0]}
        self.parameters = [self.tensors[name].requires_grad_() for name, _ in policies[0].named_parameters()]
        prefixes = [name.removesuffix(".weight") for name in self.tensors
                    if ".trunk." in name and name.endswith(".weight")]
        self._trunk = [self._layer(prefix) for prefix in prefixes]
        self._actor, self._critic = self._layer("action_net"), self._layer("value_net")
        self._mean, self._variance, self._count = (
            self.tensors[f"features_extractor.{name}"] for name in ("mean", "variance", "count"))

    def _layer(self, name: str) -> tuple[Tensor, Tensor]:
        return self.tensors[f"{name}.weight"], self.tensors[f"{name}.bias"]

    def evaluate(self, observation: Tensor) -> OnOff:
        """What every member says about its own rows of (K n, width) observations."""
        rows, place = self.look(observation)
        logit, value = self.evaluate_seen(rows.unflatten(0, (len(self._mean), -1)))
        return OnOff(logit if place is None else logit.gather(1, place), value)

    def evaluate_seen(self, seen: Tensor) -> OnOff:
        """The same of (K, n, k) columns that `look` returned; see `rans.fast.policy.evaluate_seen`."""
        x = self._looks(seen, self._mean[:, None], self._variance[:, None])
        with self._precision(x):
            for weight, bias in self._trunk:
                # Not baddbmm, which copies the bias to every row first: compiled, the activation adds it.
                x = torch.bmm(x, weight.mT)
                x = self.activation(x + bias[:, None].to(x.dtype))
        x = x.to(seen.dtype)
        # As `rans.fast.policy.evaluate_seen`: only the difference of a thruster's two logits matters.
        (weight, bias), (value_weight, value_bias) = self._actor, self._critic
        weight = torch.cat((weight[:, 1::2] - weight[:, 0::2], value_weight), dim=1)
        bias = torch.cat((bias[:, 1::2] - bias[:, 0::2], value_bias), dim=1)
        out = (torch.bmm(x, weight.mT) + bias[:, None]).flatten(0, 1)
        return OnOff(out[:, :-1], out[:, -1])

    @torch.no_grad()
    def update_statistics(self, rows: Tensor) -> None:
        """Merge (T, K n, k) columns into each member's mean and variance, as `NormalisedMlp`."""
        seen = rows.unflatten(1, (len(self._mean), -1))
        variance, mean = torch.var_mean(seen, dim=(0, 2), correction=0)
        count = seen.shape[0] * seen.shape[2]
        share = (count / (self._count + count))[:, None]
        shift = mean - self._mean
        self._mean += shift * share
        self._variance += (variance - self._variance) * share + shift.square() * (share * (1 - share))
        self._count += count

    def member(self, number: int) -> dict[str, Tensor]:
        """A copy of one member's weights and statistics, on the CPU, by their names in its policy."""
        return {name: stack[number].detach().cpu().clone() for name, stack in self.tensors.items()}


@torch.no_grad()
def write_weights(policy: ActorCriticPolicy, weights: dict[str, Tensor]) -> None:
    """Give a policy what `Network.member` returned."""
    for name, tensor in _tensors(policy):
        tensor.copy_(weights[name])


def _tensors(policy: ActorCriticPolicy) -> chain[tuple[str, Tensor]]:
    """Every parameter and statistic once, though SB3 lists a shared extractor three times."""
    return chain(policy.named_parameters(), policy.named_buffers())
