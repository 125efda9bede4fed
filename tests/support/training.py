"""Trainings that tests share: so small that an iteration takes milliseconds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import stable_baselines3
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor

from rans import Engine, SB3VecEnv
from rans.fast.learn.adam import EPSILON
from rans.fast.learn.batch import Batch
from rans.fast.learn.beginning import begin
from rans.fast.learn.config import MemorySettings, PPOSettings, TrainConfig
from rans.fast.learn.ppo import PPOLearner
from rans.fast.learn.run_folder import RunFolder
from rans.fast.learn.trainer import Trainer
from rans.model.actuators import Throttle
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.network import Network
from rans.tasks import GoToPose, observation
from rans.tasks.derived import layout
from tests.support.crafts import random_states
from tests.support.engines import FLYER, NEAR, PLATFORM, SHORT

TINY = PPOSettings(n_envs=16, n_steps=8, batch_size=64, n_epochs=2, layers=(16, 16))
CONFIG = TrainConfig(
    "go-to-pose",
    GoToPose(),
    "floating-platform",
    TINY,
    SHORT,
    total_timesteps=2048,
    solved_share=None,
)
EASY = GoToPose(
    spawn_distance=(0.5, 1.0),
    evaluation_distance=(0.5, 1.0),
    position_tolerance=9.0,
    attitude_tolerance=4.0,
)
"""Solved by whoever does not fail."""


MACHINE_CODE_CASES = pytest.mark.parametrize(
    ("craft", "settings"),
    [
        (PLATFORM, {"layers": (64, 64), "symmetric": True}),
        (FLYER, {"layers": (40, 33, 7), "activation": "elu", "zoom": 4.0, "symmetric": True}),
        (PLATFORM, {"layers": (20,), "activation": "relu", "memory": MemorySettings(2)}),
    ],
    ids=["plane", "space, elu, three layers", "relu, one layer, a history"],
)
"""Networks that a processor's machine code answers and learns."""


def settings_with(settings: PPOSettings, **values: Any) -> PPOSettings:
    """The settings with other values; of constants, too, which are those of a class made for this."""
    names = {one.name for one in fields(settings)}
    constants = {name: values.pop(name) for name in [*values] if name not in names}
    kind: Any = type("Other", (type(settings),), constants) if constants else type(settings)
    return kind(**{name: getattr(settings, name) for name in names} | values)


def tiny_learner(
    craft: Any = PLATFORM,
    seed: int = 0,
    dtype: torch.dtype = torch.float32,
    task: Any = NEAR,
    continuous: bool = False,
    device: str = "cpu",
    **settings: Any,
) -> PPOLearner:
    """PPO, by default where many episodes fail and others are cut off by time; SB3 knows its network."""
    chosen = settings_with(TINY, **{"symmetric": False} | settings)
    craft = replace(craft, actuators=Throttle()) if continuous else craft
    engine = Engine(craft, task, chosen.n_envs, SHORT, seed=seed, dtype=dtype, device=device)
    return begin(engine, chosen, seed)


