"""Begin a training by imitation of an agent for any craft, which flies the training's craft already.

The commands of the agent for any craft come from control allocation, which has no gradient. A network of this
craft alone therefore first learns to give the same commands in states that it reaches itself, and values of them,
and goes on from there by reinforcement learning.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from rans import Engine, PPOSettings
from rans.extend import Adam, Architecture, ConfigError, Network, Patterns
from rans.fast.learn import graph
from rans_any_craft.allocated import demand
from rans_any_craft.frugality import Frugality, numbers_of
from rans_any_craft.networks import for_craft, frugal

_ROUNDS = 8
"""Rounds of flying and learning in which the agent for any craft flies too: alone in the first, hardly in the
last."""
_UPDATES = 120
_BATCH = 512
_RATE = 6e-3
_SECONDS = 6.4
"""Gradient steps after a round, on labels of all rounds, labels and step size of a gradient step, and length of a
round, s. The step size falls to a tenth in the last round that the expert flies, too. At a step size of 2e-3 and
with 1,024 labels an imitation needs 28 rounds instead of 12; with rounds of 3.2 s, which are shorter than a flight,
a craft that is commanded every 0.1 s was not imitated in 32 rounds."""
_OWN_ROUNDS = 4
"""Values are learnt from the network's own flights of so many last rounds: actor and critic share layers, so that a
critic that is wrong where PPO goes on spoils the commands, too. After as many rounds the network is judged, which
takes as long as three of them."""
_MOST_ROUNDS = 32
"""Largest number of rounds of an imitation, which ends as soon as the task is solved."""
_CERTAINTY = 0.94
"""Probability of a copied on/off command: where the task is not solved, the agent goes on exploring afterwards."""
_DEMAND = 30.0
"""Weight of the errors of a demand, in units of the craft's authority, beside those of the values."""
_VALUE = 0.5
"""Weight of the squared error of the values, in units of their variance."""


_AT_FLIGHT_TIME = 0.4
"""Value whose numbers at flight time networks without allocation imitate: cheaper than 0 and 0.2, as quick."""


def teacher(network: Network, agent: str, engine: Engine, architecture: Architecture) -> Network:
    """The network of an agent for any craft, for the engine's craft.

    Args:
        network: of the agent.
        agent: its text; #VALUE at its end makes it save thrust (`rans_any_craft.frugality`).
        engine: of the training.
        architecture: of the network that is to imitate it.

    Raises:
        ConfigError: it cannot fly the craft, or the network cannot imitate it.
    """
    _, _, value = agent.partition("#")
    named = f"begin_from is {agent!r}, the agent for any craft"
    if architecture.layout != network.architecture.layout:
        raise ConfigError(
            f"{named}, which flies to a pose in its own dimension, and this training observes something else. "
            "Trainings of go-to-pose begin from any-craft-2d in the plane and from any-craft-3d in space; for "
            "others leave out begin_from."
        )
    if architecture.memory or architecture.privileged:
        raise ConfigError(
            f"{named}, whose commands depend on the present state alone, and this network has a memory or a "
            "privileged critic: leave out begin_from, or train without conditions and ppo.memory."
        )
    if engine.processes.size > 1:
        raise ConfigError(
            f"{named}, which is imitated in one process: train in one, or without it."
        )
    own = for_craft(network, engine.craft, engine.timing.control_period)
    # Numbers at flight time and the agent's own weights, also where it has weights of the value: a training of the
    # floating platform that imitated those of 0.4 was not solved by imitation, and ended at 6.8 s and 39 N s.
    # Demands are imitated so well that those of the value are the better ones.
    numbers = own.architecture.frugal
    if value:
        low, high = engine.task.for_evaluation().spawn_distance  # type: ignore[attr-defined]  # it flies to a pose
        number, distance = _number(value, agent), 0.5 * (low + high)
        if architecture.backbone == "allocated":
            seconds = engine.timing.episode_steps * engine.timing.control_period
            own = frugal(own, number, distance, seconds)
            numbers = own.architecture.frugal
            if numbers_of(own.architecture).price != 1.0:
                raise ConfigError(
                    f"{named}, which at {number:g} and in flights of {seconds:g} s opens valves at a higher price "
                    "of thrust than this network, which cannot imitate it: give a value of at most 0.75 after #."
                )
        elif number == _AT_FLIGHT_TIME:
            # Braking earlier, dearer thrust, and longer coasts.
            numbers = tuple(Frugality(0.85, round(distance, 6), 0.0, 2.0, coast=5.0 / 3.0))
        else:
            raise ConfigError(
                f"{named}, which a network of this backbone imitates at {_AT_FLIGHT_TIME:g} or without a number: "
                f"got #{value}. Others take any value: --set ppo.backbone=allocated."
            )
    tensors = {name: x.to(engine.device, engine.dtype) for name, x in own.tensors.items()}
    # A network that imitates the coasting near the goal needs 9 % more impulse after the training: where it begins
    # is a step of the commands.
    return Network(replace(own.architecture, coast=0.0, frugal=numbers), tensors)


