"""Policies of other libraries are flown with all that belongs to them, or refused."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import onnxruntime
import pytest
import torch
from onnx import helper
from rans_foreign_policies.policies import OnnxPolicy, policy_of
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack

import rans
from rans import ConfigError, GoToPose
from rans.evaluation.fly.object_policy import ObjectPolicy
from rans.evaluation.fly.user_policy import UserPolicy, user_policy
from rans.model.spacecraft_file import load_spacecraft
from tests.support.graphs import model_of, step as node
from tests.support.policies import Counting

CRAFT = load_spacecraft("floating-platform")
TASK = GoToPose()
STEPS = np.random.default_rng(2).normal(size=(5, 6, 10)).astype(np.float32)
"""Observations of five control periods of six episodes."""


def opened(policy: UserPolicy) -> list[list[int]]:
    """Open thrusters of each episode in each of five periods."""
    return [policy.act(None, None, step).sum(axis=1).astype(int).tolist() for step in STEPS]


def test_a_memory_lasts_from_one_period_to_the_next_and_ends_with_the_episode():
    policy = ObjectPolicy(Counting(), CRAFT, TASK)
    for _ in range(2):
        policy.reset(6)
        assert opened(policy) == [[k] * 6 for k in (1, 2, 3, 4, 5)]


class Forgetful:
    def predict(self, observation: Any, deterministic: bool = True) -> Any:
        return np.zeros((len(observation), 8)), (observation,)


class Alone:
    def predict(self, observation: Any, deterministic: bool = True) -> Any:
        return np.zeros((len(observation), 8))


@pytest.mark.parametrize(
    ("policy", "sentence"),
    [(Forgetful(), "^predict of .* takes none"), (Alone(), "^predict of .* actions and a state")],
)
def test_what_predict_cannot_be_flown_with_is_refused(policy, sentence):
    with pytest.raises(ConfigError, match=sentence):
        ObjectPolicy(policy, CRAFT, TASK).act(None, None, STEPS[0])


class Recurrent(torch.nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.memory = torch.nn.GRU(10, 8)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return (self.memory(x[None])[0][0] > 0.0).float()


def scripted() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # other libraries write such files
        return torch.jit.script(Recurrent())


@pytest.mark.parametrize(
    ("module", "sentence"),
    [
        (Recurrent, r"the Recurrent has a memory \(GRU\)"),
        (scripted, r"has a memory \(GRU\)"),
    ],
)
def test_modules_of_torch_with_what_is_out_of_reach(module, sentence):
    with pytest.raises(ConfigError, match=sentence):
        policy_of(module(), CRAFT, TASK)


def stacked() -> Any:
    return VecFrameStack(rans.SB3VecEnv(rans.Engine(CRAFT, TASK, num_envs=2)), 3)


class Doubled(gymnasium.ObservationWrapper[Any, Any, Any]):
    def observation(self, observation: Any) -> Any:
        return 2.0 * observation


def doubled() -> Any:
    return DummyVecEnv([lambda: Doubled(gymnasium.make("rans/GoToPose2D-v0"))])


@pytest.mark.parametrize(
    ("environment", "sentence"),
    [
        (stacked, r"observes \(30,\), but floating-platform has \(10,\): .* stacked"),
        (doubled, "trained behind Doubled, which changes observations or actions"),
    ],
)
def test_wrappers_that_would_not_be_flown(environment, sentence):
    model = PPO("MlpPolicy", environment(), n_steps=2, batch_size=2)
    with pytest.raises(ConfigError, match=sentence):
        ObjectPolicy(model, CRAFT, TASK)


UNITS = 3


def counting(file: Path, given: list[str], rows: Any = ("N", 8)) -> Path:
    """A network of states h and c that counts in h and leaves c; their sum is the command, given in this order."""
    nodes = [
        node("Add", "h c", "actions"),
        node("Add", "h one", "h_out"),
        node("Mul", "c one", "c_out"),
    ]
    inputs = {"obs": (rows[0], 10), "h": rows, "c": rows}
    file.write_bytes(model_of(nodes, inputs, dict.fromkeys(["actions", *given], rows), one=1.0))
    return file


@pytest.mark.parametrize("precision", [np.float16, np.float64])
def test_networks_of_every_precision_fly(tmp_path, precision):
    file = tmp_path / "plain.onnx"
    ports = {"obs": ("N", 10)}, {"actions": ("N", 8)}
    nodes = [node("MatMul", "obs W", "y"), node("Sigmoid", "y", "actions")]
    weights = np.random.default_rng(1).normal(size=(10, 8))
    file.write_bytes(model_of(nodes, *ports, precision=precision, W=weights))
    craft = load_spacecraft(str(Path("examples/trainers/throttled-platform.toml")))
    commands = user_policy(f"onnx:{file}", craft, TASK).act(None, None, STEPS[0])
    exact = 1.0 / (1.0 + np.exp(-STEPS[0] @ weights))
    # Half precision has ten bits, of sums of ten terms.
    np.testing.assert_allclose(commands, exact, atol=4e-3 if precision == np.float16 else 1e-6)


@pytest.mark.parametrize("shape", [(32, 10), ("N", 1, 10)])
def test_observations_of_another_shape_are_refused(tmp_path, shape):
    file = tmp_path / "shaped.onnx"
    file.write_bytes(
        model_of([node("Identity", "obs", "actions")], {"obs": shape}, {"actions": shape})
    )
    with pytest.raises(ConfigError, match=r"export it with two axes"):
        user_policy(f"onnx:{file}", CRAFT, TASK)


@pytest.mark.parametrize("rows", [("N", 8), (1, 8)])
def test_states_are_given_as_they_are_taken(tmp_path, rows):
    """The command counts the control periods of each episode; a batch of one is asked row by row."""
    session = onnxruntime.InferenceSession(
        str(counting(tmp_path / "counting.onnx", ["h_out", "c_out"], rows)),
        providers=["CPUExecutionProvider"],
    )
    policy = OnnxPolicy(session)
    memory = None
    observation = np.zeros((3, 10), np.float32)
    for period in range(4):
        begins = np.array([period == 0, period in (0, 2), period == 0])
        command, memory = policy(observation, memory, begins)
        counts = [period, period % 2, period]
        np.testing.assert_array_equal(command, np.outer(counts, np.ones(8)))


@pytest.mark.parametrize(
    ("given", "rows"), [(["h_out"], ("N", 8)), (["h_out", "c_out"], (2, "N", 8))]
)
def test_states_of_another_form_are_refused(tmp_path, given, rows):
    file = counting(tmp_path / "counting.onnx", given, rows)
    with pytest.raises(ConfigError, match=r"state [ch] of .* must be \(N, m\)|takes observations"):
        user_policy(f"onnx:{file}", CRAFT, TASK)


def test_a_network_that_hides_its_states_is_refused(tmp_path):
    shapes = {"w": (1, 4 * UNITS, 10), "r": (1, 4 * UNITS, UNITS), "k": (UNITS, 8)}
    tables: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
    nodes = [
        node("Unsqueeze", "obs axes", "sequence"),
        node("LSTM", "sequence w r", "- h_out c_out", hidden_size=UNITS),
        node("Squeeze", "h_out axes", "row"),
        node("MatMul", "row k", "actions"),
    ]
    file = tmp_path / "hidden.onnx"
    rows = {"obs": ("N", 10)}, {"actions": ("N", 8)}
    file.write_bytes(model_of(nodes, *rows, axes=np.array([0]), **tables))
    with pytest.raises(ConfigError, match=r"has a memory \(LSTM\) that it neither takes nor gives"):
        user_policy(f"onnx:{file}", CRAFT, TASK)


def test_a_network_that_may_take_any_time_is_refused(tmp_path):
    copies = [helper.make_node("Identity", [a], [b]) for a, b in (("go", "on"), ("at", "then"))]
    taken, given = (
        [helper.make_tensor_value_info(name, kind, []) for name, kind in ports]
        for ports in ((("k", 7), ("go", 9), ("at", 1)), (("on", 9), ("then", 1)))
    )
    loop = node(
        "Loop", "count go0 one", "end", body=helper.make_graph(copies, "body", taken, given)
    )
    nodes = [loop, node("Mul", "obs end", "actions")]
    file = tmp_path / "loop.onnx"
    tables: dict[str, Any] = {
        "count": np.array(2 * 10**9),
        "go0": np.array(True),
        "one": np.array(1.0),
    }
    ports = {"obs": ("N", 10)}, {"actions": ("N", 10)}
    file.write_bytes(model_of(nodes, *ports, **tables))
    with pytest.raises(ConfigError, match="has a Loop, which may take any time"):
        user_policy(f"onnx:{file}", CRAFT, TASK)


def test_a_network_that_takes_any_memory_is_refused(tmp_path):
    nodes = [node("ConstantOfShape", "size", "long"), node("MatMul", "obs long", "actions")]
    file = tmp_path / "long.onnx"
    ports = {"obs": ("N", 10)}, {"actions": ("N", 10)}
    file.write_bytes(model_of(nodes, *ports, size=np.array([10, 6 * 10**7])))
    with pytest.raises(ConfigError, match=r"long.onnx .* asks for 2.4 GB"):
        user_policy(f"onnx:{file}", CRAFT, TASK).act(None, None, STEPS[0])


def test_a_state_of_another_shape_than_it_is_taken_is_refused(tmp_path):
    columns: dict[str, Any] = {
        name: np.array([k]) for name, k in (("low", 0), ("high", 8), ("axis", 1))
    }
    nodes = [
        node("Slice", "obs low high axis", "actions"),
        node("Concat", "m m", "after", axis=1),
    ]
    outputs = {"actions": ("N", 8), "after": ("N", 8)}
    file = tmp_path / "odd.onnx"
    file.write_bytes(model_of(nodes, {"obs": ("N", 10), "m": ("N", 4)}, outputs, **columns))
    with pytest.raises(
        ConfigError, match=r"state m of .*odd\.onnx must be \(N, m\).*4.* taken.*8.*after"
    ):
        user_policy(f"onnx:{file}", CRAFT, TASK)
