"""Learning down the gradient of the return itself: through the network, the thrusters and the motion.

Equations of motion, observations and rewards are smooth but for the ends of episodes, and torch knows the
gradient of every step (`rans.fast.engine.Engine.stepped`). An iteration flies every environment for T control
periods and descends once through all of them; what comes after those, a critic tells. T periods are a short
horizon, as in SHAC (Xu et al., "Accelerated policy learning with parallel differentiable simulation", 2022),
or, where T is as long as an episode and all begin together, whole episodes.

It needs thrusters that are throttled: whether a valve opens has no gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from rans.episode import Episode
from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import Coefficients, GradientSettings, PPOSettings
from rans.fast.learn.rollout import Acted, Batch, Rollout, gae, minibatches, remember
from rans.model.fields import map_leaves
from rans.policy.network import Network


class GradientLearner:
    """K trainings down the gradient of their returns; a `rans.fast.learn.learner.Learner`.

    Per iteration: one step of the policy down the gradient of

        -mean over environments of (sum over t of gamma^t r_t + gamma^T V(s_T)) / T

    with V of the states in which time cut an episode off as well, and discounts that begin anew with every
    episode; then ``n_epochs`` passes of a critic over the same steps, towards the targets of TD(lambda).

    The critic is a network of its own, of the same architecture. It is no part of the agent, whose value head
    learns nothing. V is the target network, a copy that follows the critic slowly.

    Args:
        engine: a plain one, of a craft with throttled thrusters.
        network: the agents; changed in place.
        settings: one a member; ``n_steps`` is T, ``batch_size`` and ``n_epochs`` are of the critic.
        generators: one a member, of the noise on commands.
        own: what only this learner has, for all members.

    Raises:
        ConfigError: thrusters are not throttled, the engine is not plain, or the network is recurrent.
    """

    statistics = ("loss", "value_loss", "noise", "grad_norm", "critic_grad_norm")
    description = "gradients through the motion"

    def __init__(
        self,
        engine: Engine,
        network: Network,
        settings: Sequence[PPOSettings],
        generators: Sequence[torch.Generator],
        own: GradientSettings,
    ) -> None:
        _check(engine, network)
        first = settings[0]
        self.members = len(settings)
        self.engine = engine
        self.network = network
        self.processes = engine.processes
        self.n_steps = first.n_steps
        self._n_epochs = first.n_epochs
        self._minibatches = first.n_envs * first.n_steps // first.batch_size
        self._generators = generators
        self._own = own
        # The policy.
        if "log_std" in network.tensors:
            with torch.no_grad():
                network.tensors["log_std"].fill_(own.noise).log_()
        self.rollout = Rollout(engine, network, first.n_steps)
        self.coefficients = Coefficients.of(settings, self.rollout.failed)
        self.adam = Adam(network, self.coefficients.learning_rate, plain=True)
        # The critic, and V, the target network.
        self.critic = self._copy()
        self._target = self._copy()
        self._critic_adam = Adam(
            self.critic,
            torch.full_like(self.coefficients.learning_rate, own.critic_learning_rate),
            plain=True,
        )

    def _copy(self) -> Network:
        """A network with the weights that the agents have now."""
        network = self.network
        tensors = {name: x.detach().clone() for name, x in network.tensors.items()}
        return Network(network.architecture, tensors, network.members)

    def slow_down(self, remaining: float) -> None:
        """Lower the step sizes towards zero where less than ``anneal`` of all steps remains."""
        coefficients = self.coefficients
        share = (remaining / coefficients.anneal.clamp(min=1e-9)).clamp(max=1.0)
        self.adam.rate.copy_(coefficients.learning_rate * share)
        self._critic_adam.rate.copy_(self._own.critic_learning_rate * share)

    def learn(self) -> Tensor:
        """One iteration, see `rans.fast.learn.learner.Learner.learn`."""
        loss = self.loss()
        norm = self.adam.descend(loss.sum(), self.coefficients.max_grad_norm, self.processes)
        value_loss, critic_norm = self._fit()
        with torch.no_grad():
            spread = self.network.tensors["log_std"].exp().view(self.members, -1).mean(dim=1)
            values = torch.stack((loss.detach(), value_loss, spread, norm, critic_norm), dim=1)
            means = self.processes.average(torch.cat((values, self.rollout.totals()), dim=1))
            first, rest = means.tensor_split([len(self.statistics)], dim=1)
            return torch.cat((first, self.adam.rate[:, None], rest), dim=1)

    # The policy: T control periods, with their gradient.

    def loss(self) -> Tensor:
        """Fly every environment for T control periods: minus the members' mean returns over T, (K,).

        The engine's episodes go on from where this ends, and the rollout remembers the steps.
        """
        engine = self.engine
        network = self.network
        rollout = self.rollout
        coefficients = self.coefficients
        gamma = rollout.spread(coefficients.gamma)
        scale = rollout.spread(coefficients.reward_scale)
        rollout.begin()
        episode = engine.running()
        observation = engine.observe()
        memory = None if rollout.memory is None else rollout.memory.clone()
        # What was gained, and what the next reward counts, per environment.
        gained = torch.zeros_like(rollout.all.reward[0])
        weight = torch.ones_like(gained)
        # Where time cut an episode off: what was seen then, and what its value counts.
        cut = rollout.cut.clone()
        cut_memory = None if memory is None else memory.clone()
        cut_weight = torch.zeros_like(gained)
        for uniform, slot in zip(rollout.uniform(self._generators), rollout.steps, strict=True):
            privileged = self._privileged(episode)
            output, columns = network.forward(observation, memory)
            action, command = output.policy.differentiable(uniform)
            after = network.next_state(columns, memory, command, output)
            step, episode = engine.stepped(episode, engine.commands(command))
            # What is passed back from one period to the one before is bounded.
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
        # What comes after: of the states in which episodes were cut off, and of the last ones.
        beside = rollout.beside
        privileged = self._privileged(episode)
        values = self._target.evaluate(
            beside(cut, observation),
            None if memory is None or cut_memory is None else beside(cut_memory, memory),
            None if privileged is None else beside(privileged, privileged),
        ).value.view(self.members, 2, -1)
        gained = gained + cut_weight * values[:, 0].flatten() + weight * values[:, 1].flatten()
        engine.go_on(episode)
        return -gained.view(self.members, -1).mean(dim=1) / self.n_steps

    def _bounded(self, x: Any) -> Any:
        """Numbers unchanged, with their gradient clipped to the bound of one environment's return."""
        if not isinstance(x, Tensor) or not x.requires_grad:
            return x
        bound = self._own.bound * self.members / (self.engine.num_envs * self.n_steps)
        x = x.view_as(x)
        x.register_hook(lambda gradient: gradient.clamp(-bound, bound))
        return x

    def _privileged(self, episode: Episode) -> Tensor | None:
        """Privileged observation of the critic, (N, p); None without one."""
        architecture = self.network.architecture
        return self.engine.privileged_of(episode).detach() if architecture.privileged else None

    # The critic: the same steps, without the motion's gradient.

    def _fit(self) -> tuple[Tensor, Tensor]:
        """Means of the critic's loss and of its gradient's norm, (K,) each."""
        batch = self._targets()
        parts = minibatches(batch, self.members, self._minibatches)
        results = []
        for _ in range(self._n_epochs):
            for part in parts:
                value = self.critic.evaluate_seen(part.columns, part.memory, part.privileged).value
                loss = (value - part.target).square().view(self.members, -1).mean(dim=1)
                norm = self._critic_adam.descend(
                    loss.sum(), self.coefficients.max_grad_norm, self.processes
                )
                results.append(torch.stack((loss.detach(), norm)))
        for network in (self.network, self.critic):
            network.update_statistics(batch.columns, self.processes.pooled, self.processes.size)
        self._move_target()
        value_loss, norm = torch.stack(results).mean(dim=0)
        return value_loss, norm

    @torch.no_grad()
    def _targets(self) -> Batch:
        """The rollout with what V should have been in it, (T, N, ...) each."""
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
            None,
        )
        # One minibatch is all steps, one member's after the other's, as networks want them.
        (whole,) = minibatches(batch, self.members, 1)
        value = self._target.evaluate_seen(whole.columns, whole.memory, whole.privileged).value
        value = value.view(self.members, shape[0], -1).transpose(0, 1).flatten(1)
        privileged = self._privileged(self.engine.episode)
        values = self._target.evaluate(
            rollout.beside(self.engine.observe(), rollout.cut),
            None
            if rollout.memory is None or rollout.cut_memory is None
            else rollout.beside(rollout.memory, rollout.cut_memory),
            None if privileged is None else rollout.beside(privileged, privileged),
        ).value.view(self.members, 2, -1)
        last = values[:, 0].flatten()
        beyond = values[:, 1].flatten()
        coefficients = self.coefficients
        gamma = rollout.spread(coefficients.gamma)
        reward = kept.reward * rollout.spread(coefficients.reward_scale)
        reward = reward + gamma * kept.truncated * beyond
        advantage = gae(
            reward, value, kept.ended, last, gamma, rollout.spread(coefficients.gae_lambda)
        )
        return batch._replace(advantage=advantage, target=advantage + value)

    @torch.no_grad()
    def _move_target(self) -> None:
        """V takes a share of the critic's weights, and all of what it knows of its inputs."""
        learnt = {*self.critic.learnt}
        for name, tensor in self.critic.tensors.items():
            self._target.tensors[name].lerp_(
                tensor, self._own.target_rate if name in learnt else 1.0
            )

    def state(self) -> dict[str, Any]:
        """See `rans.fast.learn.learner.Learner`."""
        memory = self.rollout.memory
        return {
            "weights": _weights(self.network),
            "critic": _weights(self.critic),
            "target": _weights(self._target),
            "adam": self.adam.state(),
            "critic_adam": self._critic_adam.state(),
            "generators": [generator.get_state() for generator in self._generators],
            "memory": None if memory is None else self.processes.whole(memory),
        }

    @torch.no_grad()
    def load(self, saved: dict[str, Any]) -> None:
        """See `rans.fast.learn.learner.Learner`."""
        networks = {"weights": self.network, "critic": self.critic, "target": self._target}
        for key, network in networks.items():
            for name, tensor in network.tensors.items():
                tensor.copy_(saved[key][name])
        self.adam.load(saved["adam"])
        self._critic_adam.load(saved["critic_adam"])
        for generator, state in zip(self._generators, saved["generators"], strict=True):
            generator.set_state(state.cpu())
        if self.rollout.memory is not None:
            self.rollout.memory.copy_(self.processes.mine(saved["memory"]))


def _weights(network: Network) -> dict[str, Tensor]:
    return {name: x.detach() for name, x in network.tensors.items()}


def _check(engine: Engine, network: Network) -> None:
    """Refuse (`ConfigError`) what has no gradient."""
    actuators = engine.craft.actuators
    if not actuators.has_gradient:
        raise ConfigError(
            f"the algorithm 'gradient' needs thrusters that are throttled, and those of "
            f"{engine.craft.name} are {actuators.kind}: whether a valve opens has no gradient. Give the craft "
            'actuators of the kind "throttle", or train with the algorithm "ppo".'
        )
    if not engine.plain:
        raise ConfigError("the algorithm 'gradient' learns on a plain engine only.")
    if network.architecture.units:
        raise ConfigError(
            "the algorithm 'gradient' knows no recurrent memory; use memory 'history' or 'commands'."
        )