def learner_on(engine: Engine, plain: bool | None = None, **settings: Any) -> PPOLearner:
    """PPO on an engine, with default settings but for these, and four minibatches a rollout."""
    steps = settings.get("n_steps", PPOSettings.n_steps)
    sizes: dict[str, Any] = {"n_envs": engine.num_envs}
    sizes["batch_size"] = max(1, engine.num_envs // 4) * steps
    return begin(engine, PPOSettings(**sizes | settings), 0, plain)


def tiny_trainer(path: Path, config: TrainConfig = CONFIG) -> Trainer:
    """A trainer in a new run folder."""
    run = RunFolder(path)
    run.begin(config, "rans train")
    return Trainer(config, run.spacecraft(), run)


def weights(policy: Network | ActorCriticPolicy) -> Tensor:
    """Every parameter and statistic, in one row."""
    tensors = policy.tensors if isinstance(policy, Network) else policy.state_dict()
    return torch.cat([value.detach().flatten().clone() for value in tensors.values()])


def scatter(network: Network, seed: int = 3) -> Network:
    """Make weights large, so that probabilities and values differ visibly between observations."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for name in network.learnt:
            parameter = network.tensors[name]
            parameter.copy_(torch.randn(parameter.shape, generator=generator) * 0.5)
    return network


class Trunk(BaseFeaturesExtractor):
    """Normaliser and trunk of a `Network` as SB3's features extractor, without its heads."""

    def __init__(self, observation_space: spaces.Box, architecture: Architecture) -> None:
        super().__init__(observation_space, architecture.features)
        self.architecture = architecture
        for name, module in architecture.modules().items():
            self.add_module(name, module)
        for name, statistic in architecture.statistics().items():
            self.register_buffer(name, statistic)

    def forward(self, observations: Tensor) -> Tensor:
        """Features (N, units of the last layer) of observations (N, width)."""
        tensors = (*self.named_parameters(), *self.named_buffers())
        network = Network(self.architecture, {EXTRACTOR + name: x for name, x in tensors})
        return network.features(network.look(network.in_body(observations))[0])[0]


def policy_kwargs(architecture: Architecture) -> dict[str, Any]:
    """``policy_kwargs`` of SB3 for a network of this architecture, with our Adam's."""
    return {
        "features_extractor_class": Trunk,
        "features_extractor_kwargs": {"architecture": architecture},
        "net_arch": [],
        "optimizer_kwargs": {"fused": True, "eps": EPSILON},
    }


def policy_spaces(architecture: Architecture) -> tuple[spaces.Box, spaces.Space[Any]]:
    """Observation and action space of an agent, as SB3 has them."""
    count = architecture.thrusters
    duties = spaces.Box(0.0, 1.0, (count,), np.float32)
    seen = spaces.Box(-math.inf, math.inf, (architecture.layout.width,))
    return seen, duties if architecture.continuous else spaces.MultiDiscrete([2] * count)


def sb3_policy(
    architecture: Architecture,
    tensors: Mapping[str, Tensor],
    dtype: torch.dtype = torch.float64,
) -> ActorCriticPolicy:
    """These weights in SB3's own policy, which knows no symmetries."""
    policy = ActorCriticPolicy(
        *policy_spaces(architecture), lambda _: 1e-3, **policy_kwargs(architecture)
    ).to(dtype)
    with torch.no_grad():
        for name, place in (*policy.named_parameters(), *policy.named_buffers()):
            place.copy_(tensors[name])
    return policy


class Buffer64(RolloutBuffer):
    """SB3's buffer with its arithmetic in float64, to compare to more than seven digits."""

    def reset(self) -> None:
        super().reset()
        for name in ("rewards", "returns", "values", "log_probs", "advantages", "episode_starts"):
            setattr(self, name, getattr(self, name).astype(np.float64))


def sb3_twin(learner: PPOLearner, settings: PPOSettings, **changes: Any) -> stable_baselines3.PPO:
    """Stable-Baselines3's own PPO with the same settings and weights, on an engine of the same seed."""
    engine = learner.engine
    architecture = learner.network.architecture
    env = SB3VecEnv(
        Engine(engine.craft, engine.task, engine.num_envs, engine.timing, dtype=engine.dtype)
    )
    env.action_space = policy_spaces(architecture)[1]
    names = (
        "n_steps",
        "n_epochs",
        "gamma",
        "gae_lambda",
        "vf_coef",
        "max_grad_norm",
        "learning_rate",
        "clip_range",
    )
    given = {name: getattr(settings, name) for name in names} | changes
    twin = stable_baselines3.PPO(
        "MlpPolicy",
        env,
        batch_size=engine.num_envs * settings.n_steps,
        seed=0,
        policy_kwargs=policy_kwargs(architecture),
        rollout_buffer_class=Buffer64,
        device="cpu",
        **given,
    )
    twin.policy.to(engine.dtype)
    twin.policy.load_state_dict(
        sb3_policy(architecture, learner.network.weights(), engine.dtype).state_dict()
    )
    twin.set_logger(Logger(None, []))
    return twin


def ignore(_: Any) -> None:
    """A report to nobody."""


def resumed(path: Path) -> Trainer:
    run = RunFolder(path)
    trainer = Trainer(run.config(), run.spacecraft(), run)
    trainer.resume()
    return trainer


def after(count: int) -> Any:
    """Asks for a stop after so many iterations."""
    asked = iter(range(10**9))
    return lambda: next(asked) + 1 >= count


def make_network(craft: Any, continuous: bool = False, head: str = "", **settings: Any) -> Network:
    """A float64 network with large random weights and statistics."""
    columns = layout(GoToPose(), craft.dimension)
    given = Architecture(
        columns,
        len(craft.thrusters),
        (16,),
        head=head or ("gaussian" if continuous else "on-off"),
        **settings,
    )
    tensors, _ = given.initial(0, 0.5)
    network = scatter(Network.copied(given, tensors, torch.device("cpu"), torch.float64))
    network.update_statistics(network.in_body(seen(craft, 500))[None])
    return network


def seen(craft: Any, count: int, seed: int = 1) -> Tensor:
    """Observations that float32 holds exactly: SB3 casts what it is given to float32."""
    state, goal = (random_states(craft.dimension, count, s) for s in (seed, seed + 1))
    return torch.from_numpy(
        np.stack(observation(GoToPose(), state, goal), axis=1).astype(np.float32)
    )


def everything(trainer: Trainer) -> list[Any]:
    """All that decides how a training goes on, in comparable form."""
    saved = trainer._checkpoint()
    learner = saved["learner"]
    flat = [
        saved["steps"],
        [state.tolist() for state in learner["generators"]],
        saved["engine"]["seed"],
    ]
    flat += [buffer.tolist() for buffer in saved["engine"]["buffers"]]
    flat += [] if learner["memory"] is None else [learner["memory"].tolist()]
    return [*flat, weights(trainer.learner.network).tolist(), repr(learner["adam"])]


def collected(craft: Any, device: str = "cpu", **settings: Any) -> tuple[PPOLearner, Batch]:
    """A learner and what it has to learn from, by a policy that has changed since."""
    sizes: dict[str, Any] = {"n_envs": 20, "batch_size": 160, "clip_range": 0.15}
    learner = tiny_learner(craft, device=device, **(sizes | settings))
    learner.backend = None
    scale = torch.Generator(device).manual_seed(1)
    network = scatter(learner.network)
    with torch.no_grad():
        for name in network.learnt:  # outputs of order one
            network.tensors[name] *= 3.0 / max(network.tensors[name].shape[-1], 9) ** 0.5
    learner.collect()
    if (told := learner.rollout.all.privileged) is not None:  # which here would be the same for all
        told.normal_(generator=scale)
    with torch.no_grad():
        for name in network.learnt:
            like = network.tensors[name]
            like += 0.02 * torch.randn(like.shape, generator=scale, device=device)
    return learner, learner.batch()
