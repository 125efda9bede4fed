"""Plain mode: everything is computed as it is written, and gives what the fast ways give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import gymnasium
import pytest
import torch
from torch import Tensor

import rans
from rans import Engine, GoToPose, Timing
from rans.episode.step import Setup
from rans.fast.flights import Flights
from rans.fast.learn.beginning import statistics
from rans.fast.learn.config import MemorySettings
from rans.model.fields import Field, leaves
from rans.model.trace import Symbol
from rans.tasks.rewards import Transition
from tests.support.draws import FLYER, PLATFORM
from tests.support.training import learner_on

SHORT = Timing(episode_steps=40)
SHORTEST = Timing(episode_steps=5)
"""Timing of flights of which every call of a function is noted, which takes ten times as long."""


@dataclass(frozen=True)
class Witness(GoToPose):
    """Notes what its functions are given."""

    symbols: ClassVar[list[str]] = []
    """Functions that were given a symbol."""
    rewarded: ClassVar[list[Transition]] = []

    def reward(self, transition: Transition) -> dict[str, Field]:
        self.rewarded.append(transition)
        return self._noted("reward", transition, super().reward(transition))

    def failed(self, state: Any, goal: Any) -> Field:
        return self._noted("failed", (state, goal), super().failed(state, goal))

    def errors(self, state: Any, goal: Any) -> dict[str, Field]:
        return self._noted("errors", (state, goal), super().errors(state, goal))

    def observation_terms(self, state: Any, goal: Any) -> Any:
        return self._noted(
            "observation_terms", (state, goal), super().observation_terms(state, goal)
        )

    def sample(self, random: Any) -> Any:
        found = super().sample(random)
        return self._noted("sample", found, found)

    def _noted(self, name: str, given: Any, result: Any) -> Any:
        if any(isinstance(x, Symbol) for x in leaves(tuple(given))):
            self.symbols.append(name)
        return result


@pytest.fixture
def witness() -> Witness:
    Witness.symbols.clear()
    Witness.rewarded.clear()
    return Witness()


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
@pytest.mark.parametrize("conditions", [None, "lab"])
def test_a_task_is_given_tensors_once_a_step_and_never_a_symbol(witness, craft, conditions):
    engine = Engine(craft, witness, 4, SHORTEST, plain=True, conditions=conditions)
    for _ in range(2 * SHORTEST.episode_steps):
        witness.rewarded.clear()
        engine.step(torch.zeros(4, len(craft.thrusters)))
        (transition,) = witness.rewarded
        given = leaves(tuple(transition))
        moving = leaves(transition.state)
        assert all(isinstance(x, Tensor) and x.shape == (4,) for x in moving)
        assert all(isinstance(x, Tensor | float) for x in given)
    assert not witness.symbols


@pytest.mark.parametrize(
    "settings",
    [
        {"memory": MemorySettings(2)},
        {"symmetric": False, "zoom": 100.0, "privileged_critic": True},
    ],
    ids=str,
)
def test_iterations_of_ppo_equal_the_fast_ones_but_for_rounding(settings):
    plain, fast = (
        learner_on(Engine(PLATFORM, "go-to-pose", 64, plain=plain), n_steps=16, **settings)
        for plain in (True, False)
    )
    begun = {name: x.detach().clone() for name, x in plain.network.tensors.items()}
    assert plain.backend is None
    for _ in range(3):
        logs = [statistics(one.learn().tolist(), one, 1024) for one in (plain, fast)]
        assert logs[0].keys() == logs[1].keys()
        for name, value in logs[1].items():
            if name == "train/entropy_loss":
                continue  # which autograd's way does not compute, because it has no weight
            assert logs[0][name] == pytest.approx(value, rel=2e-3, abs=2e-4), name
    for name, value in fast.network.tensors.items():
        torch.testing.assert_close(plain.network.tensors[name], value, rtol=0, atol=2e-4)
    moved = [(begun[name] - x).abs().max().item() for name, x in plain.network.tensors.items()]
    assert max(moved) > 0.01  # so that 2e-4 says something


def test_a_learner_may_be_plain_on_an_engine_that_is_not():
    engine = Engine(PLATFORM, "go-to-pose", 8)
    assert learner_on(engine, plain=True, n_steps=16).backend is None
    assert learner_on(engine, n_steps=16).backend is not None


def test_flights_equal_the_fast_ones_but_for_rounding():
    run = rans.load_agent("go-to-pose-2d")
    network: Any = run.controller
    setup = Setup(run.craft, run.task, run.timing)
    plain, fast = (
        Flights(network.network, setup, plain=plain).fly(0, 256, 1) for plain in (True, False)
    )
    assert plain.unsolved == fast.unsolved
    assert plain.failures == fast.failures
    assert plain.ways == {"stepping, cpu"}


def test_environments_hand_the_flag_to_their_engine(witness):
    envs: Any = gymnasium.make_vec("rans/GoToPose2D-v0", num_envs=2, plain=True)
    assert envs.unwrapped.engine.plain
    assert rans.SB3VecEnv(Engine(PLATFORM, "go-to-pose", 2, plain=True)).engine.plain
    env = gymnasium.make("rans/GoToPose2D-v0", task=GoToPose(), plain=True)
    env.reset(seed=0)
    env.step(env.action_space.sample())


# What a newcomer reads.


def test_gradients_lead_through_several_steps():
    """Against differences, from the first commands to the rewards of three periods."""
    engine = Engine(PLATFORM, GoToPose(), 2, SHORT, dtype=torch.float64, plain=True)

    def gained(command: torch.Tensor) -> torch.Tensor:
        episode = engine.running()
        reward = torch.zeros(2, dtype=torch.float64)
        for _ in range(3):
            step, episode = engine.stepped(episode, command)
            reward = reward + step.reward
        return reward.sum()

    command = torch.full((2, 8), 0.5, dtype=torch.float64)
    size = 1e-6
    shift = torch.zeros_like(command)
    shift[1, 3] = size
    difference = (gained(command + shift) - gained(command - shift)) / (2 * size)
    gained(command.requires_grad_()).backward()
    assert command.grad is not None
    assert command.grad[1, 3].item() == pytest.approx(difference.item(), rel=1e-5)
    assert abs(difference) > 1e-6
