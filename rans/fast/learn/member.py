"""Trainings that learn together: how they begin, and how each went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, get_args, overload

import torch
from torch import Tensor

from rans.compile.preprocess import compiled_preprocessor
from rans.effectors.commands import per_velocity
from rans.errors import ConfigError, NonFiniteState
from rans.fast.engine import Engine
from rans.fast.learn.config import PPOSettings, Precision, TrainConfig
from rans.fast.learn.learner import Learner, Making
from rans.fast.learn.ppo import PPOLearner
from rans.policy.architecture import BACKBONES, Architecture
from rans.policy.backbones import effector_tokens
from rans.policy.filter_bank import Filters
from rans.policy.network import Network
from rans.policy.preprocess import TorchPreprocessor
from rans.policy.symmetry import symmetries
from rans.tasks.derived import example

SOLVED_IN_A_ROW = 2
"""Reports that must find the task solved: one alone may be the luckiest of many."""


def architecture_of(engine: Engine, settings: PPOSettings) -> Architecture:
    """The architecture that these settings ask for, for the task and spacecraft of an engine."""
    craft = engine.craft
    has_history = settings.memory in ("history", "commands")
    return Architecture(
        layout=engine.layout,
        thrusters=len(craft.commands),
        layers=tuple(settings.layers),
        activation=settings.activation,
        zoom=settings.zoom,
        symmetries=symmetries(craft) if settings.symmetric else None,
        bf16=settings.matmul == "bf16",
        head=_head(engine, settings),
        levers=per_velocity(craft, engine.timing.control_period)
        if settings.head == "guided"
        else (),
        preprocessor=settings.preprocessor,
        backbone=settings.backbone,
        tokens=effector_tokens(craft) if BACKBONES[settings.backbone].has_tokens else (),
        history=settings.history if has_history else 0,
        commands_only=settings.memory == "commands",
        averages=tuple(settings.averages) if has_history else (),
        filters=Filters.of(
            craft,
            engine.task,
            engine.timing.control_period,
            settings.filters,
            settings.filtered_steady,
            settings.filtered_response,
            settings.filtered_gate,
        )
        if settings.filters
        else None,
        units=settings.recurrent_units if settings.memory == "recurrent" else 0,
        privileged=engine.privileged_quantities.width if settings.privileged_critic else 0,
        nominal=engine.privileged_quantities.nominal if settings.privileged_critic else (),
        bounds=example(engine.task, craft.dimension).bounds(),
    )


@overload
def begin(
    engine: Engine,
    settings: Sequence[PPOSettings],
    seeds: Sequence[int],
    plain: bool | None = None,
) -> PPOLearner: ...
@overload
def begin(
    engine: Engine,
    settings: Sequence[PPOSettings],
    seeds: Sequence[int],
    plain: bool | None,
    make: Making | None,
) -> Learner: ...
def begin(
    engine: Engine,
    settings: Sequence[PPOSettings],
    seeds: Sequence[int],
    plain: bool | None = None,
    make: Making | None = None,
) -> Learner:
    """Members that have learnt nothing, on an engine whose episodes then began at random times.

    Settings and seeds, of weights, actions and those times, are one a member; ConfigError where they do not
    fit the engine. By default they are plain if the engine is, and learn by PPO.
    """
    plain = engine.plain if plain is None else plain
    for one in settings:
        check_sizes(engine, one, len(settings))
    architecture = architecture_of(engine, settings[0])
    set_precision(settings[0].matmul, engine.device)
    tables, generators = zip(
        *(
            architecture.initial(seed, one.initial_duty, one.log_std_init)
            for seed, one in zip(seeds, settings, strict=True)
        ),
        strict=True,
    )
    preprocessor = TorchPreprocessor if plain else compiled_preprocessor
    network = Network.stacked(architecture, tables, engine.device, engine.dtype, preprocessor)
    engine.stagger(*generators)
    if engine.device.type == "cuda":
        torch.cuda.manual_seed(seeds[0])
    if make is None:
        return PPOLearner(engine, network, settings, generators, plain)
    return make(engine, network, settings, generators)


def _head(engine: Engine, settings: PPOSettings) -> str:
    """Key of `rans.policy.heads.HEADS`; ConfigError where craft or task cannot follow it."""
    craft = engine.craft
    wanted = settings.head
    if wanted == "guided":
        first, last = engine.layout.advice
        if first == last:
            raise ConfigError(
                "the head 'guided' gives shares of what guidance recommends, which "
                f"{type(engine.task).__name__} does not observe: it is for missions on an orbit."
            )
        if settings.symmetric:
            raise ConfigError("the head 'guided' needs symmetric to be false.")
    if wanted == "auto":
        return "gaussian" if craft.is_continuous else "on-off"
    odd = [
        one.name for one in craft.commands if one.kind not in ("throttle", "pulsed") or one.low != 0
    ]
    if odd:
        raise ConfigError(
            f"the head {wanted!r} needs commands that may be 0 or a share up to the largest, and those of "
            f"{craft.name} may not ({odd[0]}): give it throttled or pulsed thrusters without wheels, or "
            "train with the head 'auto'."
        )
    return wanted


def check_sizes(engine: Engine, settings: PPOSettings, members: int) -> None:
    """Refuse, with a ConfigError, rollouts and minibatches that cannot be cut as the settings say."""
    steps = settings.n_steps
    batch = settings.batch_size
    processes = engine.processes
    if steps > engine.timing.episode_steps:
        raise ConfigError(
            f"n_steps must not exceed the episode's {engine.timing.episode_steps} steps, got "
            f"{steps}: an episode may be cut off once a rollout at most."
        )
    if engine.num_envs * processes.size != settings.n_envs * members:
        raise ConfigError(
            f"n_envs must be the engine's {engine.num_envs * processes.size // members} "
            f"environments a member, got {settings.n_envs}."
        )
    samples = settings.n_envs * steps
    if batch % steps or samples % batch:
        raise ConfigError(
            f"batch_size must be a multiple of n_steps = {steps} that divides n_steps x "
            f"environments = {samples}, got {batch}."
        )
    processes.share("batch_size", batch // steps)


def set_precision(matmul: str, device: torch.device) -> None:
    """Let a GPU multiply matrices of float32 with this `Precision`, or a ConfigError; process-wide."""
    if matmul not in get_args(Precision):
        raise ConfigError(
            f"matmul must be one of {', '.join(get_args(Precision))}, got {matmul!r}."
        )
    if device.type == "cuda":
        torch.set_float32_matmul_precision("highest" if matmul == "float32" else "high")


@dataclass
class Member:
    """One training among those that learn together, and how it went."""

    config: TrainConfig
    rows: list[dict[str, Any]] = field(default_factory=list)
    """As in ``metrics.jsonl``, up to the report that found it solved."""
    weights: dict[str, Tensor] = field(default_factory=dict)
    """Of the agent when it was solved, or when training ended (`Network.member`)."""
    in_a_row: int = 0
    """Reports until now that found the task solved, without one between that did not."""

    @property
    def solved(self) -> bool:
        """Whether enough reports in a row found the task solved, and that is asked for.

        Who goes on with a solved agent strikes ``solved_share`` from its config.
        """
        return self.config.solved_share is not None and self.in_a_row >= SOLVED_IN_A_ROW

    @property
    def diverged(self) -> bool:
        """Whether a weight became NaN or infinite."""
        return not all(tensor.isfinite().all() for tensor in self.weights.values())

    def finds_solved(self, success: float) -> bool:
        """Whether such a share of episodes is all that was asked for."""
        return self.config.solved_share is not None and success >= self.config.solved_share

    def note(self, row: dict[str, Any], solved: bool | None) -> None:
        """Keep a report, and whether it found the task solved; None: it does not count."""
        self.rows.append(row)
        if solved is not None:
            self.in_a_row = self.in_a_row + 1 if solved else 0


def statistics(
    numbers: Sequence[float], learner: Learner, steps: int, rollout: int, goes_on: bool = False
) -> dict[str, float]:
    """A row that `Learner.learn` returned about a member, by the names that SB3 gives its log.

    Length and return of an episode are those of the whole rollout, of so many steps, for each episode that
    ended in it; SB3 takes the last hundred that ended.

    NonFiniteState where a number is NaN or infinite after so many steps and that matters: it does not go on.
    """
    engine = learner.engine
    losses = dict(zip(learner.statistics, numbers, strict=False))
    rate, failed, ended, succeeded, *terms = numbers[len(learner.statistics) :]
    if not goes_on and not all(map(isfinite, numbers)):
        raise NonFiniteState(
            f"training produced a value that is not finite after {steps} steps "
            f"(losses {losses}); the usual cause is a learning rate or a reward that is too large."
        )
    table = {f"train/{name}": value for name, value in losses.items()} | {
        "train/learning_rate": rate
    }
    if ended:
        length = rollout / engine.processes.size / ended
        table |= {
            "rollout/ep_rew_mean": sum(terms) * length,
            "rollout/ep_len_mean": length,
            "rollout/success_rate": succeeded / ended,
            "rollout/failure_rate": failed / ended,
        }
    means = zip(engine.term_names, terms, strict=True)
    return table | {f"return/{name}": mean * engine.timing.episode_steps for name, mean in means}
