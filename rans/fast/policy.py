"""The network in Stable-Baselines3's terms: the classes that a ``policy.zip`` names, and that file itself."""

from __future__ import annotations

import inspect
import math
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
from rans.policy.heads import ClippedGaussian, OnOff
from rans.policy.network import Network, Output
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
    "ent_coef",
    "vf_coef",
    "max_grad_norm",
)
"""Settings that SB3 knows by the same names."""


class NormalisedMlp(BaseFeaturesExtractor):
    """Change to the body frame, observation normaliser, and trunk: a `Network` without its heads.

    As SB3's features extractor it travels with the policy's weights, statistics included. Arguments are
    those of `Architecture`, with symmetries only in an `AgentPolicy`.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        layout: Layout,
        thrusters: int,
        layers: Sequence[int] = (128, 128),
        **others: Any,
    ) -> None:
        if "continuous" in others:  # files of before had one head for either kind of craft
            others["head"] = "gaussian" if others.pop("continuous") else "on-off"
        architecture = Architecture(layout, thrusters, tuple(layers), **others)
        super().__init__(observation_space, architecture.features)
        self.architecture = architecture
        for name, module in architecture.modules().items():
            self.add_module(name, module)
        for name, statistic in architecture.statistics().items():
            self.register_buffer(name, statistic)

    def network(self, heads: Mapping[str, Tensor]) -> Network:
        """The network with these heads, by their names in SB3's policy; weights are shared, not copied."""
        own = {EXTRACTOR + name: x for name, x in (*self.named_parameters(), *self.named_buffers())}
        return Network(self.architecture, {**own, **heads})

    def forward(self, observations: Tensor) -> Tensor:
        """Features (N, units of the last layer) of observations (N, width)."""
        network = self.network({})
        return network.features(network.look(network.in_body(observations))[0])[0]


def network_of(policy: ActorCriticPolicy) -> Network:
    """The network that an SB3 policy is, its weights shared; ConfigError where it has other layers."""
    extractor = policy.features_extractor
    if not isinstance(extractor, NormalisedMlp) or policy.net_arch:
        raise ConfigError(
            "the policy is not one that RANS trained: it has layers of its own; load it with "
            "Stable-Baselines3."
        )
    heads = {name: x for name, x in policy.named_parameters() if not name.startswith(EXTRACTOR)}
    return extractor.network(heads)


def policy_kwargs(architecture: Architecture) -> dict[str, Any]:
    """SB3's ``policy_kwargs`` of an `AgentPolicy` with this architecture, and Adam in one kernel."""
    extractor = {
        field.name: getattr(architecture, field.name)
        for field in fields(Architecture)
        if field.name != "bounds"
    }  # which the file has as its spaces
    return {
        "features_extractor_class": NormalisedMlp,
        "features_extractor_kwargs": extractor,
        "net_arch": [],
        "optimizer_kwargs": {"fused": True, "eps": EPSILON},
    }


@torch.no_grad()
def predict(
    network: Network,
    observation: np.ndarray,
    state: tuple[np.ndarray, ...] | None = None,
    episode_start: np.ndarray | None = None,
    deterministic: bool = True,
) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
    """Commands (N, thrusters) of one member, whole numbers for on/off thrusters, and its memory after them.

    Observations are (N, width) or (width,). The state is the memory ((N, m),) after the step before; there is
    none where all episodes begin, and (N,) bool say where some do.

    Raises:
        ConfigError: the observations have another width than those that the network was trained on.
    """
    network.architecture.check_width("the policy", observation)
    architecture = network.architecture
    device = next(iter(network.tensors.values())).device
    rows = torch.as_tensor(np.asarray(observation), device=device).reshape(
        -1, architecture.layout.width
    )
    memory = network.initial_state(len(rows))
    if memory is not None and state is not None:
        memory = torch.as_tensor(state[0]).to(memory)
        if episode_start is not None:
            memory = memory * ~torch.as_tensor(episode_start, device=memory.device)[:, None]
    output, columns = network.forward(rows, memory)
    command = output.policy.mode()
    if not deterministic:
        command = output.policy.command(output.policy.sample(torch.rand_like(command)))
    memory = network.next_state(columns, memory, command, output)
    said = command.cpu().numpy().astype(np.float32 if architecture.continuous else np.int64)
    said = said.reshape(*np.shape(observation)[:-1], said.shape[1])
    return said, None if memory is None else (memory.cpu().numpy(),)


