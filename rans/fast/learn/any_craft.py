"""Begin a training by imitation of an agent for any craft, which flies the training's craft already.

The commands of the agent for any craft come from control allocation, which has no gradient. A network of this
craft alone therefore first learns to give the same commands in states that it reaches itself, and values of them,
and goes on from there by reinforcement learning.

Source: S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rans.errors import ConfigError
from rans.fast.agent_files.agent import read_policy
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.run_folder import RunFolder
from rans.policy.any_craft import for_craft, is_for_any_craft
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.pretrained import agent_path

_ROUNDS = 12
"""Rounds of flying and learning; in the first the agent for any craft flies alone, in the last hardly."""
_PERIODS = 64
"""Control periods of a round."""
_UPDATES = 80
"""Gradient steps after a round, on labels of all rounds."""
_BATCH = 4096
"""Labels of a gradient step."""
_RATE = 2e-3
"""Step size of the first round, which falls to a tenth in the last."""
_CERTAINTY = 0.94
"""Probability of a copied on/off command: the agent must go on exploring afterwards."""
_VALUE = 0.5
"""Weight of the squared error of the values, in units of their variance."""


def teacher(agent: str, engine: Engine, architecture: Architecture) -> Network | None:
    """The network of an agent for any craft, for the engine's craft; None: the agent is one of a single craft.

    Args:
        agent: run folder, or pretrained:NAME.
        engine: of the training.
        architecture: of the network that is to imitate it.

    Raises:
        ConfigError: it cannot fly the craft, or the network cannot imitate it.
    """
    file = RunFolder(agent_path(agent)).agent_file
    if not file.exists():
        return None
    network = read_policy(file).network
    if not is_for_any_craft(network.architecture):
        return None
    named = f"begin_from is {agent!r}, the agent for any craft"
    if architecture.layout != network.architecture.layout:
        raise ConfigError(
            f"{named}, which flies to a pose in its own dimension, and this training observes something else: "
            "leave out begin_from."
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
    return Network(replace(own.architecture, coast=0.0), tensors)


def imitate(engine: Engine, network: Network, expert: Network, settings: PPOSettings) -> None:
    """Bring every member of a network to the commands of an expert, and reset the engine.

    Args:
        engine: in which they fly, the environments of a member side by side.
        network: changed in place.
        expert: network of `teacher`.
        settings: of the training that follows: discount and scale of its rewards.
    """
    generator = torch.Generator(engine.device).manual_seed(engine.num_envs)
    learnt = [network.tensors[name] for name in network.learnt if name != "log_std"]
    optimizer = torch.optim.Adam(learnt, _RATE)
    labels: list[tuple[Tensor, Tensor, Tensor]] = []
    for number in range(_ROUNDS):
        share = number / _ROUNDS
        labels.append(_flown(engine, network, expert, share, settings, generator))
        columns, actions, returns = (torch.cat(parts) for parts in zip(*labels, strict=True))
        spread = returns.std().clamp(min=1e-6)
        optimizer.param_groups[0]["lr"] = _RATE * (1.0 - 0.9 * share)
        for _ in range(_UPDATES):
            # The same rows of every member.
            rows = torch.randint(
                len(columns),
                (_BATCH // network.members,),
                generator=generator,
                device=engine.device,
            )
            batch = [x[rows].transpose(0, 1).flatten(0, 1) for x in (columns, actions, returns)]
            output = network.evaluate_seen(batch[0])
            policy = output.policy
            likelihood = policy.log_prob(batch[1])
            if network.architecture.last.weights == 2:
                likelihood = _CERTAINTY * likelihood + (1.0 - _CERTAINTY) * policy.log_prob(
                    1.0 - batch[1]
                )
            error = ((output.value - batch[2]) / spread).square()
            optimizer.zero_grad()
            (_VALUE * error - likelihood).mean().backward()
            optimizer.step()
    for x in learnt:
        x.grad = None
    engine.reset()


@torch.no_grad()
def _flown(
    engine: Engine,
    network: Network,
    expert: Network,
    share: float,
    settings: PPOSettings,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor, Tensor]:
    """Columns, the expert's actions and discounted rewards of a round, (rows, members, ...).

    The agent flies the first ``share`` of every member's environments, by random actions, the expert the others.
    """
    members = network.members
    each = engine.num_envs // members
    own = (torch.arange(each, device=engine.device) < share * each).repeat(members)[:, None]
    seen, actions, rewards, going_on = [], [], [], []
    observation = engine.observe()
    for _ in range(_PERIODS):
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
    parts = torch.stack(seen), torch.stack(actions), torch.stack(returns[::-1])
    # (T, members, each, ...) to (rows, members, ...).
    return tuple(  # type: ignore[return-value]
        x.unflatten(1, (members, each)).transpose(1, 2).flatten(0, 1) for x in parts
    )
