"""The actor-critic network in SB3's terms, and on/off thrusters evaluated all at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import pairwise
from typing import Any, NamedTuple, get_args

import gymnasium
import torch
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn
from torch.nn import functional

from rans.errors import ConfigError
from rans.fast.distributed import ALONE, Processes
from rans.fast.learn.config import Precision
from rans.fast.symmetry import Symmetries
from rans.tasks.sight import Block, Drawn, Layout, OwnAttitude, Scalar, Spin, Turn, VectorInW

ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "elu": nn.ELU, "relu": nn.ReLU}


def paper_layout(width: int) -> Layout:
    """The layout of policies that were saved without one: 10 or 22 columns of any of the paper's tasks.

    Data beside the way to go are a rotation, or with the flag of TrackTwist (3) an angular velocity.
    """
    axes, spins, turn = (2, 1, 2) if width == 10 else (3, 3, 6)
    twist = (Block(Spin, spins), *(Block(Scalar, 1),) * (turn - spins))
    choices = (*((float(flag), (Block(Turn, turn),)) for flag in (0, 1, 2, 4)), (3.0, twist))
    return Layout((Block(OwnAttitude, turn), Block(VectorInW, axes), Block(Spin, spins), Block(Scalar, 1),
                   Block(VectorInW, axes), Block(Drawn, turn, choices)))


class NormalisedMlp(BaseFeaturesExtractor):
    """Change to the body frame, observation normaliser, and shared trunk of actor and critic.

    As SB3's features extractor it travels with the policy's weights, statistics included.

    Args:
        observation_space: Box of shape (10,) or (22,).
        layers: units of each hidden layer.
        activation: key of `ACTIVATIONS`.
        clip: bound of a normalised observation.
        zoom: magnification of a second look at every column, squashed by tanh, so that a centimetre is
            as plain to see as a metre (decision 008). 0: no second look.
        symmetries: of the spacecraft, whose policy is then an `OnOffPolicy`: it sees every state from the
            one of its equivalent sides that has the goal ahead (decision 009).
        layout: which columns are what; None: those of the paper's tasks.
        bf16: whether on a GPU the hidden layers' products are of bfloat16.
    """

    def __init__(self, observation_space: gymnasium.spaces.Box, layers: Sequence[int] = (128, 128),
                 activation: str = "tanh", clip: float = 10.0, zoom: float = 0.0,
                 symmetries: Symmetries | None = None, layout: Layout | None = None,
                 bf16: bool = False) -> None:
        super().__init__(observation_space, layers[-1])
        self.layout = layout or paper_layout(observation_space.shape[0])
        self._body = self.layout.body
        width = self._body.width
        self.clip, self.zoom, self.bf16 = clip, zoom, bf16
        self.mean: Tensor
        self.variance: Tensor
        self.count: Tensor
        self.turn: Tensor | None
        self.hand: Tensor | None
        self.place: Tensor | None
        self.register_buffer("mean", torch.zeros(width))
        self.register_buffer("variance", torch.ones(width))
        self.register_buffer("count", torch.zeros(()))
        for name, table in zip(Symmetries._fields, symmetries or (None, None, None), strict=True):
            # They come with the constructor's arguments, not with the weights.
            self.register_buffer(name, None if table is None else _tensor(table), persistent=False)
        sizes = [2 * width if zoom else width, *layers]
        modules = [m for i, o in pairwise(sizes)
                   for m in (nn.Linear(i, o), ACTIVATIONS[activation]())]
        self.trunk = nn.Sequential(*modules)

    def forward(self, observations: Tensor) -> Tensor:
        """Features (N, units of the last layer) of observations (N, width)."""
        return self.features(self.seen(observations)[0])

    def features(self, seen: Tensor) -> Tensor:
        """Those of columns that `seen` returned."""
        x = self.looks(seen, self.mean, self.variance)
        with self.precision(x):
            return self.trunk(x).to(x.dtype)

    def seen(self, observations: Tensor) -> tuple[Tensor, Tensor | None]:
        """Columns (N, k) in the body frame, and where in that view each thruster is, (N, thrusters).

        The latter is None for spacecraft whose symmetry is not used.
        """
        columns, views = self.layout.in_body(observations.to(self.mean.dtype).unbind(dim=1)), self.views
        way = self._body.ahead(columns)
        if views is None or way is None:
            return torch.stack(columns, dim=1), None
        which = views.which(way)
        return torch.stack(views.viewed(self._body, columns, which), dim=1), views.place[which]

    def precision(self, x: Tensor) -> AbstractContextManager[Any]:
        """In this context x is multiplied as `bf16` says."""
        return torch.autocast("cuda", torch.bfloat16) if self.bf16 and x.is_cuda else nullcontext()

    @property
    def views(self) -> Symmetries | None:
        """The spacecraft's symmetries, on the weights' device."""
        return None if self.place is None else Symmetries(self.turn, self.hand, self.place)

    def looks(self, seen: Tensor, mean: Tensor, variance: Tensor) -> Tensor:
        """What the trunk is given of (..., k) columns in the body frame: (..., k), or (..., 2 k) zoomed.

        With zero mean and unit variance over those seen in training, clipped; then the second look, which
        is steepest at zero: there is the goal of every column that is no cosine.
        """
        scale = torch.rsqrt(variance + 1e-6)
        x = ((seen - mean) * scale).clamp(-self.clip, self.clip)
        return torch.cat((x, torch.tanh(seen * (scale * self.zoom))), dim=-1) if self.zoom else x

    @torch.no_grad()
    def update_statistics(self, seen: Tensor, world: Processes = ALONE) -> None:
        """Merge mean and variance of N rows that `seen` returned on every process into the running ones.

        Chan, Golub and LeVeque, "Updating formulae and a pairwise algorithm for computing sample
        variances", 1979.
        """
        count = seen.shape[0] * world.size
        variance, mean = world.pooled(*torch.var_mean(seen, dim=0, correction=0))
        share = count / (self.count + count)
        shift = mean - self.mean
        self.mean += shift * share
        self.variance += (variance - self.variance) * share + shift.square() * (share * (1 - share))
        self.count += count


def _tensor(table: Any) -> Tensor:
    """As the weights are: SB3's are float32."""
    tensor = torch.as_tensor(table)
    return tensor.float() if tensor.is_floating_point() else tensor


