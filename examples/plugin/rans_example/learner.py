"""A learner of your own in one file: advantage actor-critic, one gradient step on every rollout.

``python learner.py`` trains an agent with `rans.train`, whose curriculum, evaluation, run folder and checkpoints
serve any learner; ``rans train go-to-pose --set algorithm=learner:A2C`` does the same in the folder of this file.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

import rans
from rans import Engine, PPOSettings
from rans.extend import Acted, Adam, Algorithm, Network, Rollout, TrainConfig, gae, remember


class A2CLearner:
    """Learner of networks without memory; a `rans.fast.learn.learner.Learner`."""

    statistics = ("policy_gradient_loss", "value_loss", "grad_norm")
    description = ""

    def __init__(
        self,
        engine: Engine,
        network: Network,
        settings: PPOSettings,
        generator: torch.Generator,
        plain: bool,
    ) -> None:
        self.engine = engine
        self.network = network
        self.settings = settings
        self.n_steps = settings.n_steps
        self.rollout = Rollout(engine, network, settings.n_steps)
        self.adam = Adam(network, settings.learning_rate)
        self._generator = generator

    def slow_down(self, remaining: float) -> None:
        """Reduce the step size at the end of a training that anneals it."""
        self.adam.rate.fill_(self.settings.learning_rate * self.settings.schedule.left(remaining))

    def learn(self) -> Tensor:
        """Fly every environment for ``n_steps`` control periods, and take one gradient step on them."""
        last = self._fly()
        steps = self.rollout.all
        gamma = self.settings.gamma
        reward = steps.reward * self.settings.reward_scale
        # A truncated episode goes on beyond its end with the value of its last state.
        beyond = self.network.evaluate(self.rollout.cut).value.detach()
        advantage = gae(
            reward + gamma * steps.truncated * beyond,
            steps.value,
            steps.ended,
            last,
            gamma,
            self.settings.gae_lambda,
        )
        output = self.network.evaluate(steps.observation.flatten(0, 1))
        log_prob = output.policy.log_prob(steps.action.flatten(0, 1))
        weight = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        policy_loss = -(weight.flatten() * log_prob).mean()
        value_loss = (output.value - (advantage + steps.value).flatten()).square().mean()
        loss = policy_loss + 0.5 * value_loss
        norm = self.adam.descend(loss, self.settings.max_grad_norm, self.engine.processes)
        with torch.no_grad():
            columns = self.network.in_body(steps.observation.flatten(0, 1))
            self.network.update_statistics(self.network.look(columns)[0][None])
            losses = torch.stack((policy_loss, value_loss, norm, self.adam.rate))
            return torch.cat((losses, self.rollout.totals()))

    @torch.no_grad()
    def _fly(self) -> Tensor:
        """Fill the rollout by random actions; returns the values (N,) of the states after it."""
        rollout = self.rollout
        rollout.begin()
        observation = self.engine.observe()
        for uniform, slot in zip(rollout.uniform(self._generator), rollout.steps, strict=True):
            policy, value = self.network.evaluate(observation)
            action = policy.sample(uniform)
            command = policy.command(action)
            step = self.engine.step(self.engine.commands(command))
            acted = Acted(action, policy.log_prob(action), value, command, None)
            remember(observation, acted, None, step, slot, rollout)
            observation = step.observation
        return self.network.evaluate(observation).value

    def state(self) -> dict[str, Any]:
        """State from which `load` continues."""
        weights = {name: x.detach() for name, x in self.network.tensors.items()}
        generator = self._generator.get_state()
        return {"weights": weights, "adam": self.adam.state(), "generator": generator}

    @torch.no_grad()
    def load(self, saved: dict[str, Any]) -> None:
        """Continue from the result of `state`."""
        for name, tensor in self.network.tensors.items():
            tensor.copy_(saved["weights"][name])
        self.adam.load(saved["adam"])
        self._generator.set_state(saved["generator"].cpu())


class A2C(Algorithm):
    """Advantage actor-critic."""

    @classmethod
    def making(cls, config: TrainConfig, craft: Any, own: Any) -> Any:
        """Constructor of the learner."""
        return A2CLearner


if __name__ == "__main__":
    agent = rans.train(
        "go-to-pose",
        algorithm="learner:A2C",
        n_steps=16,
        total_timesteps=2_000_000,
        output="runs/a2c",
        device="cpu",
        progress=False,
    )
    metrics = agent.evaluate(episodes=256)
    print(", ".join(f"{name} {metrics[name].value:.3g}" for name in ("solved", "impulse")))
