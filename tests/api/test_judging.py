"""Policies that were made elsewhere fly like any agent: as objects, files and functions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import A2C

import rans
from rans import ConfigError


def shut(observation: np.ndarray) -> np.ndarray:
    """Never fires."""
    return np.zeros((len(observation), 8))


class Aft(torch.nn.Module):
    """Opens thruster 0 where the first number is positive."""

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        command = torch.zeros(len(rows), 8)
        command[:, 0] = (rows[:, 0] > 0).float()
        return command


@pytest.fixture(scope="module")
def model() -> A2C:
    engine = rans.Engine("floating-platform", "go-to-pose", num_envs=4)
    return A2C("MlpPolicy", rans.SB3VecEnv(engine), seed=0, policy_kwargs={"net_arch": [8]})


@pytest.mark.slow
def test_objects_fly_in_every_function(model):
    for policy in (model, shut, Aft()):
        agent = rans.load_agent(policy, "go-to-pose")
        assert agent.evaluate(episodes=4)["solved"].value == 0.0
        assert agent.act(np.zeros(10, np.float32)).shape == (8,)
    compared = rans.compare(
        "go-to-pose-2d", model, rans.load_agent(shut, "go-to-pose"), beside=(), episodes=2
    )
    assert [entry.name for entry in compared.entries] == ["go-to-pose-2d", "A2C", "shut"]


def test_an_object_is_asked_what_it_answers(model):
    flight = rans.load_agent(model, "go-to-pose").fly(2)
    again = np.array(
        [model.predict(observed, deterministic=True)[0] for observed in observations(flight)]
    )
    np.testing.assert_array_equal(flight.commands, again)


def observations(flight: Any) -> list[np.ndarray]:
    """What was observed at every step of a flight."""
    from rans.model.fields import map_leaves
    from rans.tasks import observation

    found = []
    for k in range(len(flight.commands)):
        state = map_leaves(lambda x, k=k: x[k], flight.states)
        goal = map_leaves(lambda x, k=k: x[k] if np.ndim(x) == 2 else x, flight.goals)
        found.append(np.stack(observation(flight.task, state, goal), axis=1).astype(np.float32))
    return found


@pytest.mark.slow
def test_an_object_flies_in_other_processes_and_in_drake():
    agent = rans.load_agent(lambda seen: seen[:, :8] * 0, "go-to-pose")
    flight = agent.fly(70, engine="drake")  # two processes of 64 episodes and fewer
    assert not flight.commands.any()


def test_the_failure_of_an_assured_function_is_bounded_as_of_an_agent():
    found = rans.assure(rans.load_agent(shut, "go-to-pose"), episodes=50, worst=0)
    assert (found.campaign.flights, found.campaign.failures) == (50, 50)
    assert found.campaign.bound().low > 0.9


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (shut, "has no task: give one, as in rans.load_agent"),
        (3, "an agent is its name, .*, a policy or"),
    ],
)
def test_objects_without_a_task(given, said):
    with pytest.raises(ConfigError, match=said):
        rans.load_agent(given)


def test_a_model_for_another_craft(model):
    with pytest.raises(ConfigError, match=r"the A2C observes \(10,\), but free-flyer has"):
        rans.load_agent(model, "go-to-pose", "free-flyer")


def test_a_failing_function_is_named_with_its_line():
    def fails(observation):
        raise ConfigError("no thrust today.")

    with pytest.raises(
        ConfigError,
        match=r"fails failed: ConfigError: no thrust today \(test_judging\.py, line \d+, in fails\)",
    ):
        rans.load_agent(fails, "go-to-pose").evaluate(episodes=1)
