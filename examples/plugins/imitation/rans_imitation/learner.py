"""Imitation learning (DAgger): commands of an expert in states that the agent reaches.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011. In every iteration the agent flies the start of each episode for a random number of
control periods, and the expert continues from there. The commands of the expert are added to those of all earlier
iterations, and their likelihood under the policy is maximised.

An expert that solves an optimisation problem for every plan solves about one per episode, because it follows its
own plan from the state that the agent has reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from rans.effectors.commands import command_bounds
from rans.extend import (
    CONTROLLERS,
    Acted,
    Adam,
    Algorithm,
    Coefficients,
    ConfigError,
    Controller,
    Engine,
    Network,
    PPOSettings,
    Rollout,
    TrainConfig,
    map_leaves,
    remember,
    require_bounds,
)

_LEAST_LOG_STD = -6.0
"""Least logarithm of the standard deviation of commands as fractions of their ranges, which bounds the likelihood
of exactly matched commands."""
_BEYOND = 1e-9
"""Outputs below this are set to 0, so that a gate is shut despite rounding of the expert's solver."""


@dataclass(frozen=True)
class ImitationSettings:
    """Hyper-parameters of imitation learning, besides `PPOSettings`.

    Raises:
        ConfigError: a number is out of its range.
    """

    expert: str = "convex"
    """Controller to imitate: a name (docs/comparison.md), or MODULE:NAME of your own."""
    updates: int = 400
    """Gradient steps in an iteration, each on a minibatch of all labels so far."""
    roll_in: float = 0.6
    """Largest share of an episode that the agent flies before the expert continues."""

    def __post_init__(self) -> None:
        require_bounds(self, ">= 1 and < 2^31", lambda x: 1 <= x < 2**31, "updates")
        require_bounds(self, "between 0 and 1", lambda x: 0 <= x <= 1, "roll_in")


class ImitationLearner:
    """Learner of one member by imitation of an expert; a `rans.fast.learn.learner.Learner`.

    In every iteration all environments begin new episodes. They fly by random actions of the agent for 0 to
    ``roll_in`` of an episode, then by the expert for ``n_steps`` control periods. Then ``updates`` gradient steps,
    each on ``batch_size`` labels drawn at random, reduce the loss

        mean over all labels so far of (-log p(expert's command) + vf_coef (V - return)^2)

    The value is that of the expert's flights, for a later training by PPO from this agent.

    Args:
        engine: engine on a CPU, where experts run.
        network: network of the agent, changed in place.
        settings: settings of one member; ``n_steps`` is the duration of the expert's flights.
        generators: random generator of one member.
        own: further hyper-parameters of this learner.
        expert: controller to imitate.

    Raises:
        ConfigError: there are several members, the device is a GPU, or the network has a memory.
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
        self._low, high = (
            torch.as_tensor(x, dtype=engine.dtype) for x in command_bounds(engine.craft)
        )
        self._range = high - self._low
        self._observations = torch.zeros(0, engine.observation_width, dtype=engine.dtype)
        self._outputs = torch.zeros(0, engine.craft.command_count, dtype=engine.dtype)
        self._returns = torch.zeros(0, dtype=engine.dtype)

    @property
    def description(self) -> str:
        """Name of the expert, for the log."""
        return f"imitation of {self._expert.name}"

    def slow_down(self, remaining: float) -> None:
        """Reduce the step size towards zero while less than ``anneal`` of all steps remains."""
        coefficients = self.coefficients
        share = (remaining / coefficients.anneal.clamp(min=1e-9)).clamp(max=1.0)
        self.adam.rate.copy_(coefficients.learning_rate * share)

    def learn(self) -> Tensor:
        """Run one iteration, see `rans.fast.learn.learner.Learner.learn`."""
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
        """Fly by random actions of the agent, in every environment for a random number of periods."""
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
        """Fly by the expert, and add its commands and returns to the labels."""
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
        """Network outputs (N, n), 0 to 1, of these commands (inverse of `rans.effectors.commands.of_outputs`)."""
        coefficients = torch.as_tensor(commands, dtype=self.engine.dtype)
        outputs = ((coefficients - self._low) / self._range).clamp(0.0, 1.0)
        return torch.where(outputs < _BEYOND, 0.0, outputs)

    def _discounted(self) -> Tensor:
        """Scaled discounted returns (T, N) of the rollout, continued with the network's value of the last state."""
        kept = self.rollout.all
        gamma = self.coefficients.gamma
        following = self.network.evaluate(self.engine.observe()).value
        returns = torch.empty_like(kept.reward)
        for t in reversed(range(len(returns))):
            reward = kept.reward[t] * self.coefficients.reward_scale
            following = reward + gamma * (1.0 - kept.ended[t]) * following
            returns[t] = following
        return returns

    # Learn: maximise the likelihood of the expert's commands.

    def _fit(self) -> Tensor:
        """Gradient steps on all labels; returns means of the `statistics`, (5,)."""
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
        """State of the learner without the episodes of the engine."""
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
        """Continue from the result of `state`."""
        for name, tensor in self.network.tensors.items():
            tensor.copy_(saved["weights"][name])
        self.adam.load(saved["adam"])
        self._generator.set_state(saved["generators"][0].cpu())
        self._observations = saved["observations"]
        self._outputs = saved["outputs"]
        self._returns = saved["returns"]


def _numbers(x: Any) -> np.ndarray:
    """NumPy float64 array of a field, for controllers."""
    return np.array(x, dtype=np.float64)


def _check(engine: Engine, network: Network, members: int) -> None:
    """Reject (`ConfigError`) engines and networks that imitation does not support."""
    if members > 1:
        raise ConfigError(
            "the algorithm 'imitation' trains one agent at a time: train other seeds one after the other."
        )
    if engine.device.type != "cpu":
        raise ConfigError(
            "the algorithm 'imitation' learns on a CPU, where experts run: train with --device cpu."
        )
    if network.architecture.memory:
        raise ConfigError(
            "the algorithm 'imitation' does not support memory: set ppo.memory.kind to 'none'."
        )
    if "log_std" not in network.tensors:
        raise ConfigError(
            f"the algorithm 'imitation' is for commands that are continuous, and those of {engine.craft.name} are "
            "on or off."
        )


class Imitation(Algorithm):
    """Learning from the commands of an expert."""

    settings: ClassVar[type] = ImitationSettings
    plain_network: ClassVar[bool] = True

    @classmethod
    def making(cls, config: TrainConfig, craft: Any, own: ImitationSettings) -> Any:
        """Constructor of the learner.

        Raises:
            ConfigError: there is no such expert, or it cannot fly this spacecraft or task.
        """
        maker: Any = CONTROLLERS[own.expert]
        expert = getattr(maker, "as_expert", maker)(craft, config.settings, config.timing)
        return partial(ImitationLearner, own=own, expert=expert)
