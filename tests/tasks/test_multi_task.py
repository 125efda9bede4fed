"""Whatever a multi-task says of an episode, the drawn task alone says the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rans import Spacecraft
from rans.episode.scenario import scenarios
from rans.model.fields import leaves, map_leaves, unflatten
from rans.tasks import TASKS, GoToPose, MultiTask, TrackVelocity, observation
from rans.tasks.rewards import Transition
from tests.support.crafts import random_states

COUNT = 500
TASK = MultiTask(go_to_pose=GoToPose(spin_weight=0.1, evaluation_distance=(2.0, 2.5)))
FLAGS = {
    "go-to-position": 0,
    "go-to-pose": 1,
    "track-velocity": 2,
    "track-twist": 3,
    "track-velocity-heading": 4,
}


def goals(task: MultiTask, craft: Spacecraft, seed: int, count: int) -> Any:
    return scenarios(task, craft, seed, count).goal


def drawn(name: str, *trees: Any, count: int = COUNT) -> list[Any]:
    """The episodes, of trees whose last one is the goal, that drew this task; the goal without its flag."""
    mine = np.broadcast_to(trees[-1].notes.flag, count) == FLAGS[name]
    *others, goal = (map_leaves(lambda x: np.broadcast_to(x, count)[mine], tree) for tree in trees)
    return [*others, unflatten(others[0], leaves(goal)[:-1])]


@pytest.mark.parametrize("name", FLAGS)
def test_the_drawn_task_decides_everything(name, shipped):
    part = TASK.parts()[name]
    state = random_states(shipped.dimension, COUNT, seed=1)
    goal = goals(TASK, shipped, 2, COUNT)
    rng = np.random.default_rng(3)
    width = len(shipped.thrusters)
    commands = tuple(tuple(rng.integers(0, 2, (width, COUNT)).astype(float)) for _ in range(2))
    mine = goal.notes.flag == FLAGS[name]
    its_state, its_goal = drawn(name, state, goal)
    its_commands = [tuple(c[mine] for c in command) for command in commands]
    for column, own in zip(
        observation(TASK, state, goal), observation(part, its_state, its_goal), strict=True
    ):
        np.testing.assert_array_equal(column[mine], own)
    for ours, own in (
        (TASK.errors(state, goal), part.errors(its_state, its_goal)),
        (
            TASK.reward(Transition(state, goal, commands[0], commands[1])),
            part.reward(Transition(its_state, its_goal, its_commands[0], its_commands[1])),
        ),
    ):
        assert own.keys() < ours.keys()
        for key, value in ours.items():
            np.testing.assert_array_equal(
                value[mine], own.get(key, np.zeros(mine.sum())), err_msg=key
            )
    np.testing.assert_array_equal(TASK.failed(state, goal)[mine], part.failed(its_state, its_goal))
    np.testing.assert_array_equal(
        TASK.reached(state, goal)[mine], part.reached(its_state, its_goal)
    )


@pytest.mark.parametrize(
    "names", [tuple(FLAGS), ("track-twist", "go-to-pose"), ("track-velocity",)]
)
def test_every_task_of_the_list_is_drawn_equally_often(names, shipped):
    flags = goals(MultiTask(tasks=names), shipped, 5, 6000).notes.flag
    values, counts = np.unique(flags, return_counts=True)
    assert set(values) == {FLAGS[name] for name in names}
    # the greatest standard deviation is that of two tasks, sqrt(6000 / 4) = 39: four of them
    np.testing.assert_allclose(counts, 6000 / len(names), atol=155)


def test_the_draw_says_nothing_of_where_an_episode_starts(shipped):
    """Go to position starts anywhere within its range, whatever number drew it."""
    every = scenarios(MultiTask(), shipped, seed=5, count=20_000)
    start, _ = drawn("go-to-position", every.start, every.goal, count=20_000)
    # the mean of 4000 uniform draws within 0.5 to 4.5 m: standard deviation 4 / sqrt(12 * 4000) = 0.018
    assert start.p.norm().mean() == pytest.approx(2.5, abs=0.09)


def test_parts_carry_their_settings_and_their_evaluation():
    assert list(TASK.parts()) == list(FLAGS)
    assert TASK.parts()["go-to-pose"] is TASK.go_to_pose
    assert TASK.for_evaluation().go_to_pose.spawn_distance == (2.0, 2.5)
    assert {name: part.flag for name, part in TASK.parts().items()} == FLAGS
    assert {name: type(part) for name, part in TASK.parts().items()}.items() < TASKS.items()
    assert TrackVelocity().parts() == {"": TrackVelocity()}  # a task alone needs no name
