"""Controllers by name: those of other people are checked before they fly."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from rans.errors import ConfigError
from rans.evaluation.fly.contestants import contestant, is_controller, output_folder
from rans.evaluation.fly.controllers import CONTROLLERS, controller
from rans.evaluation.fly.judge import flown
from rans.evaluation.fly.protocols import Setup
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks import GoToPose, Task

HERE = "tests.evaluation.fly.test_controllers"
SETUP = Setup(load_spacecraft("floating-platform"), GoToPose(), Timing(episode_steps=3))


class Alternating:
    """Opens every second thruster of the craft it was made for; a slow one by its own word."""

    name, slow, failures = "alternating", True, 5

    def __init__(self, craft: Spacecraft, task: Task, timing: Timing) -> None:
        self.pattern = np.arange(len(craft.thrusters)) % 2 == 0

    def reset(self, count: int) -> None:
        self.count = count

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        return np.tile(self.pattern, (self.count, 1))


class Wide(Alternating):
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        return np.zeros((self.count, 3))


class Throttling(Alternating):
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        return np.full((self.count, len(self.pattern)), 0.25)


class Raising(Alternating):
    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        raise ZeroDivisionError("by nothing")


def impossible(craft: Spacecraft, task: Task, timing: Timing) -> Alternating:
    raise KeyError("gain")


def no_controller(craft: Spacecraft, task: Task, timing: Timing) -> Any:
    return type("Thing", (), {"name": "thing", "act": print})()


NUMBER = 3


def test_a_controller_of_any_module_flies_what_its_name_says() -> None:
    spec = f"{HERE}:Alternating:go-to-pose-2d@floating-platform-shared"
    found = contestant(spec)
    assert (found.craft.name, found.task, found.controller.name) == (
        "floating-platform-shared", GoToPose(), "alternating")
    assert is_controller(spec)
    assert output_folder(spec).name == f"{HERE}-Alternating-go-to-pose-2d-floating-platform-shared"
    made: Any = pickle.loads(pickle.dumps(found.controller))  # as processes get it that share the flights
    assert made.slow  # so that they do
    flight, failures = flown(made, SETUP, 1, 4)
    np.testing.assert_array_equal(flight.commands, np.tile([1.0, 0.0] * 4, (3, 4, 1)))
    assert failures == 5


def test_only_controllers_are_controllers() -> None:
    assert is_controller("lqr:go-to-pose-2d")
    assert not any(map(is_controller, ("runs/first", "pretrained:go-to-pose-2d", "python:lqr:act")))


@pytest.mark.parametrize(("name", "said"), [
    ("Wide", r"must answer 2 observations with commands of shape \(2, 8\), got \(2, 3\)"),
    ("Throttling", r"answers what floating-platform cannot do: .*0 \(shut\) or 1 \(open\).* got .*0\.25"),
    ("Raising", "failed: ZeroDivisionError: by nothing"),
])
def test_answers_are_checked(name: str, said: str) -> None:
    made = controller(f"{HERE}:{name}", SETUP)
    with pytest.raises(ConfigError, match=f"the controller '{HERE}:{name}' {said}"):
        flown(made, SETUP, 1, 2)


@pytest.mark.parametrize(("name", "said"), [
    ("impossible", "cannot be made: KeyError: 'gain'"),
    ("no_controller", "is no controller: it has no reset"),
    ("NUMBER", "cannot be used: a controller must be a class or function"),
])
def test_what_is_no_controller(name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=f"the controller '{HERE}:{name}' {said}"):
        controller(f"{HERE}:{name}", SETUP)


def test_registered_in_python() -> None:
    CONTROLLERS.register("every-second")(Alternating)
    try:
        assert contestant("every-second:go-to-pose-3d").controller.name == "alternating"
        assert pickle.loads(pickle.dumps(controller("every-second", SETUP))).name == "alternating"
    finally:
        del CONTROLLERS._own["every-second"]