class OnOff(NamedTuple):
    """What the network says about N observations with n on/off thrusters."""

    logit: Tensor
    """(N, n): log-odds of opening each thruster."""
    value: Tensor
    """(N,): value of the state."""

    def log_prob(self, action: Tensor) -> Tensor:
        """Log-probability (N,) of an action (N, n) of zeros and ones."""
        return -functional.softplus((1 - 2 * action) * self.logit).sum(dim=1)

    def entropy(self) -> Tensor:
        """Entropy (N,) of the joint distribution, nats."""
        return (functional.softplus(self.logit) - self.logit * torch.sigmoid(self.logit)).sum(dim=1)

    def sample(self) -> Tensor:
        """Random action (N, n), of zeros and ones in the logits' dtype."""
        return self.opened(torch.rand_like(self.logit))

    def opened(self, uniform: Tensor) -> Tensor:
        """The action (N, n) that uniform random numbers (N, n) in [0, 1) choose."""
        return (uniform < torch.sigmoid(self.logit)).to(self.logit.dtype)

    def mode(self) -> Tensor:
        """Most likely action (N, n), zeros and ones in the logits' dtype."""
        return (self.logit > 0).to(self.logit.dtype)


def network(layers: Sequence[int] = (64, 64), activation: str = "tanh", zoom: float = 0.0,
            symmetries: Symmetries | None = None, layout: Layout | None = None,
            bf16: bool = False) -> dict[str, Any]:
    """SB3's ``policy_kwargs`` for one trunk shared by actor and critic, and Adam in one kernel.

    With symmetries the policy must be an `OnOffPolicy`.
    """
    return {
        "features_extractor_class": NormalisedMlp,
        "features_extractor_kwargs": {
            "layers": layers, "activation": activation, "zoom": zoom, "symmetries": symmetries,
            "layout": layout, "bf16": bf16},
        "net_arch": [],
        "optimizer_kwargs": {"fused": True, "eps": 1e-5},
    }


