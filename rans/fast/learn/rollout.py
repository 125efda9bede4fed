"""Experience on the device: collected by the policy, turned into advantages, cut into minibatches."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from rans.fast.engine import Engine
from rans.fast.learn.graph import fused
from rans.fast.policy import evaluate, look
from rans.fast.step import Step


class Batch(NamedTuple):
    """Transitions to learn from; every first dimension is the transition."""

    seen: Tensor
    """What the policy was shown, see `rans.fast.policy.look`."""
    action: Tensor
    """Of the thrusters in the order of that view."""
    log_prob: Tensor
    advantage: Tensor
    target: Tensor
    """What the value should have been: the advantage plus the value at collection."""


class Slot(NamedTuple):
    """Memory of one step of N environments."""

    observation: Tensor
    action: Tensor
    log_prob: Tensor
    value: Tensor
    reward: Tensor
    ended: Tensor
    truncated: Tensor


def slots(memory: Any) -> list[Slot]:
    """Those of every step, of memory whose fields have the names of `Slot`'s."""
    fields = [getattr(memory, name) for name in Slot._fields]
    return [Slot(*step) for step in zip(*fields, strict=True)]


class Rollout:
    """T steps of N environments, in memory that never moves (a CUDA graph writes into it).

    Args:
        engine: decides N, width, thrusters, device and dtype.
        n_steps: T.
    """

    def __init__(self, engine: Engine, n_steps: int) -> None:
        count, width, thrusters = engine.num_envs, engine.observation_width, len(engine.craft.thrusters)
        new = lambda *shape: torch.zeros(shape, dtype=engine.dtype, device=engine.device)  # noqa: E731
        self.observation, self.action = new(n_steps, count, width), new(n_steps, count, thrusters)
        self.log_prob, self.value, self.reward = (new(n_steps, count) for _ in range(3))
        self.ended, self.truncated = new(n_steps, count), new(n_steps, count)
        self.slots = slots(self)
        self.cut = new(count, width)
        """Last observation of an episode that time cut off. An episode is no shorter than a rollout,
        so there is one a rollout at most."""
        self.terms = new(len(engine.term_names))
        """Mean over the environments of each reward term, summed over the steps."""
        self.reached = new()
        """Number of episodes cut off by time within the task's tolerances."""
        self._act, self._remember = fused(act, engine.device), fused(remember_and_count, engine.device)
        self._show, self._advantage = fused(shown, engine.device), fused(gae, engine.device)

    @torch.no_grad()
    def collect(self, engine: Engine, policy: ActorCriticPolicy) -> None:
        """Let the policy's random actions fly every environment for T steps."""
        observation = engine.observe()
        totals = self.terms.zero_(), self.reached.zero_()
        for uniform, slot in zip(engine.processes.uniform_like(self.action), self.slots, strict=True):
            acted = self._act(policy, observation, uniform)
            step = engine.step(acted[0])
            self._remember(observation, acted, step, slot, self.cut, *totals)
            observation = step.observation

    @torch.no_grad()
    def batch(self, engine: Engine, policy: ActorCriticPolicy, gamma: float, gae_lambda: float,
              reward_scale: float) -> Batch:
        """Advantages of everything collected, each field (T, N, ...).

        An episode cut off by time goes on in principle, so its last reward is followed by the value
        of the state it was cut off in; a failed one ends there.
        """
        count, shape = engine.num_envs, self.reward.shape
        beyond = evaluate(policy, torch.cat((engine.observe(), self.cut))).value
        reward = self.reward * reward_scale + gamma * self.truncated * beyond[count:]
        advantage = self._advantage(reward, self.value, self.ended, beyond[:count], gamma, gae_lambda)
        seen, action = (x.unflatten(0, shape) for x in self._show(
            policy, self.observation.flatten(0, 1), self.action.flatten(0, 1)))
        return Batch(seen, action, self.log_prob, advantage, advantage + self.value)


def act(policy: ActorCriticPolicy, observation: Tensor, uniform: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """A random action (N, thrusters), its log-probability (N,) and the state's value (N,).

    Args:
        policy: decides the probabilities.
        observation: (N, width).
        uniform: random numbers (N, thrusters) in [0, 1).
    """
    output = evaluate(policy, observation)
    action = output.opened(uniform)
    return action, output.log_prob(action), output.value


def remember_and_count(observation: Tensor, acted: tuple[Tensor, Tensor, Tensor], step: Step, slot: Slot,
                       cut: Tensor, terms: Tensor, reached: Tensor) -> None:
    """As `remember`; ``terms`` and ``reached`` are those of `Rollout`, changed in place."""
    remember(observation, acted, step, slot, cut)
    terms += step.terms.mean(dim=1)
    reached += (step.truncated & step.reached).sum()


def remember(observation: Tensor, acted: tuple[Tensor, Tensor, Tensor], step: Step, slot: Slot,
             cut: Tensor) -> None:
    """Write one step of all environments into the rollout's memory.

    Args:
        observation: (N, width) acted on.
        acted: what `act` said.
        step: what followed.
        slot: where to keep them.
        cut: that of `Rollout`, changed in place.
    """
    ended = step.truncated | step.terminated
    for place, value in zip(slot, (observation, *acted, step.reward, ended, step.truncated), strict=True):
        place.copy_(value)
    cut.copy_(torch.where(step.truncated[:, None], step.final_observation, cut))


def shown(policy: ActorCriticPolicy, observation: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """Observations (N, width) and actions (N, thrusters) from the sides the policy sees them from.

    That costs a fifth of an update in space, and is the same in every epoch.
    """
    seen, place = look(policy, observation)
    return seen, in_view(action, place)


def in_view(action: Tensor, place: Tensor | None) -> Tensor:
    """Actions (N, thrusters) with every thruster where it is in the view, see `NormalisedMlp.seen`."""
    return action if place is None else torch.empty_like(action).scatter(1, place, action)


def gae(reward: Tensor, value: Tensor, ended: Tensor, last_value: Tensor, gamma: float,
        gae_lambda: float) -> Tensor:
    """Generalised advantage estimates (Schulman et al., 2016).

    Args:
        reward: (T, N).
        value: (T, N) of the states acted in.
        ended: (T, N), 1 where the episode ended with this step.
        last_value: (N,) of the states after the last step.
        gamma: discount.
        gae_lambda: trade-off of bias against variance.

    Returns:
        (T, N).
    """
    going_on = 1.0 - ended
    following = torch.cat((value[1:], last_value[None]))
    delta = reward + gamma * going_on * following - value
    decay = (gamma * gae_lambda) * going_on
    result, running = torch.empty_like(delta), torch.zeros_like(last_value)
    for t in reversed(range(len(delta))):
        running = delta[t] + decay[t] * running
        result[t] = running
    return result


def minibatches(batch: Batch, count: int) -> list[Batch]:
    """Cut (T, N, ...) into ``count`` flat minibatches of whole environments.

    Environments are independent, so nothing is gained by shuffling them.
    """
    cuts = [torch.chunk(field, count, dim=1) for field in batch]
    return [Batch(*(field.flatten(0, 1) for field in cut)) for cut in zip(*cuts, strict=True)]
