"""PPO for K trainings at once: one batch of environments, one rollout, one update.

Member k learns what `rans.fast.PPO` alone would learn from the same random numbers, up to rounding:
advantages are normalised, gradients clipped, step sizes adapted and observations normalised per member.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from rans.fast.learn.batched_network import Network
from rans.fast.learn.graph import fused, graphed
from rans.fast.learn.members import MembersEngine
from rans.fast.learn.ppo import MIN_LEARNING_RATE, PPO
from rans.fast.learn.rollout import Batch, gae, in_view, remember, slots
from rans.fast.policy import set_precision


class Coefficients(NamedTuple):
    """Hyper-parameters in which members may differ, by their names in `PPOSettings`; each (K,)."""

    learning_rate: Tensor
    desired_kl: Tensor
    """NaN: the learning rate is constant."""
    max_learning_rate: Tensor
    anneal: Tensor
    gamma: Tensor
    gae_lambda: Tensor
    clip_range: Tensor
    ent_coef: Tensor
    vf_coef: Tensor
    max_grad_norm: Tensor
    reward_scale: Tensor

    @classmethod
    def of(cls, models: Sequence[PPO], device: torch.device, dtype: torch.dtype) -> Coefficients:
        """Those of these trainings."""
        def value(model: PPO, name: str) -> float:
            if name == "clip_range":
                return model.clip_range(1.0)  # type: ignore[operator]
            given = getattr(model, name)
            return float("nan") if given is None else given

        return cls(*(torch.tensor([value(model, name) for model in models], device=device, dtype=dtype)
                     for name in cls._fields))


class Start(NamedTuple):
    """One training about to take its first step, on the CPU."""

    model: PPO
    random: Tensor
    """State of the generator that its actions will be drawn from."""


class BatchedPPO:
    """K trainings with the same network and sizes, but their own seeds and coefficients.

    Args:
        starts: the trainings; their environments and weights are copied.
        device: where to train.
    """

    def __init__(self, starts: Sequence[Start], device: torch.device) -> None:
        models = [start.model for start in starts]
        first, engines = models[0], [model.env.engine for model in models]  # type: ignore[union-attr]
        set_precision(first.matmul, device)
        self.members, self.each, self.device = len(models), engines[0].num_envs, device
        self.engine = MembersEngine(engines[0].craft, [engine.task for engine in engines], self.each,
                                    engines[0].timing, device=device, dtype=engines[0].dtype)
        self.engine.adopt(engines)
        self.network = Network([model.policy for model in models], device)
        self.coefficients = Coefficients.of(models, device, self.engine.dtype)
        self._ceiling = self.coefficients.max_learning_rate.clone()
        self.n_steps, self.n_epochs = first.n_steps, first.n_epochs
        self._minibatches = self.each * self.n_steps // first.batch_size
        self._rollout = _Rollout(self.engine, self.n_steps)
        self._adam = _Adam(self.network.parameters, self.coefficients.learning_rate,
                           **{key: first.policy.optimizer.defaults[key] for key in ("betas", "eps")})
        # Each member's own numbers where that costs little; on a GPU one stream feeds all.
        self._generators = [_generator(start.random) for start in starts] if device.type == "cpu" else []
        self._compile()

    def _compile(self) -> None:
        device = self.device
        self._act, self._gae, self._losses = fused(act, device), fused(gae, device), fused(losses, device)
        self._descend, self._see = fused(_Adam.step, device), fused(Network.update_statistics, device)
        self._show, self._remember = fused(shown, device), fused(remember, device)
        self.collect = graphed(self._collect, device)
        self.update = graphed(self._update, device)

    def slow_down(self, remaining: float) -> None:
        """As `PPO`, per member."""
        highest, anneal = self.coefficients.max_learning_rate, self.coefficients.anneal
        self._ceiling.copy_(highest * (remaining / anneal.clamp(min=1e-9)).clamp(max=1.0))

    @torch.no_grad()
    def _collect(self) -> Tensor:
        """Let every member fly its environments; the rewards (T, K n)."""
        observation, memory = self.engine.observe(), self._rollout
        for slot in memory.slots:
            acted = self._act(self.network, observation, self._uniform())
            step = self.engine.step(acted[0])
            self._remember(observation, acted, step, slot, memory.cut)
            observation = step.observation
        return memory.reward

    def _uniform(self) -> Tensor:
        """Random numbers (K n, thrusters) in [0, 1)."""
        width, dtype = len(self.engine.craft.thrusters), self.engine.dtype
        if not self._generators:
            return torch.rand(self.engine.num_envs, width, dtype=dtype, device=self.device)
        return torch.cat([torch.rand(self.each, width, dtype=dtype, generator=generator)
                          for generator in self._generators])

    def _update(self) -> Tensor:
        """Advantages, every minibatch of every epoch, step sizes: the step sizes (K,)."""
        batch = self._batch()
        parts = self._parts(batch)
        divergence = [self._learn_from(part) for _ in range(self.n_epochs) for part in parts]
        self._adapt(torch.stack(divergence).mean(dim=0))
        self._see(self.network, batch.seen)
        return self._adam.rate

    @torch.no_grad()
    def _batch(self) -> Batch:
        """Everything collected with its advantages, each field (T, K n, ...); see `Rollout.batch`."""
        memory = self._rollout
        last, beyond = (self.network.evaluate(x).value for x in (self.engine.observe(), memory.cut))
        gamma, gae_lambda, scale = (
            getattr(self.coefficients, name).repeat_interleave(self.each)
            for name in ("gamma", "gae_lambda", "reward_scale"))
        reward = memory.reward * scale + gamma * memory.truncated * beyond
        advantage = self._gae(reward, memory.value, memory.ended, last, gamma, gae_lambda)
        seen, action = (x.unflatten(0, memory.reward.shape) for x in self._show(
            self.network, memory.observation.flatten(0, 1), memory.action.flatten(0, 1)))
        return Batch(seen, action, memory.log_prob, advantage, advantage + memory.value)

    def _parts(self, batch: Batch) -> list[Batch]:
        """Minibatches of whole environments, the same for a member as alone; fields (K, rows, ...)."""
        def cut(field: Tensor) -> list[Tensor]:
            chunks = field.unflatten(1, (self.members, self.each)).chunk(self._minibatches, dim=2)
            return [chunk.transpose(0, 1).flatten(1, 2) for chunk in chunks]

        return [Batch(*fields) for fields in zip(*map(cut, batch), strict=True)]

    def _learn_from(self, part: Batch) -> Tensor:
        loss, divergence = self._losses(self.network, part, self.coefficients)
        gradients = torch.autograd.grad(loss.sum(), self.network.parameters)
        self._descend(self._adam, gradients, self.coefficients.max_grad_norm)
        return divergence.detach()

    def _adapt(self, divergence: Tensor) -> None:
        """As `PPO`, per member."""
        rate, desired = self._adam.rate, self.coefficients.desired_kl
        factor = torch.where(divergence > 2.0 * desired, 1 / 1.5,
                             torch.where(divergence < 0.5 * desired, 1.5, 1.0))
        bounded = torch.minimum((rate * factor).clamp(min=MIN_LEARNING_RATE), self._ceiling)
        rate.copy_(torch.where(desired.isnan(), rate, bounded))


class _Rollout:
    """T steps of all environments, in memory that never moves; see `rans.fast.learn.rollout.Rollout`."""

    def __init__(self, engine: MembersEngine, steps: int) -> None:
        count, width, thrusters = engine.num_envs, engine.observation_width, len(engine.craft.thrusters)
        new = lambda *shape: torch.zeros(*shape, dtype=engine.dtype, device=engine.device)  # noqa: E731
        self.observation, self.action = new(steps, count, width), new(steps, count, thrusters)
        self.log_prob, self.value, self.reward = (new(steps, count) for _ in range(3))
        self.ended, self.truncated, self.cut = new(steps, count), new(steps, count), new(count, width)
        self.slots = slots(self)


class _Adam:
    """Adam (Kingma and Ba, 2015) on weights (K, ...), with a step size and a gradient norm per member."""

    def __init__(self, parameters: Sequence[Tensor], rate: Tensor, betas: tuple[float, float],
                 eps: float) -> None:
        self.rate, self._betas, self._eps = rate.clone(), betas, eps
        self._parameters = list(parameters)
        self._first = [torch.zeros_like(p, requires_grad=False) for p in parameters]
        self._second = [torch.zeros_like(p, requires_grad=False) for p in parameters]
        self._steps = torch.zeros((), dtype=rate.dtype, device=rate.device)

    @torch.no_grad()
    def step(self, gradients: Sequence[Tensor], max_norm: Tensor) -> None:
        """One step down these gradients, those of a member scaled down to ``max_norm`` (K,) together."""
        norm = torch.stack([g.square().flatten(1).sum(dim=1) for g in gradients]).sum(dim=0).sqrt()
        shrink = (max_norm / (norm + 1e-6)).clamp(max=1.0)  # torch.nn.utils.clip_grad_norm_
        self._steps += 1
        keep, keep_square = self._betas
        rate = self.rate / (1 - keep**self._steps)
        root = (1 - keep_square**self._steps).sqrt()
        for weight, gradient, first, second in zip(self._parameters, gradients, self._first, self._second,
                                                   strict=True):
            per_member = (-1,) + (1,) * (weight.dim() - 1)
            g = gradient * shrink.view(per_member)
            first.lerp_(g, 1 - keep)
            second.lerp_(g * g, 1 - keep_square)
            weight -= rate.view(per_member) * first / (second.sqrt() / root + self._eps)


def act(network: Network, observation: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Random actions (K n, thrusters), their log-probabilities (K n,) and the states' values (K n,)."""
    output = network.evaluate(observation)
    action = (uniform < torch.sigmoid(output.logit)).to(uniform.dtype)
    return action, output.log_prob(action), output.value


