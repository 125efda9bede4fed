"""Controllers by name, and policies made elsewhere: those of other people are checked before they fly."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, MultiBinary, MultiDiscrete
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv

from rans import Spacecraft, Timing
from rans.base.errors import ConfigError, MissingPackage
from rans.base.registry import typed
from rans.episode.step import Setup
from rans.evaluation.fly.contestant_name import ContestantName
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.fly.make_controller import controller
from rans.evaluation.fly.policy_text import is_user_policy
from rans.evaluation.fly.user_policy import user_policy
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, Task
from tests.support.strangers import trapped_weights

HERE = "tests.evaluation.fly.test_controllers"
SETUP = Setup(load_spacecraft("floating-platform"), GoToPose(), Timing(episode_steps=3))


class Alternating:
    """Opens every second thruster of the craft it was made for; a slow one by its own word."""

    name = "alternating"
    slow = True
    failures = 5

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
    raise ConfigError("gain")


def no_controller(craft: Spacecraft, task: Task, timing: Timing) -> Any:
    return type("Thing", (), {"name": "thing", "act": print})()


NUMBER = 3


def test_a_controller_of_any_module_flies_what_its_name_says():
    spec = f"{HERE}:Alternating:go-to-pose-2d@floating-platform-shared"
    found = contestant(spec)
    assert (found.craft.name, found.task, found.controller.name) == (
        "floating-platform-shared",
        GoToPose(),
        "alternating",
    )
    assert ContestantName.parse(spec).controller
    assert (
        ContestantName.parse(spec).output_folder.name
        == f"{HERE}-Alternating-go-to-pose-2d-floating-platform-shared"
    )
    made = pickle.loads(
        pickle.dumps(found.controller)
    )  # as processes get it that share the flights
    assert made.slow  # so that they do
    flight = fly_episodes(made, SETUP, 1, 4)
    np.testing.assert_array_equal(flight.commands, np.tile([1.0, 0.0] * 4, (3, 4, 1)))
    assert flight.stopped == 5


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Wide", r"must answer 2 observations with commands of shape \(2, 8\), got \(2, 3\)"),
        (
            "Throttling",
            r"answers with commands that floating-platform does not take: .*0 \(shut\) or 1 \(open\).* got .*0\.25",
        ),
        ("Raising", "failed: ZeroDivisionError: by nothing"),
        ("impossible", "cannot be made: ConfigError: gain .*, in impossible"),
        ("no_controller", "is no controller: it has no reset"),
        ("NUMBER", "cannot be used: a controller must be a class or function"),
    ],
)
def test_controllers_and_their_answers_are_checked(name, said):
    with pytest.raises(ConfigError, match=f"the controller '{HERE}:{name}' {said}"):
        fly_episodes(controller(typed(f"{HERE}:{name}"), SETUP), SETUP, 1, 2)


def test_registered_in_python():
    CONTROLLERS.register("every-second")(Alternating)
    try:
        assert contestant("every-second:go-to-pose-3d").controller.name == "alternating"
        assert pickle.loads(pickle.dumps(controller("every-second", SETUP))).name == "alternating"
    finally:
        del CONTROLLERS.own["every-second"]


CRAFT = load_spacecraft("floating-platform")
OBSERVATIONS = np.random.default_rng(0).normal(size=(7, 10)).astype(np.float32)


def saved(path: Path, algorithm: type, action_space: object, width: int = 10) -> tuple[str, object]:
    """A policy that was never trained, with somebody's spaces."""
    import gymnasium

    class Still(gymnasium.Env):
        observation_space = Box(-np.inf, np.inf, (width,), np.float32)

        def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple:
            return np.zeros(width, np.float32), {}

    Still.action_space = action_space  # type: ignore[assignment]
    model = algorithm("MlpPolicy", DummyVecEnv([Still]), seed=1, device="cpu")
    model.save(path)
    return str(path), model


@pytest.mark.parametrize("space", [MultiDiscrete([2] * 8), MultiBinary(8)])
def test_sb3_file_does_what_its_model_does(tmp_path, space):
    file, model = saved(tmp_path / "policy.zip", PPO, space)
    policy = user_policy(f"sb3:{file}", CRAFT, GoToPose(), trust=True)
    expected, _ = model.predict(OBSERVATIONS, deterministic=True)  # type: ignore[attr-defined]
    assert 0 < expected.sum() < expected.size  # not trivial
    np.testing.assert_array_equal(policy.act(None, None, OBSERVATIONS), expected)


def test_nobody_is_advised_to_unpickle_weights(tmp_path):
    """Which torch refuses even where the file is trusted."""
    file, _ = saved(tmp_path / "policy.zip", PPO, MultiBinary(8))
    trapped_weights(Path(file), tmp_path / "ran")
    with pytest.raises(ConfigError, match=r"is no policy that Stable-Baselines3 saved: [^.]*\.$"):
        user_policy(f"sb3:{file}", CRAFT, GoToPose(), trust=True)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("space", "width", "sentence"),
    [
        (
            Box(-1, 1, (8,)),
            10,
            r"8 thrusters, .* 0 \(shut\) or 1 \(open\): MultiDiscrete\(.*, MultiBinary\(8\)",
        ),
        (MultiBinary(16), 10, "has 8 thrusters"),
        (MultiDiscrete([3] * 8), 10, "has 8 thrusters"),
        (MultiBinary(8), 22, r"observes \(22,\), but floating-platform has \(10,\)"),
    ],
)
def test_sb3_file_for_something_else(tmp_path, space, width, sentence):
    file, _ = saved(tmp_path / "policy.zip", PPO, space, width)
    with pytest.raises(ConfigError, match=sentence):
        user_policy(f"sb3:{file}", CRAFT, GoToPose(), trust=True)


@pytest.mark.parametrize(
    ("spec", "sentence"),
    [
        ("python:tests.support.policies:none", "tests.support.policies has no 'none'"),
        ("python:tests.support.policies:PI", "is a float, no function"),
        ("python:no_such_module:act", "cannot be imported: ModuleNotFoundError"),
        ("python:tests.support.policies", "must name a module and a function"),
        ("python:", "there is no policy 'python:'; known are onnx:"),
        ("sb3:/no/such.zip", "there is no file /no/such.zip"),
        (f"sb3:{__file__}", r"sb3:.*\.py is a pickle: .* add --trust"),
    ],
)
def test_what_cannot_be_loaded(spec, sentence):
    assert is_user_policy(spec)
    with pytest.raises(ConfigError, match=sentence):
        user_policy(spec, CRAFT, GoToPose())


def test_onnx_needs_its_package(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingPackage, match=r"onnxruntime.*pip install .*\[onnx\]"):
        user_policy(f"onnx:{tmp_path / 'policy.onnx'}", CRAFT, GoToPose())
