"""Proximal policy optimisation (Schulman et al., 2017).

On a GPU an iteration is two CUDA graphs without synchronisation. `tests/fast/learn/test_ppo.py` holds it against
SB3; another order of random numbers is another training.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from rans.base.errors import RansWarning
from rans.base.files import first_line
from rans.fast.engine import Engine
from rans.fast.learn.adam import Adam
from rans.fast.learn.algorithms import Algorithm
from rans.fast.learn.batch import Batch, Losses, LossInputs
from rans.fast.learn.config import PPOSettings, ScheduleSettings, TrainConfig
from rans.fast.learn.graph import fused, graphed
from rans.fast.learn.rollout import Acted, Rollout, gae, minibatches, remember
from rans.fast.machine_code import GradientBackend, machine_code
from rans.model.fields import absolute, exp, where, within
from rans.model.spacecraft import Spacecraft
from rans.model.trace import UNTRACEABLE
from rans.policy.network import Network

_SAME = 1e-3
"""Part of a gradient by which machine code may differ from autograd: another order of sums is 1e-6 of it."""
MIN_LEARNING_RATE = 1e-5
"""Lower bound of the adapted step size, except while it is annealed."""


STATISTICS = (*Losses._fields, "grad_norm")
"""Means over the minibatches of an update, by their names in the log."""


class PPOLearner:
    """Learner by PPO; a `rans.fast.learn.learner.Learner`.

    Args:
        engine: engine.
        network: network, changed in place.
        settings: hyper-parameters.
        generator: random generator of actions on a CPU; a GPU uses a stream of its own.
        plain: whether to use single operations of torch and autograd only, without compilation and CUDA graphs.
    """

    statistics = STATISTICS

    def __init__(
        self,
        engine: Engine,
        network: Network,
        settings: PPOSettings,
        generator: torch.Generator,
        plain: bool = False,
    ) -> None:
        device = engine.device
        self.engine = engine
        self.processes = engine.processes
        self.network = network
        self.settings = settings
        self._generator = generator
        self.n_steps = settings.n_steps
        self._minibatches = settings.n_envs * settings.n_steps // settings.batch_size
        self.rollout = Rollout(engine, network, settings.n_steps)
        self.adam = Adam(network, settings.learning_rate)
        self._samples = None if plain else settings.batch_size // self.processes.size
        if device.type == "cuda":
            _ = self.backend  # before its graphs are recorded
        # At a constant address, because a CUDA graph reads it.
        self._ceiling = self.adam.rate.new_tensor(settings.schedule.max_learning_rate)
        self._losses = fused(losses, device, plain)
        self.collect = graphed(self._collect, device, plain)
        self.update = graphed(self._update, device, plain)

    @cached_property
    def backend(self) -> GradientBackend | None:
        """What computes the gradients, made at the first iteration: an imitation needs none; None: autograd."""
        code = machine_code(self.engine.device.type)
        if code is None or self._samples is None:
            return None
        why = "machine code finds other gradients than autograd: its network or head has changed"
        try:
            backend = code.gradient(self.network, self.adam, self.loss, self._samples)
            # On a GPU products are rounded, and tests alone compare them.
            if backend is None or self.engine.device.type == "cuda" or self._agrees(backend):
                return backend
        except UNTRACEABLE as error:
            why = f"it is not arithmetic on fields, from which machine code is made: {first_line(error)}"
        text = f"the loss of PPO is left to autograd, which takes longer: {why}"
        warnings.warn(text, RansWarning, stacklevel=2)
        return None

    @torch.enable_grad()
    def _agrees(self, backend: GradientBackend) -> bool:
        """Whether losses and gradients of an invented minibatch are autograd's; `Adam.gradient` is changed."""
        network = self.network
        generator = torch.Generator().manual_seed(0)
        seen = self.adam.row.new_zeros((self._samples or 0, self.engine.observation_width))
        noise = torch.randn((3, len(seen)), generator=generator).to(seen)
        seen.normal_(generator=generator)
        memory = network.initial_state(len(seen))
        uniform = torch.rand((len(seen), network.architecture.thrusters), generator=generator)
        with torch.no_grad():
            acted = act(network, seen, memory, None, uniform.to(seen))
        found = []
        for way in (None, backend):
            columns, inputs, action = preprocessed(network, seen, memory, acted.action, way, None)
            log_prob = acted.log_prob + 0.3 * noise[0]
            part = Batch(columns, action, log_prob, noise[1], noise[2], inputs, None)
            means = losses(network, part, self.loss) if way is None else way(part)
            row = self.adam.gradient
            if way is None:
                learnt = [network.tensors[name] for name in network.learnt]
                row = self.adam.joined([*torch.autograd.grad(means[0], learnt)])
            found.append(torch.cat((torch.stack(means).detach(), row)))
        exact, other = found
        return bool((other - exact).norm() <= _SAME * exact.norm())

    @property
    def description(self) -> str:
        """Description of the gradient computation so far for the log; empty for autograd, and before any."""
        backend = vars(self).get("backend")
        return f"gradients in {backend.description}" if backend else ""

    def learn(self) -> Tensor:
        """Run one iteration: collect, then update; see `rans.fast.learn.learner.Learner.learn`."""
        self.collect()
        return self.update()

    def slow_down(self, remaining: float) -> None:
        """Reduce the bound of the step sizes towards zero while less than ``anneal`` of all steps remains."""
        schedule = self.settings.schedule
        self._ceiling.fill_(schedule.max_learning_rate * schedule.left(remaining))

    def state(self) -> dict[str, Any]:
        """State of the learner without the episodes of the engine; all processes must call it.

        `load` reads these keys, and so do checkpoints of older runs. What else a training's course depends on must
        be here.
        """
        weights = self.network.tensors.items()
        memory = self.rollout.memory
        return {
            "weights": {name: x.detach() for name, x in weights},
            "adam": self.adam.state(),
            "generators": [self._generator.get_state()],
            "memory": None if memory is None else self.processes.whole(memory),
        }

    @torch.no_grad()
    def load(self, saved: dict[str, Any]) -> None:
        """Continue from the result of `state`; weights are copied in place, since graphs hold their addresses."""
        for name, tensor in self.network.tensors.items():
            tensor.copy_(saved["weights"][name])
        self.adam.load(saved["adam"])
        (random,) = saved["generators"]
        self._generator.set_state(random.cpu())
        if self.rollout.memory is not None:
            self.rollout.memory.copy_(self.processes.mine(saved["memory"]))

    def loss(self, sample: LossInputs) -> Losses:
        """Loss of one transition: clipped surrogate and squared value error, as SB3's without an entropy bonus.

        It is written over fields (`rans.model.fields`): torch computes its gradient, and machine code is made from
        it with its derivatives, so that what changes here is trained everywhere. A learner that derives from this
        one may have another; with functions of torch it is left to autograd, with a warning.
        """
        clip_range = self.settings.clip_range
        # Clipped surrogate objective.
        log_ratio = sample.log_prob - sample.old_log_prob
        ratio = exp(log_ratio)
        gain = sample.advantage * ratio
        clipped = sample.advantage * within(ratio, 1.0 - clip_range, 1.0 + clip_range)
        surrogate = -where(gain <= clipped, gain, clipped)
        # Value, and statistics.
        error = sample.target - sample.value
        value = error * error
        return Losses(
            surrogate + self.settings.vf_coef * value,
            surrogate,
            value,
            -sample.entropy,
            (ratio - 1.0) - log_ratio,
            where(absolute(ratio - 1.0) > clip_range, 1.0, 0.0),
        )

    # Collect: fly every environment for T steps by random actions.

    @torch.no_grad()
    def _collect(self) -> Tensor:
        """Fly a rollout into the buffer, whose memory is replaced; returns the rewards (T, N).

        Random numbers of the whole rollout come at once, before its first step: another order is another training.
        """
        engine = self.engine
        rollout = self.rollout
        rollout.begin()
        observation = engine.observe()
        numbers = rollout.uniform(self._generator)
        with torch.autocast(engine.device.type, enabled=False):  # in which rounded weights are kept
            for uniform, slot in zip(numbers, rollout.steps, strict=True):
                privileged = self._privileged()
                acted = act(self.network, observation, rollout.memory, privileged, uniform)
                step = engine.step(engine.commands(acted.command))
                remember(observation, acted, privileged, step, slot, rollout)
                observation = step.observation
        return rollout.all.reward

    def _privileged(self) -> Tensor | None:
        return self.engine.privileged() if self.network.architecture.privileged else None

    # Advantages.

    @torch.no_grad()
    def batch(self) -> Batch:
        """The rollout with its advantages, each field (T, N, ...).

        The last reward of a truncated episode is followed by the value of its final state (bootstrap); that of a
        terminated episode is not.
        """
        # Values after the last step, and of the last states of truncated episodes, in one pass of the critic.
        steps = self.rollout.all
        rollout = self.rollout
        privileged = self._privileged()
        values = self.network.evaluate(
            torch.cat((self.engine.observe(), rollout.cut)),
            None
            if rollout.memory is None or rollout.cut_memory is None
            else torch.cat((rollout.memory, rollout.cut_memory)),
            None if privileged is None else privileged.repeat(2, 1),
        ).value
        last, beyond = values.chunk(2)
        # Advantages.
        settings = self.settings
        reward = steps.reward * settings.reward_scale + settings.gamma * steps.truncated * beyond
        advantage = gae(reward, steps.value, steps.ended, last, settings.gamma, settings.gae_lambda)
        # Inputs of the network, which are the same in every epoch.
        memory, privileged_columns = (
            None if x is None else x.flatten(0, 1) for x in (steps.memory, steps.privileged)
        )
        columns, memory, action = preprocessed(
            self.network,
            steps.observation.flatten(0, 1),
            memory,
            steps.action.flatten(0, 1),
            self.backend,
            privileged_columns,
        )
        shape = reward.shape
        return Batch(
            columns.unflatten(0, shape),
            action.unflatten(0, shape),
            steps.log_prob,
            advantage,
            advantage + steps.value,
            None if memory is None else memory.unflatten(0, shape),
            steps.privileged if self.backend is None else None,
        )

    def _update(self) -> Tensor:
        """Descend on all minibatches of all epochs and adapt step sizes; returns what `learn` does.

        Minibatches are the same in all epochs, in the same order, and their advantages are standardised once. The
        statistics of observations change only afterwards, so that all of them are seen through one normalisation.
        """
        batch = self.batch()
        parts = minibatches(batch, self._minibatches)
        # Standardise the advantages of every minibatch.
        advantage = torch.cat([part.advantage for part in parts]).view(len(parts), -1)
        standard = self.processes.standardised(advantage).flatten().chunk(len(parts))
        parts = [part._replace(advantage=x) for part, x in zip(parts, standard, strict=True)]
        losses_by_minibatch = torch.stack(
            [self._descend(part) for _ in range(self.settings.n_epochs) for part in parts]
        ).mean(dim=0)
        self.network.update_statistics(batch.columns, self.processes.pooled, self.processes.size)
        means = self.processes.average(torch.cat((losses_by_minibatch, self.rollout.totals())))
        self._adapt(means[STATISTICS.index("approx_kl")])
        first, rest = means.tensor_split([len(STATISTICS)])
        return torch.cat((first, self.adam.rate[None], rest))

    # Gradient step on one minibatch.

    def _descend(self, part: Batch) -> Tensor:
        """Gradient step on a minibatch; returns losses and the norm of the gradient, (statistics,)."""
        result = (
            Losses(*self.backend(part))
            if self.backend is not None
            else self._losses(self.network, part, self.loss)
        )
        norm = self.adam.descend(result.loss, self.settings.max_grad_norm, self.processes)
        return torch.stack((*result, norm)).detach()

    # Adapt step sizes: shorter if the divergence is above the desired one, longer if it is below.

    def _adapt(self, divergence: Tensor) -> None:
        rate = self.adam.rate
        desired = ScheduleSettings.desired_kl
        longer = torch.where(divergence < 0.5 * desired, 1.5, 1.0)
        factor = torch.where(divergence > 2.0 * desired, 1 / 1.5, longer)
        rate.copy_(torch.minimum((rate * factor).clamp(min=MIN_LEARNING_RATE), self._ceiling))