def set_precision(matmul: str, device: torch.device) -> None:
    """Let a GPU multiply matrices of float32 like this, see `rans.fast.learn.config.Precision`; process-wide.

    Raises:
        ConfigError: there is no such precision.
    """
    if matmul not in get_args(Precision):
        raise ConfigError(f"matmul must be one of {', '.join(get_args(Precision))}, got {matmul!r}.")
    if device.type == "cuda":
        torch.set_float32_matmul_precision("highest" if matmul == "float32" else "high")


@torch.no_grad()
def expect_duty(policy: ActorCriticPolicy, duty: float) -> None:
    """Let an untrained policy open each thruster with this probability, not every other time."""
    bias = policy.action_net.bias  # type: ignore[union-attr]
    bias[1::2] = bias[0::2] + math.log(duty / (1.0 - duty))  # type: ignore[index, operator]


def evaluate(policy: ActorCriticPolicy, observations: Tensor) -> OnOff:
    """Run an SB3 actor-critic policy with ``MultiDiscrete([2] * n)`` actions."""
    seen, place = look(policy, observations)
    logit, value = evaluate_seen(policy, seen)
    return OnOff(logit if place is None else logit.gather(1, place), value)


def look(policy: ActorCriticPolicy, observations: Tensor) -> tuple[Tensor, Tensor | None]:
    """What the policy is shown of observations (N, width), see `NormalisedMlp.seen`.

    That does not depend on its weights, so one look serves a whole update.
    """
    extractor = policy.features_extractor
    return extractor.seen(observations) if isinstance(extractor, NormalisedMlp) else (observations, None)


def evaluate_seen(policy: ActorCriticPolicy, seen: Tensor) -> OnOff:
    """As `evaluate`, of what `look` returned; thrusters are in the order of that view.

    SB3 gives each thruster two logits and one distribution object; the probability of opening needs
    only their difference, so both heads shrink to one product with n + 1 outputs.
    """
    extractor = policy.features_extractor
    features = extractor.features(seen) if isinstance(extractor, NormalisedMlp) else extractor(seen)
    latent_pi, latent_vf = policy.mlp_extractor(features)
    head, critic = policy.action_net, policy.value_net
    weight = head.weight[1::2] - head.weight[0::2]  # type: ignore[index]
    bias = head.bias[1::2] - head.bias[0::2]  # type: ignore[index]
    if latent_pi is latent_vf:
        out = functional.linear(
            latent_pi, torch.cat((weight, critic.weight)), torch.cat((bias, critic.bias)))
        return OnOff(out[:, :-1], out[:, -1])
    return OnOff(functional.linear(latent_pi, weight, bias), critic(latent_vf).squeeze(1))


class OnOffPolicy(ActorCriticPolicy):
    """SB3's actor-critic for on/off thrusters, with its probabilities from `evaluate`.

    SB3's own has no place for thrusters that swap their roles with the side the spacecraft is seen from.
    """

    def forward(self, obs: Tensor, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        """As SB3: actions (N, thrusters), values (N, 1), log-probabilities (N,)."""
        output = evaluate(self, obs)
        action = output.mode() if deterministic else output.sample()
        return action.long(), output.value[:, None], output.log_prob(action)

    def get_distribution(self, obs: Any) -> Distribution:
        """As SB3."""
        logit = evaluate(self, obs).logit
        both = torch.stack((torch.zeros_like(logit), logit), dim=2).flatten(1)
        return self.action_dist.proba_distribution(action_logits=both)  # type: ignore[call-arg]

    def evaluate_actions(self, obs: Any, actions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As SB3: values (N, 1), log-probabilities and entropies (N,) of actions (N, thrusters)."""
        output = evaluate(self, obs)
        return output.value[:, None], output.log_prob(actions.to(output.logit.dtype)), output.entropy()

    def predict_values(self, obs: Any) -> Tensor:
        """As SB3: values (N, 1)."""
        return evaluate(self, obs).value[:, None]
