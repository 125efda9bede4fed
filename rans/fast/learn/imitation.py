"""Learning from an expert: what it commands in the states that the agent itself comes to.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011 (DAgger). In every iteration the agent flies the beginning of each episode, for a
number of control periods that is drawn, and the expert flies on from there. The expert's commands join those of all
iterations before, and the agent is made to find them as likely as it can.

An expert that solves a program for every plan solves about one an episode, because it flies its own plan from
where the agent has left it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.effectors.commands import bounds
from rans.errors import ConfigError
from rans.fast.engine import Engine
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import Coefficients, ImitationSettings, PPOSettings
from rans.fast.learn.rollout import Acted, Rollout, remember
from rans.flight import Controller
from rans.model.fields import map_leaves
from rans.policy.network import Network

_LEAST_LOG_STD = -6.0
"""Of commands, as fractions of their ranges: likelihood has no bound where an expert's commands are met exactly."""
_BEYOND = 1e-9
"""Commands this close to their least are exactly it, so that a gate is shut where an expert's solver rounds."""


class ImitationLearner:
    """One training on an expert's commands; a `rans.fast.learn.learner.Learner`.

    Per iteration every environment begins a new episode, flies it by the agent's random actions for 0 to
    ``roll_in`` of an episode, then for ``n_steps`` control periods by the expert. Then the loss

        mean over all labels so far of (-log p(expert's command) + vf_coef (V - return)^2)

    is descended ``updates`` times, on ``batch_size`` labels drawn anew each time. The value is that of the expert's
    flights, for a training by PPO that begins from the agent.

    Args:
        engine: on a CPU, where experts compute.
        network: the agent; changed in place.
        settings: of one member; ``n_steps`` is how long the expert flies.
        generators: of one member.
        own: what only this learner has.
        expert: who is imitated.

    Raises:
        ConfigError: several members, a GPU, or a network with a memory.
    """

    statistics = ("loss", "value_loss", "labels", "std", "grad_norm")

    def __init__(
        self,
        engine: Engine,
        network: Network,
        settings: Sequence[PPOSettings],
        generators: Sequence[torch.Generator],
        own: ImitationSettings,
        expert: Controller,
    ) -> None:
        _check(engine, network, len(settings))
        self.engine = engine
        self.network = network
        self.n_steps = settings[0].n_steps
        self.rollout = Rollout(engine, network, self.n_steps)
        self.coefficients = Coefficients.of(settings, self.rollout.failed)
        self.adam = Adam(network, self.coefficients.learning_rate, plain=True)
        self._own = own
        self._expert = expert
        self._batch_size = settings[0].batch_size
        (self._generator,) = generators
        self._low, high = (torch.as_tensor(x, dtype=engine.dtype) for x in bounds(engine.craft))
        self._range = high - self._low
        self._observations = torch.zeros(0, engine.observation_width, dtype=engine.dtype)
        self._outputs = torch.zeros(0, len(engine.craft.commands), dtype=engine.dtype)
        self._returns = torch.zeros(0, dtype=engine.dtype)

    @property
    def description(self) -> str:
        """Who is imitated."""
        return f"imitation of {self._expert.name}"

    def slow_down(self, remaining: float) -> None:
        """Lower the step size towards zero where less than ``anneal`` of all steps remains."""
        coefficients = self.coefficients
        share = (remaining / coefficients.anneal.clamp(min=1e-9)).clamp(max=1.0)
        self.adam.rate.copy_(coefficients.learning_rate * share)

    def learn(self) -> Tensor:
        """One iteration, see `rans.fast.learn.learner.Learner.learn`."""
        self.engine.reset()
        if len(self._outputs):
            self._roll_in()
        self._label()
        result = self._fit()
        rest = torch.cat((self.adam.rate[:, None], self.rollout.totals()), dim=1)
        return torch.cat((result[None], rest), dim=1)

    # Fly: first the agent, then the expert.

    @torch.no_grad()
    def _roll_in(self) -> None:
        """The agent's random actions, in every environment for as many periods as are drawn for it."""
        engine = self.engine
        longest = round(self._own.roll_in * engine.timing.episode_steps)
        periods = torch.randint(0, longest + 1, (engine.num_envs,), generator=self._generator)
        shape = self.rollout.all.action.shape[1:]
        for period in range(int(periods.max())):
            policy = self.network.forward(engine.observe())[0].policy
            uniform = torch.rand(shape, generator=self._generator, dtype=engine.dtype)
            command = policy.command(policy.sample(uniform))
            with engine.holding(periods <= period):
                engine.step(engine.commands(command))

    @torch.no_grad()
    def _label(self) -> None:
        """The expert's flights, whose commands and returns join those that are known."""
        engine = self.engine
        rollout = self.rollout
        rollout.begin()
        self._expert.reset(engine.num_envs)
        observation = engine.observe()
        for slot in rollout.steps:
            state, goal = (map_leaves(_numbers, x) for x in (engine.state, engine.goal))
            commands = np.asarray(self._expert.act(state, goal, observation.numpy()))
            outputs = self._outputs_of(commands)
            policy = self.network.forward(observation)[0]
            acted = Acted(outputs, policy.policy.log_prob(outputs), policy.value, outputs, None)
            step = engine.step(engine.commands(outputs))
            remember(observation, acted, None, step, slot, rollout)
            observation = step.observation
        kept = rollout.all
        self.network.update_statistics(
            self.network.in_body(kept.observation.flatten(0, 1)).unflatten(0, kept.reward.shape)
        )
        self._observations = torch.cat((self._observations, kept.observation.flatten(0, 1)))
        self._outputs = torch.cat((self._outputs, kept.action.flatten(0, 1)))
        self._returns = torch.cat((self._returns, self._discounted().flatten()))

    def _outputs_of(self, commands: np.ndarray) -> Tensor:
        """The network's outputs (N, n), 0 to 1, whose commands these are (`rans.effectors.commands`)."""
        coefficients = torch.as_tensor(commands, dtype=self.engine.dtype)
        outputs = ((coefficients - self._low) / self._range).clamp(0.0, 1.0)
        return torch.where(outputs < _BEYOND, 0.0, outputs)

    def _discounted(self) -> Tensor:
        """Scaled returns (T, N) of the rollout, with the network's value of the last state after it."""
        kept = self.rollout.all
        gamma = self.coefficients.gamma
        following = self.network.evaluate(self.engine.observe()).value
        returns = torch.empty_like(kept.reward)
        for t in reversed(range(len(returns))):
            reward = kept.reward[t] * self.coefficients.reward_scale
            following = reward + gamma * (1.0 - kept.ended[t]) * following
            returns[t] = following
        return returns

    # Learn: the expert's commands should be the likeliest.

    def _fit(self) -> Tensor:
        """Means over the updates: `statistics`, (5,)."""
        network = self.network
        results = []
        for _ in range(self._own.updates):
            chosen = torch.randint(
                0, len(self._outputs), (self._batch_size,), generator=self._generator
            )
            output = network.forward(self._observations[chosen])[0]
            surprise = -output.policy.log_prob(self._outputs[chosen]).mean()
            error = (output.value - self._returns[chosen]).square().mean()
            loss = surprise + self.coefficients.vf_coef * error
            norm = self.adam.descend(
                loss.sum(), self.coefficients.max_grad_norm, self.engine.processes
            )
            with torch.no_grad():
                network.tensors["log_std"].clamp_(min=_LEAST_LOG_STD)
            results.append(torch.stack((surprise.detach(), error.detach(), norm[0])))
        surprise, error, norm = torch.stack(results).mean(dim=0)
        spread = network.tensors["log_std"].detach().exp().mean()
        labels = surprise.new_tensor(float(len(self._outputs)))
        return torch.stack((surprise, error, labels, spread, norm))

    def state(self) -> dict[str, Any]:
        """See `rans.fast.learn.learner.Learner`."""
        return {
            "weights": {name: x.detach() for name, x in self.network.tensors.items()},
            "adam": self.adam.state(),
            "generators": [self._generator.get_state()],
            "observations": self._observations,
            "outputs": self._outputs,
            "returns": self._returns,
        }

    @torch.no_grad()
    def load(self, saved: dict[str, Any]) -> None:
        """See `rans.fast.learn.learner.Learner`."""
        for name, tensor in self.network.tensors.items():
            tensor.copy_(saved["weights"][name])
        self.adam.load(saved["adam"])
        self._generator.set_state(saved["generators"][0].cpu())
        self._observations = saved["observations"]
        self._outputs = saved["outputs"]
        self._returns = saved["returns"]


def _numbers(x: Any) -> np.ndarray:
    """A field as controllers take it."""
    return np.array(x, dtype=np.float64)


def _check(engine: Engine, network: Network, members: int) -> None:
    """Refuse (`ConfigError`) what experts cannot be imitated with."""
    if members > 1:
        raise ConfigError(
            "the algorithm 'imitation' trains one agent at a time: train other seeds one after the other."
        )
    if engine.device.type != "cpu":
        raise ConfigError(
            "the algorithm 'imitation' learns on a CPU, where experts compute: train with --device cpu."
        )
    if network.architecture.memory:
        raise ConfigError("the algorithm 'imitation' knows no memory: set ppo.memory to 'none'.")
    if "log_std" not in network.tensors:
        raise ConfigError(
            f"the algorithm 'imitation' is for commands that are continuous, and those of {engine.craft.name} are "
            "on or off."
        )
