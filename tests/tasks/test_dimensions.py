"""Tasks that are written for the plane alone, or for space alone, where the other one is asked of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import pytest

import rans
from rans import TASKS, ConfigError
from rans.model.drift import Drift, UniformGravity
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.random import Random
from rans.tasks.derived import check_dimension, dimensions
from rans.tasks.observation_terms import Scalar


@dataclass(frozen=True)
class Flat(rans.GoToPose):
    """A heading is in the plane alone."""

    def reward(self, transition: Any) -> dict[str, Any]:
        return super().reward(transition) | {"level": 0.1 * transition.state.attitude.angle}


class Seen(rans.GoToPose):
    """The same of what a policy sees."""

    def observation_terms(self, state: Any, goal: Any) -> Any:
        return *super().observation_terms(state, goal), Scalar(
            "heading", "rad", state.attitude.angle
        )


class Turned(rans.GoToPose):
    """In space a spin is a vector, which no number is added to."""

    def failed(self, state: Any, goal: Any) -> Any:
        return super().failed(state, goal) | (state.w + 1.0 > 3.0)


class Tilted(rans.GoToPose):
    """Gravity of two components."""

    @property
    def drift(self) -> Drift:
        return UniformGravity((0.01, 0.0))


class Fixed(rans.GoToPose):
    """Its goal is a place in the plane, whatever flies."""

    def sample(self, random: Random) -> Any:
        still = Vec2(0.0, 0.0)
        return super().sample(random)[0], PlanarState(still, Heading(0.0), still, 0.0)


@dataclass(frozen=True)
class Deep(rans.GoToPose):
    """A height is in space alone."""

    def reward(self, transition: Any) -> dict[str, Any]:
        return super().reward(transition) | {"height": -0.1 * transition.state.p.z}


FLAT = "tests.tasks.test_dimensions:Flat"
DEEP = "tests.tasks.test_dimensions:Deep"
ANGLE = (
    "works in the plane, but not in space: AttributeError: 'Quat' object has no attribute 'angle'"
)
HEIGHT = "works in space, but not in the plane: AttributeError: 'Vec2' object has no attribute 'z'"


@pytest.mark.parametrize("kind", [Flat, Seen, Turned, Tilted, Fixed])
def test_every_function_of_a_task_is_tried(kind):
    task = kind()
    assert dimensions(task) == (2,)
    check_dimension(task, 2)
    with pytest.raises(
        ConfigError, match=f"the task {kind.__name__} works in the plane, but not in space"
    ):
        check_dimension(task, 3)


@pytest.mark.parametrize(
    "use",
    [
        lambda: gymnasium.make_vec("rans/GoToPose3D-v0", num_envs=2, task=Flat()),
        lambda: rans.optimal_trajectory(FLAT, "free-flyer"),
    ],
    ids=["make_vec", "optimal"],
)
def test_whoever_flies_a_task_of_the_plane_in_space_is_told(use):
    with pytest.raises(ConfigError, match=ANGLE) as told:
        use()
    assert isinstance(told.value.__cause__, AttributeError)


def test_the_reverse_and_nothing_is_written(tmp_path):
    with pytest.raises(ConfigError, match=HEIGHT):
        rans.evaluate(f"lqr:{DEEP}-2d", episodes=2)
    with pytest.raises(ConfigError, match=HEIGHT):
        rans.train(DEEP, "atmos", device="cpu", total_timesteps=4096, output=tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "name",
    [name for name in filter(TASKS.comes_with_rans, TASKS) if TASKS[name].dimensions != (2, 3)],
)
def test_a_task_of_one_dimension_is_listed_in_it_alone(name, ran):
    task = TASKS[name]
    assert dimensions(task()) == task.dimensions
    printed = ran(f"list {name}")
    assert ("Observation in the plane" in printed) == (2 in task.dimensions)
    assert ("Observation in space" in printed) == (3 in task.dimensions)