def _number(value: str, agent: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ConfigError(
            f"begin_from is {agent!r}: after # stands a number from 0 (fast) to 1 (frugal)."
        ) from None


def imitate(
    engine: Engine,
    network: Network,
    adam: Adam,
    expert: Network,
    settings: PPOSettings,
    is_enough: Callable[[], bool],
    stop: Callable[[], bool] = lambda: False,
    report: Callable[[int, float], None] = lambda steps, loss: None,
) -> int:
    """Bring a network to the commands of an expert, and reset the engine.

    Returns the number of control periods that each environment flew; 0 if it was stopped, which leaves a network
    that is neither untrained nor imitates the expert.

    Args:
        engine: in which they fly.
        network: changed in place.
        adam: of the network; afterwards it is as it was before.
        expert: network of `teacher`.
        settings: of the training that follows: discount and scale of its rewards.
        is_enough: whether the network flies well enough, which ends the imitation.
        stop: whether to stop; called after every gradient step.
        report: called after every round with the control periods that each environment flew and the loss of the
            round's last gradient step.
    """
    generator = torch.Generator(engine.device).manual_seed(engine.num_envs)
    # The spread of continuous commands is that of what is left of their errors.
    before = {name: x.clone() for name, x in adam.state().items()}
    periods = max(1, round(_SECONDS / engine.timing.control_period))
    lessons = _Lessons(engine, network, adam)
    stopped = False
    for number in range(_MOST_ROUNDS):
        share = min(1.0, number / _ROUNDS)
        lessons.add(_flown(engine, network, expert, share, settings, generator, periods))
        adam.rate.fill_(_RATE * (1.0 - 0.9 * share))
        for _ in range(_UPDATES):
            lessons.learn(generator)
            stopped = stop()
            if stopped:
                break
        alone = number + 1 - _ROUNDS
        if stopped:
            break
        report(lessons.rounds * periods, float(lessons.loss))
        if alone > 0 and alone % _OWN_ROUNDS == 0 and is_enough():
            break
    adam.load(before)
    engine.reset()
    return 0 if stopped else lessons.rounds * periods


class _Labels(NamedTuple):
    """What is learnt from flights, (rows, ...)."""

    columns: Tensor
    actions: Tensor
    """Commands of the expert in the same states, or the changes of twist that it demands where the network does."""
    returns: Tensor
    """Discounted rewards."""
    own: Tensor
    """1 where the network flew, 0 where the expert did."""


class _Lessons:
    """Labels of all rounds so far, and gradient steps on them.

    Everything that a gradient step reads has a constant address: on a GPU a CUDA graph replays it, in a tenth of
    the time that its hundred kernels take one by one.

    Args:
        engine: in which they fly.
        network: that learns.
        adam: of the network.
    """

    def __init__(self, engine: Engine, network: Network, adam: Adam) -> None:
        self.rounds = 0
        self._network = network
        self._adam = adam
        self._processes = engine.processes
        self._labels: _Labels | None = None
        self._spread = torch.ones_like(adam.rate)
        self._rows = torch.empty(_BATCH, dtype=torch.int64, device=engine.device)
        self._step = graph.graphed(self._descend, engine.device)
        self.loss = torch.zeros((), device=engine.device)
        """Loss of the last gradient step, a scalar."""

    def add(self, new: _Labels) -> None:
        """Add the labels of a round; values are learnt of the last own rounds alone, as commands change."""
        count = len(new.own)
        if self._labels is None:
            self._labels = _Labels(*(x.new_empty(_MOST_ROUNDS * count, *x.shape[1:]) for x in new))
        begun = self.rounds * count
        for kept, x in zip(self._labels, new, strict=True):
            kept[begun : begun + count] = x
        self.rounds += 1
        self._count = begun + count
        own = self._labels.own[: self._count]
        own[: -_OWN_ROUNDS * count] = 0.0
        seen = self._labels.returns[: self._count][own > 0.0]
        self._spread.copy_(seen.std().clamp(min=1e-6) if len(seen) else torch.ones(()))

    def learn(self, generator: torch.Generator) -> None:
        """One gradient step on labels drawn by a generator."""
        torch.randint(self._count, self._rows.shape, generator=generator, out=self._rows)
        self._step()

    def _descend(self) -> Tensor:
        """Gradient step on the labels whose numbers are in `_rows`; returns the norm of the gradient, ().

        The loss is minus the log-likelihood of the expert's commands, or the distance to the demand of patterns,
        and the squared error of the values of own flights. `loss` gets it, in place.
        """
        assert self._labels is not None
        network = self._network
        columns, actions, returns, owned = (x[self._rows] for x in self._labels)
        output = network.evaluate_seen(columns)
        policy = output.policy
        if isinstance(policy, Patterns):
            # Patterns follow from a demand; which of two is the better one is often a matter of little.
            missed = functional.smooth_l1_loss(policy.demand, actions, reduction="none")
            likelihood = -_DEMAND * missed.sum(dim=1)
        else:
            likelihood = policy.log_prob(actions)
            if network.architecture.last.weights == 2:
                likelihood = _CERTAINTY * likelihood
                likelihood = likelihood + (1.0 - _CERTAINTY) * policy.log_prob(1.0 - actions)
        error = owned * ((output.value - returns) / self._spread).square()
        loss = (_VALUE * error - likelihood).mean()
        self.loss.copy_(loss.detach())
        return self._adam.descend(loss, math.inf, self._processes)


@torch.no_grad()
def _flown(
    engine: Engine,
    network: Network,
    expert: Network,
    share: float,
    settings: PPOSettings,
    generator: torch.Generator,
    periods: int,
) -> _Labels:
    """Labels of a round.

    The agent flies the first ``share`` of the environments, by random actions, the expert the others.
    """
    count = engine.num_envs
    own = (torch.arange(count, device=engine.device) < share * count)[:, None]
    observation = engine.observe()
    uniform = own.new_empty((count, engine.craft.command_count), dtype=engine.dtype)

    def period() -> tuple[Tensor, ...]:
        """Fly one period, ``observation`` in place; columns, actions, scaled rewards, 1 if it goes on, (N, ...)."""
        label, _ = expert.deterministic_action(observation, None)
        columns, _, order = network.look(network.in_body(observation))
        policy = network.evaluate_seen(columns).policy
        network.update_statistics(columns[None])
        # Thrusters of columns are numbered as the craft is looked at.
        placed = policy if order is None else policy.placed(order)
        command = torch.where(own, placed.command(placed.sample(uniform)), label)
        if isinstance(policy, Patterns):
            seen_by_expert, _, _ = expert.look(expert.in_body(observation))
            action = demand(expert, expert.features(seen_by_expert)[0])
        else:
            action = label if order is None else torch.empty_like(label).scatter(1, order, label)
        step = engine.step(engine.commands(command))
        observation.copy_(step.observation)
        going_on = 1.0 - (step.truncated | step.terminated).to(label.dtype)
        return columns, action, step.reward * settings.reward_scale, going_on

    # Replays of a CUDA graph write to the same addresses.
    fly = graph.graphed(period, engine.device)
    flown_periods = []
    for _ in range(periods):
        torch.rand(uniform.shape, generator=generator, out=uniform)
        flown_periods.append([x.clone() for x in fly()])
    seen, actions, rewards, going_on = zip(*flown_periods, strict=True)
    # Discounted rewards, and after the round the present estimate of those beyond it.
    value = network.evaluate(observation).value
    returns = []
    for reward, goes_on in zip(reversed(rewards), reversed(going_on), strict=True):
        value = reward + settings.gamma * goes_on * value
        returns.append(value)
    flown = own[:, 0].to(value.dtype).expand(len(returns), -1)
    parts = torch.stack(seen), torch.stack(actions), torch.stack(returns[::-1]), flown
    return _Labels(*(x.flatten(0, 1) for x in parts))
