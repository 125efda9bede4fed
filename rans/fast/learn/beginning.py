"""Creation of a learner, and the statistics of its iterations by name."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import get_args

import torch

from rans.base.errors import ConfigError, NonFiniteState
from rans.effectors.commands import allowed, is_identity
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings, Precision
from rans.fast.learn.learner import Learner, Made, Making
from rans.fast.learn.ppo import PPOLearner
from rans.fast.machine_code import compiled_preprocessor
from rans.policy.adaptation import ESTIMATORS
from rans.policy.architecture import Architecture
from rans.policy.backbone_registry import backbone
from rans.policy.network import Network
from rans.policy.preprocess import TorchPreprocessor
from rans.policy.symmetry import symmetries


def architecture_of(engine: Engine, settings: PPOSettings) -> Architecture:
    """Network architecture of settings for an engine's task and craft.

    Agent files have it as a table, and a checkpoint must have the same one to be resumed.
    """
    craft = engine.craft
    memory = settings.memory
    period = engine.timing.control_period
    bank = None
    if settings.filters.drift:
        if not is_identity(craft):
            raise ConfigError(
                f"filters follow thrusters whose commands are from 0 to 1, and {craft.name!r} takes "
                f"{allowed(craft)}: train without filters, with memory.history=8."
            )
        bank = ESTIMATORS["filters"].of(craft, engine.task, engine.layout, period, settings)
    tokens = backbone(settings.backbone).tokens(craft, period)
    return Architecture(
        layout=engine.layout,
        thrusters=craft.command_count,
        layers=tuple(settings.layers),
        activation=settings.activation,
        zoom=settings.zoom,
        # A backbone that is given the effectors commands in B: no side of the spacecraft has a network's own.
        symmetries=symmetries(craft) if settings.symmetric and not tokens else None,
        bf16=settings.matmul == "bf16",
        head=_head(engine, settings),
        backbone=settings.backbone,
        tokens=tokens,
        history=memory.history,
        commands_only=memory.remembers and bank is not None,
        averages=tuple(memory.averages),
        filters=bank,
        privileged=engine.privileged_quantities.width if settings.privileged_critic else 0,
        nominal=engine.privileged_quantities.nominal if settings.privileged_critic else (),
        bounds=engine.observation_bounds,
    )


def begin(
    engine: Engine,
    settings: PPOSettings,
    seed: int,
    plain: bool | None = None,
    make: Making[Made] = PPOLearner,
) -> Made:
    """Create a learner with initial weights on an engine, and set its episodes to random times.

    Args:
        engine: engine.
        settings: hyper-parameters.
        seed: seed of weights, actions and times.
        plain: whether to use single operations of torch only; None: as the engine.
        make: creates the learner; by default that of PPO.

    Raises:
        ConfigError: the settings do not fit the engine.
    """
    plain = engine.plain if plain is None else plain
    check_sizes(engine, settings)
    architecture = architecture_of(engine, settings)
    set_precision(settings.matmul, engine.device)
    # Weights, and the random numbers that go on from there.
    exploration = settings.exploration
    tensors, generator = architecture.initial(
        seed, exploration.initial_duty, exploration.log_std_init
    )
    preprocessor = TorchPreprocessor if plain else compiled_preprocessor
    network = Network.copied(architecture, tensors, engine.device, engine.dtype, preprocessor)
    # Episodes at random times, so that they do not end all at once.
    engine.stagger(generator)
    if engine.device.type == "cuda":
        torch.cuda.manual_seed(seed)
    return make(engine, network, settings, generator, plain)


def _head(engine: Engine, settings: PPOSettings) -> str:
    """Key of `rans.policy.heads.HEADS`; ConfigError if the spacecraft or the task does not fit it."""
    craft = engine.craft
    head_name = settings.head
    if head_name == "auto":
        return "gaussian" if craft.is_continuous else "on-off"
    odd = [
        command.name
        for command in craft.commands
        if command.kind not in ("throttle", "pulsed") or command.low != 0
    ]
    if odd:
        raise ConfigError(
            f"the head {head_name!r} needs commands that may be 0 or a share up to the largest, and those of "
            f"{craft.name} may not ({odd[0]}): give it throttled or pulsed thrusters without wheels, or "
            "train with the head 'auto'."
        )
    return head_name


def check_sizes(engine: Engine, settings: PPOSettings) -> None:
    """Reject (`ConfigError`) sizes of rollouts and minibatches that do not divide."""
    steps = settings.n_steps
    batch = settings.batch_size
    processes = engine.processes
    if steps > engine.timing.episode_steps:
        raise ConfigError(
            f"n_steps must not exceed the episode's {engine.timing.episode_steps} steps, got "
            f"{steps}: an episode may be truncated at most once in a rollout."
        )
    count = engine.num_envs * processes.size
    if count != settings.n_envs:
        raise ConfigError(
            f"n_envs must be the engine's {count} environments, got {settings.n_envs}."
        )
    samples = settings.n_envs * steps
    if batch % steps or samples % batch:
        raise ConfigError(
            f"batch_size must be a multiple of n_steps = {steps} that divides n_steps x "
            f"environments = {samples}, got {batch}."
        )
    processes.portion("batch_size", batch // steps)


def set_precision(matmul: str, device: torch.device) -> None:
    """Set the `Precision` of float32 matrix products on a GPU for this process; ConfigError if it is unknown."""
    if matmul not in get_args(Precision):
        raise ConfigError(
            f"matmul must be one of {', '.join(get_args(Precision))}, got {matmul!r}."
        )
    if device.type == "cuda":
        torch.set_float32_matmul_precision("highest" if matmul == "float32" else "high")


def statistics(numbers: Sequence[float], learner: Learner, steps: int) -> dict[str, float]:
    """Statistics of an iteration by the names of SB3's log, from the row of `Learner.learn`.

    The length of an episode is the mean over those that ended in this rollout; SB3 uses the last hundred. Its
    return, the sum of its rewards, is this length times the mean reward of a step, as a whole and by term. Where
    no episode ended, neither is known.

    Args:
        numbers: row of `Learner.learn`.
        learner: learner.
        steps: environment steps so far.

    Raises:
        NonFiniteState: a number is NaN or infinite.
    """
    names = learner.engine.term_names
    losses = dict(zip(learner.statistics, numbers, strict=False))
    rate, failed, ended, succeeded, lengths, *rewards = numbers[len(learner.statistics) :]
    if not all(map(isfinite, numbers)):
        odd = [name for name, reward in zip(names, rewards, strict=True) if not isfinite(reward)]
        cause = "the usual cause is a learning rate or a reward that is too large"
        # Weights that are NaN make every term NaN; a mistake in the task only its own.
        if odd and (len(odd) < len(names) or len(names) == 1):
            cause = (
                f"of the task's reward terms {' and '.join(odd)} is not finite, others are: the usual cause is a "
                "root of a negative number, a division by zero or a logarithm in it"
            )
        raise NonFiniteState(
            f"training produced a value that is not finite after {steps} steps "
            f"(losses {losses}); {cause}."
        )
    # Where no episode ended nothing is known of rewards.
    table = {f"train/{name}": value for name, value in losses.items()} | {
        "train/learning_rate": rate
    }
    if not ended:
        return table
    length = lengths / ended
    table |= {
        "rollout/ep_rew_mean": sum(rewards) * length,
        "rollout/ep_len_mean": length,
        "rollout/at_goal_rate": succeeded / ended,
        "rollout/failure_rate": failed / ended,
    }
    return table | {
        f"return/{name}": reward * length for name, reward in zip(names, rewards, strict=True)
    }
