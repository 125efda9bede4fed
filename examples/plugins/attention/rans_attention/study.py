"""One policy for random layouts of thrusters: what attention over effectors learns, and carries over.

``pip install ./examples/plugins/attention ./examples/plugins/gradient`` and ``python -m rans_attention.study``
train it for about two minutes and print the table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import fmean

import numpy as np
import torch
from rans_gradient.learner import GradientLearner, GradientSettings

from rans.extend import Engine, GoToPose, Network, PPOSettings, Spacecraft, Terminal, Timing
from rans.fast.learn.config import ExplorationSettings
from rans.fast.learn.learner import Learner
from rans.fast.learn.member import begin
from rans.model.actuators import Throttle
from rans.model.spacecraft import Thruster
from rans.model.spacecraft_file import load_spacecraft

_TASK = GoToPose(spawn_distance=(0.3, 1.0))
_TIMING = Timing(episode_steps=32)


def _settings() -> PPOSettings:
    """Settings of the training; the backbone is that of an installed package."""
    return PPOSettings(
        n_envs=64,
        n_steps=16,
        batch_size=1024,
        n_epochs=1,
        layers=(32, 32),
        learning_rate=0.01,
        symmetric=False,
        backbone="attention",
        exploration=ExplorationSettings(initial_duty=0.2),
    )


def random_layout(seed: int) -> Spacecraft:
    """The floating platform with throttled thrusters elsewhere.

    Four places on a circle of 0.2 m, a quarter turn apart to 20 degrees, with two opposite thrusters of 1 N
    along the circle at each, in a random order.
    """
    random = np.random.default_rng(seed)
    places = random.uniform(0.0, math.tau) + math.pi / 2 * np.arange(4)
    places += np.radians(random.uniform(-20.0, 20.0, 4))
    thrusters = [
        Thruster(
            (0.2 * math.cos(place), 0.2 * math.sin(place), 0.0),
            (-way * math.sin(place), way * math.cos(place), 0.0),
            1.0,
        )
        for place in places
        for way in (1.0, -1.0)
    ]
    return replace(
        load_spacecraft("floating-platform"),
        name=f"random layout {seed}",
        actuators=Throttle(),
        thrusters=tuple(thrusters[i] for i in random.permutation(len(thrusters))),
    )


def begun(count: int) -> list[GradientLearner]:
    """Learners of so many layouts, each with critics of its own."""
    make = partial(GradientLearner, own=GradientSettings())
    learners = []
    for seed in range(count):
        engine = Engine(random_layout(seed), _TASK, _settings().n_envs, _TIMING, plain=True)
        learner = begin(engine, [_settings()], [0], True, make)
        assert isinstance(learner, GradientLearner)
        learners.append(learner)
    return learners


def train(learners: Sequence[GradientLearner], rounds: int) -> list[list[float]]:
    """Train one set of weights on all layouts by turns; mean rewards of a step, by round and layout."""
    weights = learners[0].network.tensors
    rewards = []
    for _ in range(rounds):
        rewards.append([])
        for learner in learners:
            adopt(learner.network, weights)
            learner.learn()
            weights = learner.network.tensors
            rewards[-1].append(mean_reward(learner))
    return rewards


def mean_reward(learner: Learner) -> float:
    """Of the steps that were flown last."""
    assert isinstance(learner, GradientLearner)
    return learner.rollout.all.reward.mean().item()


@torch.no_grad()
def adopt(network: Network, other: dict[str, torch.Tensor]) -> None:
    """Copy weights and statistics of another network."""
    for name, tensor in network.tensors.items():
        tensor.copy_(other[name])


@dataclass(frozen=True)
class Attention:
    """Train one policy on random layouts of thrusters, and fly it on one that it never saw."""

    layouts: int = 2
    """To train on."""
    rounds: int = 40
    """Iterations on each."""

    def run(self) -> int:
        """Print mean rewards of a step before and after."""
        torch.set_num_threads(1)
        *learners, unseen = begun(self.layouts + 1)
        before = {name: x.clone() for name, x in unseen.network.tensors.items()}
        rewards = train(learners, self.rounds)
        after = learners[-1].network.tensors
        found = []
        for weights in (before, after):
            adopt(unseen.network, weights)
            unseen.learn()
            found.append(mean_reward(unseen))
        rows = (
            ("trained on", f"{fmean(rewards[0]):.2f}", f"{fmean(rewards[-1]):.2f}"),
            ("another", *(f"{reward:.2f}" for reward in found)),
        )
        Terminal(room=110).show(
            "Attention over effectors", ("layouts", "reward before", "after"), rows
        )
        return 0


if __name__ == "__main__":
    import sys

    import tyro

    sys.exit(tyro.cli(Attention).run())
