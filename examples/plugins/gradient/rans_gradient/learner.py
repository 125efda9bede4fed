"""Gradient learner: the gradient of the return through the network, the thrusters and the motion.

Equations of motion, observations and rewards are smooth except at the ends of episodes, and torch computes the
gradient of every step (`rans.fast.engine.Engine.stepped`). An iteration flies every environment for T control
periods and takes one gradient step through all of them; a critic values the states after them. T is a short
horizon, as in SHAC (Xu et al., "Accelerated policy learning with parallel differentiable simulation", 2022), or a
whole episode.

Thrusters must be throttled, because the opening of a valve has no gradient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import torch
from torch import Tensor

from rans.episode import Episode
from rans.extend import (
    Acted,
    Adam,
    Algorithm,
    ConfigError,
    Engine,
    Network,
    PPOSettings,
    Rollout,
    TrainConfig,
    map_leaves,
    remember,
    require_bounds,
)
from rans.fast.learn.rollout import Batch, gae, minibatches


@dataclass(frozen=True)
class GradientSettings:
    """Hyper-parameters of the gradient learner, besides `PPOSettings`.

    Raises:
        ConfigError: a number is out of its range.
    """

    critic_learning_rate: float = 2e-3
    """Step size of the critic, a separate network."""
    target_rate: float = 0.2
    """Share of the critic's weights that the target network, which values the state after the horizon, takes over
    in an iteration (Polyak averaging)."""
    noise: float = 0.2
    """Initial standard deviation of commands, which is learnt."""
    bound: float = 10.0
    """Bound on the derivative of the scaled return by each number of state and observation that is passed back
    from a control period to the one before; it would otherwise grow without bound over many periods of a policy
    with high gain."""

    def __post_init__(self) -> None:
        require_bounds(
            self,
            "finite and > 0",
            lambda x: 0 < x < math.inf,
            "critic_learning_rate",
            "noise",
            "bound",
        )
        require_bounds(self, "in (0, 1]", lambda x: 0 < x <= 1, "target_rate")


class GradientLearner:
    """Learner by the gradient of the return; a `rans.fast.learn.learner.Learner`.

    In every iteration the policy takes one gradient step on

        -mean over environments of (sum over t of gamma^t r_t + gamma^T V(s_T)) / T

    where truncated episodes also end with V, and discounts restart with every episode. Then the critic makes
    ``n_epochs`` passes over the same steps, with TD(lambda) targets.

    The critic is a separate network of the same architecture and not part of the agent, whose value head is not
    trained. V is the target network, a copy that follows the critic slowly.

    Args:
        engine: plain engine of a craft with throttled thrusters.
        network: network of the agents, changed in place.
        settings: ``n_steps`` is T, ``batch_size`` and ``n_epochs`` are those of the critic.
        generator: random generator of the noise on commands.
        plain: without meaning, as everything is computed by single operations of torch.
        own: further hyper-parameters of this learner.

    Raises:
        ConfigError: thrusters are not throttled, or the engine is not plain.
    """

    statistics = ("loss", "value_loss", "noise", "grad_norm", "critic_grad_norm")
    description = "gradients through the motion"

    def __init__(
        self,
        engine: Engine,
        network: Network,
        settings: PPOSettings,
        generator: torch.Generator,
        plain: bool,
        own: GradientSettings,
    ) -> None:
        _check(engine, network)
        self.engine = engine
        self.network = network
        self.processes = engine.processes
        self.settings = settings
        self.n_steps = settings.n_steps
        self._minibatches = settings.n_envs * settings.n_steps // settings.batch_size
        self._generator = generator
        self._own = own
        # The policy.
        if "log_std" in network.tensors:
            with torch.no_grad():
                network.tensors["log_std"].fill_(own.noise).log_()
        self.rollout = Rollout(engine, network, settings.n_steps)
        self.adam = Adam(network, settings.learning_rate, plain=True)
        # The critic, and V, the target network.
        self.critic = self._copy()
        self._target = self._copy()
        self._critic_adam = Adam(self.critic, own.critic_learning_rate, plain=True)

    def _copy(self) -> Network:
        """Copy of the network with its present weights."""
        network = self.network
        tensors = {name: x.detach().clone() for name, x in network.tensors.items()}
        return Network(network.architecture, tensors)

    def slow_down(self, remaining: float) -> None:
        """Reduce the step sizes towards zero while less than ``anneal`` of all steps remains."""
        left = self.settings.schedule.left(remaining)
        self.adam.rate.fill_(self.settings.learning_rate * left)
        self._critic_adam.rate.fill_(self._own.critic_learning_rate * left)

    def learn(self) -> Tensor:
        """Run one iteration, see `rans.fast.learn.learner.Learner.learn`."""
        loss = self.loss()
        norm = self.adam.descend(loss, self.settings.max_grad_norm, self.processes)
        value_loss, critic_norm = self._fit()
        with torch.no_grad():
            spread = self.network.tensors["log_std"].exp().mean()
            values = torch.stack((loss.detach(), value_loss, spread, norm, critic_norm))
            means = self.processes.average(torch.cat((values, self.rollout.totals())))
            first, rest = means.tensor_split([len(self.statistics)])
            return torch.cat((first, self.adam.rate[None], rest))

    # The policy: T control periods, with their gradient.

    def loss(self) -> Tensor:
        """Fly every environment for T control periods; returns minus the mean return over T, ().

        The episodes of the engine continue from the end, and the rollout stores the steps.
        """
        engine = self.engine
        network = self.network
        rollout = self.rollout
        gamma = self.settings.gamma
        scale = self.settings.reward_scale
        rollout.begin()
        episode = engine.running()
        observation = engine.observe()
        memory = None if rollout.memory is None else rollout.memory.clone()
        # Return so far, and discount of the next reward, per environment.
        gained = torch.zeros_like(rollout.all.reward[0])
        weight = torch.ones_like(gained)
        # Last truncated episode of each environment: its final observation, and the discount of its value.
        cut = rollout.cut.clone()
        cut_memory = None if memory is None else memory.clone()
        cut_weight = torch.zeros_like(gained)
        for uniform, slot in zip(rollout.uniform(self._generator), rollout.steps, strict=True):
            privileged = self._privileged(episode)
            output, columns = network.forward(observation, memory)
            action, command = output.policy.differentiable(uniform)
            after = network.next_state(columns, memory, command)
            step, episode = engine.stepped(episode, engine.commands(command))
            # Bound the gradients that are passed back to the period before.
            episode = replace(episode, state=map_leaves(self._bounded, episode.state))
            step = step._replace(observation=self._bounded(step.observation))
            with torch.no_grad():
                acted = Acted(action, output.policy.log_prob(action), output.value, command, after)
                remember(observation, acted, privileged, step, slot, rollout)
            ended = (step.terminated | step.truncated)[:, None]
            last = step.truncated[:, None]
            gained = gained + weight * (scale * step.reward)
            weight = weight * gamma
            cut = torch.where(last, step.final_observation, cut)
            cut_weight = torch.where(step.truncated, weight, cut_weight)
            if memory is not None and after is not None and cut_memory is not None:
                cut_memory = torch.where(last, after, cut_memory)
                memory = torch.where(ended, 0.0, after)
            weight = torch.where(ended[:, 0], 1.0, weight)
            observation = step.observation
        # Values of the states in which episodes were truncated, and of the last states.
        privileged = self._privileged(episode)
        values = self._target.evaluate(
            torch.cat((cut, observation)),
            None if memory is None or cut_memory is None else torch.cat((cut_memory, memory)),
            None if privileged is None else privileged.repeat(2, 1),
        ).value
        at_cut, at_end = values.chunk(2)
        gained = gained + cut_weight * at_cut + weight * at_end
        engine.go_on(episode)
        return -gained.mean() / self.n_steps

    def _bounded(self, x: Any) -> Any:
        """Numbers unchanged, with their gradient clipped to the bound of one environment's return."""
        if not isinstance(x, Tensor) or not x.requires_grad:
            return x
        bound = self._own.bound / (self.engine.num_envs * self.n_steps)
        x = x.view_as(x)
        x.register_hook(lambda gradient: gradient.clamp(-bound, bound))
        return x

    def _privileged(self, episode: Episode) -> Tensor | None:
        """Privileged observation of the critic, (N, p); None without one."""
        architecture = self.network.architecture
        return self.engine.privileged_of(episode).detach() if architecture.privileged else None

    # The critic: the same steps, without the motion's gradient.

    def _fit(self) -> tuple[Tensor, Tensor]:
        """Train the critic; returns means of its loss and of the norm of its gradient, () each."""
        batch = self._targets()
        parts = minibatches(batch, self._minibatches)
        results = []
        for _ in range(self.settings.n_epochs):
            for part in parts:
                value = self.critic.evaluate_seen(part.columns, part.memory, part.privileged).value
                loss = (value - part.target).square().mean()
                norm = self._critic_adam.descend(loss, self.settings.max_grad_norm, self.processes)
                results.append(torch.stack((loss.detach(), norm)))
        for network in (self.network, self.critic):
            network.update_statistics(batch.columns, self.processes.pooled, self.processes.size)
        self._move_target()
        value_loss, norm = torch.stack(results).mean(dim=0)
        return value_loss, norm

    @torch.no_grad()
    def _targets(self) -> Batch:
        """Rollout with the value targets, (T, N, ...) each."""
        rollout = self.rollout
        kept = rollout.all
        shape = kept.reward.shape
        columns = self.critic.in_body(kept.observation.flatten(0, 1))
        memory = None if kept.memory is None else kept.memory.flatten(0, 1)
        seen, memory, _ = self.critic.look(columns, memory)
        batch = Batch(
            seen.unflatten(0, shape),
            kept.action,
            kept.log_prob,
            kept.reward,
            kept.reward,
            None if memory is None else memory.unflatten(0, shape),
            kept.privileged,
        )
        # One minibatch of all steps.
        (whole,) = minibatches(batch, 1)
        value = self._target.evaluate_seen(whole.columns, whole.memory, whole.privileged).value
        value = value.unflatten(0, shape)
        privileged = self._privileged(self.engine.episode)
        values = self._target.evaluate(
            torch.cat((self.engine.observe(), rollout.cut)),
            None
            if rollout.memory is None or rollout.cut_memory is None
            else torch.cat((rollout.memory, rollout.cut_memory)),
            None if privileged is None else privileged.repeat(2, 1),
        ).value
        last, beyond = values.chunk(2)
        settings = self.settings
        reward = kept.reward * settings.reward_scale + settings.gamma * kept.truncated * beyond
        advantage = gae(reward, value, kept.ended, last, settings.gamma, settings.gae_lambda)
        return batch._replace(advantage=advantage, target=advantage + value)

    @torch.no_grad()
    def _move_target(self) -> None:
        """Move the target network towards the critic (Polyak averaging), with its input statistics copied."""
        learnt = {*self.critic.learnt}
        for name, tensor in self.critic.tensors.items():
            self._target.tensors[name].lerp_(
                tensor, self._own.target_rate if name in learnt else 1.0
            )

    def state(self) -> dict[str, Any]:
        """State of the learner without the episodes of the engine; all processes must call it."""
        memory = self.rollout.memory
        return {
            "weights": _weights(self.network),
            "critic": _weights(self.critic),
            "target": _weights(self._target),
            "adam": self.adam.state(),
            "critic_adam": self._critic_adam.state(),
            "generators": [self._generator.get_state()],
            "memory": None if memory is None else self.processes.whole(memory),
        }

    @torch.no_grad()
    def load(self, saved: dict[str, Any]) -> None:
        """Continue from the result of `state`."""
        networks = {"weights": self.network, "critic": self.critic, "target": self._target}
        for key, network in networks.items():
            for name, tensor in network.tensors.items():
                tensor.copy_(saved[key][name])
        self.adam.load(saved["adam"])
        self._critic_adam.load(saved["critic_adam"])
        (random,) = saved["generators"]
        self._generator.set_state(random.cpu())
        if self.rollout.memory is not None:
            self.rollout.memory.copy_(self.processes.mine(saved["memory"]))