class AgentPolicy(ActorCriticPolicy):
    """SB3's actor-critic whose every answer comes from `Network`.

    SB3's own has no place for thrusters that swap roles with the side the spacecraft is seen from, and none
    for a memory, which ``predict`` takes and gives as SB3's recurrent policies do. Trained on by SB3 itself,
    such a policy learns as if every step were an episode's first.
    """

    def _build(self, lr_schedule: Any) -> None:
        """As SB3, with the last layer that the agent's head needs."""
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
        policy, value, _ = self._evaluated(obs)
        action = policy.mode() if deterministic else policy.sample(torch.rand_like(policy.mode()))
        said = action.long() if isinstance(policy, OnOff) else action
        return said, value[:, None], policy.log_prob(action)

    def get_distribution(self, obs: Any) -> Distribution:
        """As SB3."""
        policy = self._evaluated(obs).policy
        known = cast("Any", self.action_dist)
        if isinstance(policy, ClippedGaussian):
            return known.proba_distribution(policy.mean, policy.log_std)
        if not isinstance(policy, OnOff):
            raise ConfigError(
                "Stable-Baselines3 has no distribution for this agent's head: fly it by its commands."
            )
        both = torch.stack((torch.zeros_like(policy.logit), policy.logit), dim=2).flatten(1)
        return known.proba_distribution(action_logits=both)

    def evaluate_actions(self, obs: Any, actions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As SB3: values (N, 1), log-probabilities and entropies (N,) of actions (N, thrusters)."""
        policy, value, _ = self._evaluated(obs)
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
        """As SB3, see `predict`."""
        return predict(network_of(self), observation, state, episode_start, deterministic)


class _Written(torch.optim.Adam):
    """SB3's optimiser, for the form of its state alone.

    Nothing compiles it, so that torch need not load its compiler, which takes 0.6 s.
    """

    add_param_group = inspect.unwrap(torch.optim.Optimizer.add_param_group)
    state_dict = inspect.unwrap(torch.optim.Optimizer.state_dict)


def policy_spaces(architecture: Architecture) -> tuple[spaces.Box, spaces.Space[Any]]:
    """What an agent observes and commands, in Gymnasium's terms."""
    bounds = architecture.bounds or (math.inf,) * architecture.layout.width
    most = np.minimum(bounds, np.finfo(np.float32).max).astype(np.float32)
    count = architecture.thrusters
    duties = spaces.Box(0.0, 1.0, (count,), np.float32)
    switches = spaces.MultiDiscrete([2] * count)
    return spaces.Box(
        -most, most, dtype=np.float32
    ), duties if architecture.continuous else switches


def write_policy(
    file: Path,
    architecture: Architecture,
    tensors: Mapping[str, Tensor],
    settings: PPOSettings,
    steps: int,
    adam: dict[Any, Any] | None = None,
    rate: float | None = None,
) -> None:
    """Save one agent twice in one archive: as RANS reads it (`rans.fast.agent_files.agent`), and as SB3 does.

    With it go the settings of its training, with which SB3 goes on too. Its tensors are as `Network.member`
    gives them. Adam begins anew without what `Adam.member` gave, and its step size. ConfigError where the
    disk refuses.
    """
    seen, commanded = policy_spaces(architecture)
    kwargs = policy_kwargs(architecture)
    rate = rate or settings.learning_rate
    policy = AgentPolicy(seen, commanded, lambda _: rate, **kwargs, optimizer_class=_Written)
    policy.to(next(iter(tensors.values())).dtype)
    names = dict((*policy.named_parameters(), *policy.named_buffers()))
    with torch.no_grad():
        for name, place in names.items():
            place.copy_(tensors[name])
    optimizer = policy.optimizer.state_dict()
    if adam:
        optimizer["state"] = adam
    data = {
        "policy_class": AgentPolicy,
        "policy_kwargs": kwargs,
        "observation_space": seen,
        "action_space": commanded,
        "verbose": 0,
        "num_timesteps": steps,
        **{name: getattr(settings, name) for name in _SHARED},
    }

    ours = agent_bytes(architecture, tensors, settings, steps, adam or {}, rate)

    def write(draft: Path) -> None:
        with draft.open(
            "w+b"
        ) as stream:  # not a path: SB3 adds ".zip" to one that has another ending
            save_to_zip_file(
                stream, data, {"policy": policy.state_dict(), "policy.optimizer": optimizer}
            )
            with zipfile.ZipFile(stream, "a") as archive:
                archive.writestr(AGENT, ours)

    replace_file(file, write)