def act(
    network: Network,
    observation: Tensor,
    memory: Tensor | None,
    privileged: Tensor | None,
    uniform: Tensor,
) -> Acted:
    """Random actions of the policy, from uniform random numbers (N, commands) in [0, 1).

    The log-probability is of the action as sampled; the command is what the thrusters get of it, and the memory
    notes that.
    """
    output, columns = network.forward(observation, memory, privileged)
    policy = output.policy
    action = policy.sample(uniform)
    command = policy.command(action)
    return Acted(
        action,
        policy.log_prob(action),
        output.value,
        command,
        network.next_state(columns, memory, command),
    )


def preprocessed(
    network: Network,
    observation: Tensor,
    memory: Tensor | None,
    action: Tensor,
    backend: GradientBackend | None,
    privileged: Tensor | None,
) -> tuple[Tensor, Tensor | None, Tensor]:
    """Observations (N, width), memory and actions (N, commands) under the symmetry of the policy.

    In space this takes a fifth of an update. With a gradient backend the memory is replaced by all inputs.
    """
    columns, recalled, order = network.look(network.in_body(observation), memory)
    recalled = recalled if backend is None else backend.inputs(columns, recalled, privileged)
    return (
        columns,
        recalled,
        action if order is None else torch.empty_like(action).scatter(1, order, action),
    )


def losses(network: Network, batch: Batch, loss: Callable[[LossInputs], Losses]) -> Losses:
    """Means of the losses of a minibatch, () each; `PPOLearner.backend` has their gradients too."""
    output = network.evaluate_seen(batch.columns, batch.memory, batch.privileged)
    policy = output.policy
    chosen = policy.log_prob(batch.action), policy.entropy(), output.value
    each = loss(LossInputs(*chosen, batch.log_prob, batch.advantage, batch.target))
    return Losses(*(x.mean() for x in each))


class PPOAlgorithm(Algorithm):
    """Proximal policy optimization."""

    @classmethod
    def making(cls, config: TrainConfig, craft: Spacecraft, own: Any) -> type[PPOLearner]:
        """See `Algorithm`."""
        return PPOLearner
