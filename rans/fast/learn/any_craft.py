"""Begin a training by imitation of an agent for any craft, which flies the training's craft already.

The commands of the agent for any craft come from control allocation, which has no gradient. A network of this
craft alone therefore first learns to give the same commands in states that it reaches itself, and values of them,
and goes on from there by reinforcement learning.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.agent_files.agent import read_policy
from rans.fast.engine import Engine
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.graph import as_written
from rans.fast.learn.run_folder import RunFolder
from rans.policy.any_craft import for_craft, is_for_any_craft
from rans.policy.architecture import Architecture
from rans.policy.frugality import Frugality
from rans.policy.network import Network
from rans.pretrained import agent_path

_ROUNDS = 12
"""Rounds of flying and learning; in the first the agent for any craft flies alone, in the last hardly."""
_OWN_ROUNDS = 4
"""Rounds after them in which the network flies alone. Values are learnt from its own flights of so many last
rounds: actor and critic share layers, so that a critic that is wrong where PPO begins spoils the commands, too."""
_PERIODS = 64
"""Control periods of a round."""
_UPDATES = {2: 80, 3: 400}
"""Gradient steps after a round, on labels of all rounds, by dimension. After 80 in space
half the commands of 16 thrusters are met exactly, and PPO then loses the attitude within a million steps."""
_BATCH = 4096
"""Labels of a gradient step."""
_SHORT_ROUNDS = 8
_SHORT_UPDATES = 120
_SHORT_BATCH = 512
_SHORT_RATE = 6e-3
_SHORT_SECONDS = 6.4
"""Rounds, gradient steps after a round, labels and first step size of a gradient step, and length of a round, s, of
an imitation that may be all of a training. It takes a fifth of the time of the longer one. At a step size of 2e-3
and with 1,024 labels it needs 28 rounds instead of 12; with rounds of 3.2 s, which are shorter than a flight, a
craft that is commanded every 0.1 s was not imitated in 32 rounds."""
_JUDGED = 4
"""Rounds in which the network flies alone until it is judged, which takes as long as three rounds."""
_MOST_ROUNDS = 32
"""Largest number of rounds of such an imitation, which ends as soon as the task is solved."""
_RATE = 2e-3
"""Step size of the first round, which falls to a tenth in the last of those that the expert flies, too."""
_CERTAINTY = {2: 0.94, 3: 0.985}
"""Probability of a copied on/off command, by dimension: the agent must go on exploring afterwards. Of 16 thrusters
in space a training that begins with 0.94 needs 8 % more impulse."""
_VALUE = 0.5
"""Weight of the squared error of the values, in units of their variance."""


def teacher(agent: str, engine: Engine, architecture: Architecture) -> Network | None:
    """The network of an agent for any craft, for the engine's craft; None: the agent is one of a single craft.

    Args:
        agent: run folder, or pretrained:NAME; #VALUE at its end makes it save thrust (`rans.policy.frugality`).
        engine: of the training.
        architecture: of the network that is to imitate it.

    Raises:
        ConfigError: it cannot fly the craft, or the network cannot imitate it.
    """
    path, _, value = agent.partition("#")
    file = RunFolder(agent_path(path)).agent_file
    if not file.exists():
        return None
    network = read_policy(file).network
    if not is_for_any_craft(network.architecture):
        if value:
            raise ConfigError(
                f"begin_from is {agent!r}: only agents for any craft have a frugality after #."
            )
        return None
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
    tensors = {name: x.to(engine.device, engine.dtype) for name, x in own.tensors.items()}
    # A network that imitates the coasting near the goal needs 9 % more impulse after the training: where it begins
    # is a step of the commands.
    frugal = own.architecture.frugal
    # Numbers at flight time and the agent's own weights, also where it has weights of the value: a training of the
    # floating platform that imitated those of 0.4 was not solved by imitation, and ended at 6.8 s and 39 N s.
    if value:
        low, high = engine.task.for_evaluation().spawn_distance  # type: ignore[attr-defined]  # it flies to a pose
        distance, dimension = 0.5 * (low + high), engine.craft.dimension
        frugal = tuple(Frugality.of_value(_number(value, agent), distance, dimension))
    return Network(replace(own.architecture, coast=0.0, frugal=frugal), tensors)


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
    is_enough: Callable[[], bool] | None = None,
) -> int:
    """Bring every member of a network to the commands of an expert, and reset the engine.

    Returns the number of control periods that each environment flew.

    Args:
        engine: in which they fly, the environments of a member side by side.
        network: changed in place.
        adam: of the network; afterwards it is as it was before.
        expert: network of `teacher`.
        settings: of the training that follows: discount and scale of its rewards.
        is_enough: whether the network flies well enough: if this may be all of the training, its last rounds go on
            until then; None: reinforcement learning goes on in any case.
    """
    dimension = engine.craft.dimension
    certainty = _CERTAINTY[dimension]
    generator = torch.Generator(engine.device).manual_seed(engine.num_envs)
    # The spread of continuous commands is that of what is left of their errors.
    before = {name: x.clone() for name, x in adam.state().items()}
    unclipped = torch.full_like(adam.rate, torch.inf)
    rounds: list[_Labels] = []
    mixed, updates, batch, periods = _ROUNDS, _UPDATES[dimension], _BATCH, _PERIODS
    rate, last = _RATE, mixed + _OWN_ROUNDS
    if is_enough is not None:
        mixed, updates, batch = _SHORT_ROUNDS, _SHORT_UPDATES, _SHORT_BATCH
        rate, last = _SHORT_RATE, _MOST_ROUNDS
        periods = max(1, round(_SHORT_SECONDS / engine.timing.control_period))
    for number in range(last):
        share = min(1.0, number / mixed)
        rounds.append(_flown(engine, network, expert, share, settings, generator, periods))
        labels = _Labels(*(torch.cat(parts) for parts in zip(*rounds, strict=True)))
        # Values are those of the network's own commands, which change from round to round.
        own = labels.own.clone()
        own[: -_OWN_ROUNDS * len(rounds[0].own)] = 0.0
        spread = labels.returns[own > 0.0].std().clamp(min=1e-6) if own.any() else own.new_ones(())
        adam.rate.fill_(rate * (1.0 - 0.9 * share))
        for _ in range(updates):
            # The same rows of every member.
            rows = torch.randint(
                len(own),
                (batch // network.members,),
                generator=generator,
                device=engine.device,
            )
            columns, actions, returns, owned = (
                x[rows].transpose(0, 1).flatten(0, 1) for x in (*labels[:3], own)
            )
            output = network.evaluate_seen(columns)
            policy = output.policy
            likelihood = policy.log_prob(actions)
            if network.architecture.last.weights == 2:
                likelihood = certainty * likelihood + (1.0 - certainty) * policy.log_prob(
                    1.0 - actions
                )
            error = owned * ((output.value - returns) / spread).square()
            loss = network.members * (_VALUE * error - likelihood).mean()
            with as_written():
                adam.descend(loss, unclipped, engine.processes)
        alone = number + 1 - mixed
        if is_enough is not None and alone > 0 and alone % _JUDGED == 0 and is_enough():
            break
    adam.load(before)
    engine.reset()
    return len(rounds) * periods


class _Labels(NamedTuple):
    """What is learnt from flights, (rows, members, ...)."""

    columns: Tensor
    actions: Tensor
    """Commands of the expert in the same states."""
    returns: Tensor
    """Discounted rewards."""
    own: Tensor
    """1 where the network flew, 0 where the expert did."""


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

    The agent flies the first ``share`` of every member's environments, by random actions, the expert the others.
    """
    members = network.members
    each = engine.num_envs // members
    own = (torch.arange(each, device=engine.device) < share * each).repeat(members)[:, None]
    seen, actions, rewards, going_on = [], [], [], []
    observation = engine.observe()
    for _ in range(periods):
        label, _ = expert.deterministic_action(observation, None)
        columns, _, order = network.look(network.in_body(observation))
        policy = network.evaluate_seen(columns).policy
        network.update_statistics(columns[None])
        # Thrusters of columns are numbered as the craft is looked at.
        placed = policy if order is None else policy.placed(order)
        uniform = torch.rand(
            label.shape, generator=generator, device=engine.device, dtype=label.dtype
        )
        command = torch.where(own, placed.command(placed.sample(uniform)), label)
        seen.append(columns)
        actions.append(label if order is None else torch.empty_like(label).scatter(1, order, label))
        step = engine.step(engine.commands(command))
        rewards.append(step.reward * settings.reward_scale)
        going_on.append(1.0 - (step.truncated | step.terminated).to(label.dtype))
        observation = step.observation
    # Discounted rewards, and after the round the present estimate of those beyond it.
    value = network.evaluate(observation).value
    returns = []
    for reward, goes_on in zip(reversed(rewards), reversed(going_on), strict=True):
        value = reward + settings.gamma * goes_on * value
        returns.append(value)
    flown = own[:, 0].to(value.dtype).expand(len(returns), -1)
    parts = torch.stack(seen), torch.stack(actions), torch.stack(returns[::-1]), flown
    # (T, members, each, ...) to (rows, members, ...).
    return _Labels(*(x.unflatten(1, (members, each)).transpose(1, 2).flatten(0, 1) for x in parts))