def shown(network: Network, observation: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """As `rans.fast.learn.rollout.shown`; all members see from the same sides."""
    seen, place = network.look(observation)
    return seen, in_view(action, place)


def losses(network: Network, batch: Batch, coefficients: Coefficients) -> tuple[Tensor, Tensor]:
    """PPO's loss (K,) of `rans.fast.learn.loss.ppo_loss` per member, and the divergence (K,)."""
    per_member = lambda x: x.view_as(batch.log_prob)  # noqa: E731
    output = network.evaluate_seen(batch.seen)
    spread, mean = torch.std_mean(batch.advantage, dim=1, keepdim=True)
    advantage = (batch.advantage - mean) / (spread + 1e-8)
    log_ratio = per_member(output.log_prob(batch.action.flatten(0, 1))) - batch.log_prob
    ratio, clip_range = log_ratio.exp(), coefficients.clip_range[:, None]
    clipped = ratio.clamp(1 - clip_range, 1 + clip_range)
    surrogate = -torch.minimum(advantage * ratio, advantage * clipped).mean(dim=1)
    value = (batch.target - per_member(output.value)).square().mean(dim=1)
    entropy = per_member(output.entropy()).mean(dim=1)
    loss = surrogate + coefficients.vf_coef * value - coefficients.ent_coef * entropy
    return loss, ((ratio - 1) - log_ratio).mean(dim=1)


def _generator(state: Tensor) -> torch.Generator:
    generator = torch.Generator()
    generator.set_state(state)
    return generator