def _weights(network: Network) -> dict[str, Tensor]:
    return {name: x.detach() for name, x in network.tensors.items()}


def _check(engine: Engine, network: Network) -> None:
    """Reject (`ConfigError`) engines and networks without the gradients that the learner needs."""
    actuators = engine.craft.actuators
    if not actuators.has_gradient:
        raise ConfigError(
            f"the algorithm 'gradient' needs thrusters that are throttled, and those of "
            f"{engine.craft.name} are {actuators.kind}: whether a valve opens has no gradient. Give the craft "
            'actuators of the kind "throttle", or train with the algorithm "ppo".'
        )
    if not engine.plain:
        raise ConfigError("the algorithm 'gradient' learns on a plain engine only.")


_PRESET: dict[str, Any] = {
    "n_envs": 256,
    "n_steps": 16,
    "batch_size": 1024,
    "n_epochs": 4,
    "learning_rate": 3e-3,
}
"""Hyper-parameters for any throttled spacecraft (docs/decisions/learners.md)."""
_REPORTS = 24
"""Iterations between reports; as many environment steps as with PPO."""


class Gradient(Algorithm):
    """Learning by the gradient of the return through the motion."""

    settings: ClassVar[type] = GradientSettings
    needs_autograd: ClassVar[bool] = True

    @classmethod
    def started(cls, config: TrainConfig) -> TrainConfig:
        """Config with hyper-parameters known to work."""
        return replace(config, ppo=replace(config.ppo, **_PRESET), report_interval=_REPORTS)

    @classmethod
    def making(cls, config: TrainConfig, craft: Any, own: GradientSettings) -> Any:
        """Constructor of the learner."""
        return partial(GradientLearner, own=own)
