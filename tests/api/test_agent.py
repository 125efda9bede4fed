"""`rans.Agent`: it acts as the trained network flies, remembers, is saved, and names its mistakes."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import rans
from rans import ConfigError


def open_loop(agent: rans.Agent, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Commands of an agent in a Gymnasium loop, and those of its own first flight of the same seed."""
    env = gymnasium.make("rans/GoToPose2D-v0", task=agent.task.for_evaluation())
    observation, _ = env.reset(seed=2023)
    memory = agent.predict(-observation)[1]  # of another episode
    given = []
    for step in range(steps):
        action, memory = agent.predict(observation, memory, np.array([step == 0]))
        assert env.action_space.contains(action)
        given.append(action)
        observation, *_ = env.step(action)
    return np.array(given), agent.fly(1).commands[:steps, 0]


def test_acting_in_a_loop_is_flying():
    """The agent remembers its last observations and commands, which `predict` must carry along."""
    agent = rans.load_agent("go-to-pose-2d-faults").under("perfect")
    looped, flown = open_loop(agent, 40)
    np.testing.assert_array_equal(looped, flown)


def test_an_agent_with_a_memory_acts_where_its_memory_is():
    agent = rans.load_agent("go-to-pose-2d-robust")
    with pytest.raises(ConfigError, match="predict"):
        agent.act(np.zeros(agent_width(agent)))


def agent_width(agent: rans.Agent) -> int:
    return rans.Engine(agent.craft, agent.task, 1).observation_width


def test_batches_and_tensors_are_answered_as_rows():
    agent = rans.load_agent("go-to-pose-2d")
    rows = np.random.default_rng(2).normal(size=(5, 10)).astype(np.float32)
    batch, state = agent.predict(torch.from_numpy(rows))
    assert (batch.shape, state) == ((5, 8), None)
    np.testing.assert_array_equal(batch, [agent.predict(row)[0] for row in rows])


def test_sampled_actions_differ_from_deterministic_ones():
    agent = rans.load_agent("go-to-pose-2d")
    rows = np.random.default_rng(3).normal(size=(400, 10)).astype(np.float32)
    sure = agent.predict(rows)[0]
    torch.manual_seed(0)
    drawn = agent.predict(rows, deterministic=False)[0]
    assert 0 < (sure != drawn).sum() < sure.size / 2


def test_a_saved_agent_flies_as_before(tmp_path):
    agent = rans.load_agent("go-to-pose-2d")
    copy = rans.load_agent(agent.save(tmp_path / "copy"))
    np.testing.assert_array_equal(copy.fly(3).commands, agent.fly(3).commands)
    with pytest.raises(ConfigError, match="is not empty: choose a new folder"):
        agent.save(tmp_path / "copy")


@pytest.mark.slow
def test_conditions_of_an_agent_are_those_it_is_compared_under():
    robust = rans.load_agent("go-to-pose-2d").under("lab")
    compared = rans.compare(robust, beside=(), episodes=4)
    assert compared.contest.conditions == rans.load_conditions("lab")
    alone = robust.evaluate(episodes=4)
    assert (
        alone["settling time"].value
        == rans.evaluate("go-to-pose-2d", conditions="lab", episodes=4)["settling time"].value
    )


@pytest.mark.parametrize("agent", ["any-craft-2d", rans.load_agent("any-craft-2d")])
def test_task_and_spacecraft_of_an_agent_are_honoured_or_refused(agent):
    assert rans.load_agent(agent, "go-to-pose", "atmos").craft.name == "atmos"
    with pytest.raises(ConfigError, match="flies GoToPose, got the task 'go-to-position'"):
        rans.load_agent(agent, "go-to-position")


def test_metrics_are_a_mapping():
    found = rans.load_agent("go-to-pose-2d").evaluate(episodes=2)
    assert "nothing" not in found
    assert list(found) == [row.name for row in found.rows] == list(dict(found))


@pytest.mark.parametrize(
    "make", [rans.Conditions, lambda **given: gymnasium.make("rans/GoToPose2D-v0", **given)]
)
def test_an_argument_that_is_none_is_a_type_error_as_in_python(make):
    """TorchRL's GymEnv tries ``frameskip`` and goes on at these words."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        make(frameskip=1)


def test_an_attitude_may_be_scipys():
    turn = Rotation.from_euler("xyz", (0.1, 0.2, 0.3))
    found: Any = rans.state((0.0, 0.0, 0.0), turn).attitude
    np.testing.assert_allclose(
        [found.w, found.x, found.y, found.z], turn.as_quat(scalar_first=True), rtol=1e-15
    )
