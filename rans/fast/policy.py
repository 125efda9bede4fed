"""Stable-Baselines3 classes of the network, and the ``policy.zip`` file that refers to them.

This module needs the package stable-baselines3, which the extra ``sb3`` installs.
"""

from __future__ import annotations

import inspect
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.save_util import save_to_zip_file
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from rans.errors import ConfigError
from rans.fast.agent_files.agent import AGENT, agent_bytes
from rans.fast.learn.adam import EPSILON
from rans.fast.learn.config import PPOSettings
from rans.files import replace_file
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.heads import ClippedGaussian, OnOff, Patterns
from rans.policy.network import Network, Output
from rans.policy.predict import policy_spaces, predict
from rans.tasks.observation_terms import Layout

_SHARED = (
    "n_envs",
    "n_steps",
    "batch_size",
    "n_epochs",
    "learning_rate",
    "gamma",
    "gae_lambda",
    "clip_range",
    "vf_coef",
    "max_grad_norm",
)
"""Settings with the same names in SB3."""


class NormalisedMlp(BaseFeaturesExtractor):
    """SB3 features extractor: body frame, observation normaliser and trunk of a `Network`, without its heads.

    It is saved with the weights of the policy, statistics included. Arguments are those of `Architecture`;
    symmetries work only in an `AgentPolicy`.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        layout: Layout,
        thrusters: int,
        layers: Sequence[int] = (128, 128),
        **others: Any,
    ) -> None:
        if "continuous" in others:  # older files, with one head per kind of spacecraft
            others["head"] = "gaussian" if others.pop("continuous") else "on-off"
        architecture = Architecture(layout, thrusters, tuple(layers), **others)
        super().__init__(observation_space, architecture.features)
        self.architecture = architecture
        for name, module in architecture.modules().items():
            self.add_module(name, module)
        for name, statistic in architecture.statistics().items():
            self.register_buffer(name, statistic)

    def network(self, heads: Mapping[str, Tensor]) -> Network:
        """Network with these heads, named as in the SB3 policy; weights are shared, not copied."""
        body = {
            EXTRACTOR + name: x for name, x in (*self.named_parameters(), *self.named_buffers())
        }
        return Network(self.architecture, {**body, **heads})

    def forward(self, observations: Tensor) -> Tensor:
        """Features (N, units of the last layer) of observations (N, width)."""
        network = self.network({})
        return network.features(network.look(network.in_body(observations))[0])[0]


def network_of(policy: ActorCriticPolicy) -> Network:
    """Network of an SB3 policy, with shared weights; ConfigError if it has layers unknown to RANS."""
    extractor = policy.features_extractor
    if not isinstance(extractor, NormalisedMlp) or policy.net_arch:
        raise ConfigError(
            "the policy is not one that RANS trained: it has layers of its own; load it with "
            "Stable-Baselines3."
        )
    heads = {name: x for name, x in policy.named_parameters() if not name.startswith(EXTRACTOR)}
    return extractor.network(heads)


def policy_kwargs(architecture: Architecture) -> dict[str, Any]:
    """``policy_kwargs`` of SB3 for an `AgentPolicy` with this architecture, with fused Adam.

    Files of policies have these words, and Stable-Baselines3 makes the policy of them again when it loads one.
    """
    extractor = {
        field.name: getattr(architecture, field.name)
        for field in fields(Architecture)
        if field.name != "bounds"
    }  # bounds are saved as the spaces
    return {
        "features_extractor_class": NormalisedMlp,
        "features_extractor_kwargs": extractor,
        "net_arch": [],
        "optimizer_kwargs": {"fused": True, "eps": EPSILON},
    }


class AgentPolicy(ActorCriticPolicy):
    """SB3 actor-critic policy that evaluates a `Network`.

    The policies of SB3 support neither symmetries, in which thrusters swap roles, nor this memory, which
    ``predict`` takes and returns as in recurrent policies of SB3. If SB3 itself continues the training, every
    step is treated as the first of an episode.
    """

    def _build(self, lr_schedule: Any) -> None:
        """As SB3, with the last layer required by the head of the agent. SB3 calls it in its constructor."""
        super()._build(lr_schedule)
        extractor = self.features_extractor
        if not isinstance(extractor, NormalisedMlp):
            return
        last = extractor.architecture.parts()["action_net."]
        assert isinstance(last, nn.Linear)
        if self.action_net.out_features != last.out_features:
            self.action_net = last
            self.optimizer = self.optimizer_class(
                self.parameters(),
                **{"lr": lr_schedule(1)} | self.optimizer_kwargs,
            )

    def _evaluated(self, obs: Any) -> Output:
        network = network_of(self)
        return network.evaluate(obs, network.initial_state(len(obs)))

    def forward(self, obs: Tensor, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        """As SB3: actions (N, thrusters), values (N, 1), log-probabilities (N,)."""
        policy, value = self._evaluated(obs)
        action = policy.mode() if deterministic else policy.sample(torch.rand_like(policy.mode()))
        returned = action.long() if isinstance(policy, OnOff | Patterns) else action
        return returned, value[:, None], policy.log_prob(action)

    def get_distribution(self, obs: Any) -> Distribution:
        """SB3's distribution of the commands for observations (N, width), from the agent's own heads."""
        policy = self._evaluated(obs).policy
        distribution = cast("Any", self.action_dist)
        if isinstance(policy, ClippedGaussian):
            return distribution.proba_distribution(policy.mean, policy.log_std)
        if not isinstance(policy, OnOff):
            raise ConfigError(
                "Stable-Baselines3 has no distribution for this agent's head: fly it by its commands."
            )
        both = torch.stack((torch.zeros_like(policy.logit), policy.logit), dim=2).flatten(1)
        return distribution.proba_distribution(action_logits=both)

    def evaluate_actions(self, obs: Any, actions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As SB3: values (N, 1), log-probabilities and entropies (N,) of actions (N, thrusters)."""
        policy, value = self._evaluated(obs)
        return value[:, None], policy.log_prob(actions.to(value.dtype)), policy.entropy()

    def predict_values(self, obs: Any) -> Tensor:
        """As SB3: values (N, 1)."""
        return self._evaluated(obs).value[:, None]

    def predict(
        self,
        observation: Any,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Commands (N, n) and next memory, as SB3's `predict` and `rans.policy.predict.predict`."""
        return predict(network_of(self), observation, state, episode_start, deterministic)


class _Written(torch.optim.Adam):
    """Adam for the format of its saved state only.

    Without the wrappers of torch its compiler, which takes 0.6 s, is not loaded.
    """

    add_param_group = inspect.unwrap(torch.optim.Optimizer.add_param_group)
    state_dict = inspect.unwrap(torch.optim.Optimizer.state_dict)


def write_policy(
    file: Path,
    architecture: Architecture,
    tensors: Mapping[str, Tensor],
    settings: PPOSettings,
    steps: int,
) -> None:
    """Write an agent as an archive that both Stable-Baselines3 and RANS open and continue to train.

    Args:
        file: ``policy.zip`` to write.
        architecture: of the network.
        tensors: weights as returned by `Network.weights`.
        settings: hyper-parameters of the training.
        steps: environment steps of the training.

    Raises:
        ConfigError: the file cannot be written.
    """
    observation_space, commanded = policy_spaces(architecture)
    kwargs = policy_kwargs(architecture)
    rate = settings.learning_rate
    policy = AgentPolicy(
        observation_space, commanded, lambda _: rate, **kwargs, optimizer_class=_Written
    )
    policy.to(next(iter(tensors.values())).dtype)
    names = dict((*policy.named_parameters(), *policy.named_buffers()))
    with torch.no_grad():
        for name, path in names.items():
            path.copy_(tensors[name])
    # What SB3 reads, beside the file that RANS reads.
    optimizer = policy.optimizer.state_dict()
    data = {
        "policy_class": AgentPolicy,
        "policy_kwargs": kwargs,
        "observation_space": observation_space,
        "action_space": commanded,
        "verbose": 0,
        "num_timesteps": steps,
        "ent_coef": 0.0,
        **{name: getattr(settings, name) for name in _SHARED},
    }

    agent = agent_bytes(architecture, tensors, steps)

    def write(draft: Path) -> None:
        """Write SB3's archive into a draft, and the agent's file beside it in the same archive."""
        with draft.open(
            "w+b"
        ) as stream:  # not a path: SB3 adds ".zip" to one that has another ending
            save_to_zip_file(
                stream, data, {"policy": policy.state_dict(), "policy.optimizer": optimizer}
            )
            with zipfile.ZipFile(stream, "a") as archive:
                archive.writestr(AGENT, agent)

    replace_file(file, write)
