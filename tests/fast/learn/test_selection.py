from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from rans import GoToPose, MultiTask, Timing, TrackTwist
from rans.episode.flight import Flight, fly
from rans.episode.scenario import SELECTION_SEED, scenarios
from rans.evaluation.fly.agent import Agent
from rans.fast.learn.config import MemorySettings
from rans.fast.learn.selection import EPISODES, Selection
from rans.policy.network import Network
from tests.support.engines import PLATFORM, SHORT, both_crafts
from tests.support.missions import Pass
from tests.support.training import scatter, tiny_learner

LENIENT = GoToPose(
    spawn_distance=(0.1, 0.2),
    evaluation_distance=(0.5, 1.0),
    fail_distance=1.2,
    position_tolerance=1.1,
    attitude_tolerance=2.5,
)
"""Some leave, some turn away, some do well enough; all would from where training starts."""


def judge(network: Network, craft: Any, task: Any, timing: Timing = SHORT) -> dict[str, float]:
    """What `Selection` says of one member."""
    return Selection(network, craft, task, timing, torch.device("cpu")).judge()


def found(said: dict[str, float]) -> tuple[float, dict[str, float]]:
    """Its share and its errors by quantity."""
    return said["success"], {
        name.removeprefix("error/"): error
        for name, error in said.items()
        if name.startswith("error/")
    }


def judged(
    craft: Any, task: GoToPose, timing: Timing = SHORT
) -> tuple[float, dict[str, float], Flight]:
    """What `Selection` says of an untrained agent, and its flight in float64 by `rans.episode.flight`."""
    network = scatter(tiny_learner(craft).network)
    share, errors = found(judge(network, craft, task, timing))
    starts = scenarios(task.for_evaluation(), craft, SELECTION_SEED, EPISODES)
    return share, errors, fly(craft, task, Agent(network, "untrained"), starts, timing)


@both_crafts
def test_share_of_episodes_that_keep_within_tolerance(craft):
    share, _, flight = judged(craft, LENIENT)
    # A fifth of 20 steps: the states arrived in with the last four.
    errors = flight.errors()
    kept = (errors["position"][-4:] < 1.1).all(axis=0) & (errors["attitude"][-4:] < 2.5).all(axis=0)
    expected = (kept & ~flight.failed()).mean()
    assert (kept & flight.failed()).sum() + (~kept).sum() > 50  # failure and tolerances both count
    assert 0.02 < expected < 0.9
    # In float32 a few thrusters near their threshold choose otherwise.
    assert share == pytest.approx(expected, abs=5 / EPISODES)


@both_crafts
@pytest.mark.filterwarnings("ignore:untrained spins:UserWarning")  # both engines alike
def test_mean_errors_of_the_last_fifth(craft):
    """Of the states acted in, while nobody fails."""
    _, errors, flight = judged(craft, replace(LENIENT, fail_distance=1e3, fail_spin=1e3))
    assert not flight.failed().any()
    for name, error in flight.errors().items():
        assert errors[name] == pytest.approx(error[-5:-1].mean(), rel=1e-3)  # as above


def test_an_episode_that_follows_a_failure_remembers_nothing_of_it():
    network = scatter(tiny_learner(memory=MemorySettings(4)).network)
    selection = Selection(network, PLATFORM, LENIENT, SHORT, torch.device("cpu"))
    engine = selection._engines[""]
    act = network.deterministic_action
    move = engine.step
    remembered = []
    ended = []

    def watched_act(observation, memory):
        remembered.append(memory.any(dim=1))
        return act(observation, memory)

    def watched_step(command):
        result = move(command)
        ended.append((result.terminated | result.truncated).clone())
        return result

    network.deterministic_action = watched_act  # type: ignore[method-assign]
    engine.step = watched_step  # type: ignore[method-assign]
    selection.judge()
    assert not remembered[0].any()
    for before, now in zip(ended[:-1], remembered[1:], strict=True):
        assert torch.equal(now, ~before)
    assert sum(int(some.sum()) for some in ended[:-1]) > 50


def test_it_always_judges_the_same_flights():
    network = scatter(tiny_learner().network)
    selection = Selection(network, PLATFORM, LENIENT, SHORT, torch.device("cpu"))
    generator = torch.get_rng_state()
    first = selection.judge()
    assert selection.judge() == first
    assert torch.equal(torch.get_rng_state(), generator)  # training is not disturbed
    scatter(network, seed=8)
    assert selection.judge() != first


def test_a_multi_task_is_as_good_as_its_worst_part():
    """Each part is judged as it would be alone."""
    network = scatter(tiny_learner().network)
    task = MultiTask(
        tasks=("go-to-pose", "track-twist"),
        go_to_pose=LENIENT,
        track_twist=TrackTwist(velocity_tolerance=0.6, spin_tolerance=1.5),
    )
    share, errors = found(judge(network, PLATFORM, task))
    alone = {name: found(judge(network, PLATFORM, part)) for name, part in task.parts().items()}
    assert errors == {
        f"{name}/{quantity}": error
        for name, (_, own) in alone.items()
        for quantity, error in own.items()
    }
    shares = [own for own, _ in alone.values()]
    assert 0.0 < min(shares) < max(shares) < 1.0
    assert share == min(shares)


def test_a_mission_that_is_won_early_is_a_success():
    """As flights in float64 are judged: some are won in the middle, some hit the wall, some do neither."""
    task = Pass(speed=0.4, wall=0.3)
    timing = replace(SHORT, checks=2)
    network = scatter(tiny_learner(task=task).network)
    share, _ = found(judge(network, PLATFORM, task, timing))
    starts = scenarios(task, PLATFORM, SELECTION_SEED, EPISODES)
    verdict = fly(PLATFORM, task, Agent(network, "untrained"), starts, timing).verdict
    solved = np.asarray(verdict.solved)
    assert 0.05 < solved.mean() < 0.95
    # In float32 a few thrusters near their threshold choose otherwise.
    assert share == pytest.approx(solved.mean(), abs=5 / EPISODES)
