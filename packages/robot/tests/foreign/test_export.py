"""Networks that torch and other trainers wrote as ONNX are exported as they are, judged by ONNX Runtime."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from rans_robot.foreign.export import write_foreign_export
from rans_robot.foreign.program import foreign_program

from rans.deploy.c.compiler import FLAGS
from rans.deploy.c.files import write_c
from rans.deploy.numpy_file import printed
from rans.deploy.program import Ports
from rans.errors import ConfigError, RansWarning
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from tests.support.exports import exported
from tests.support.graphs import model_of, step

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

TRAINERS = Path(__file__).parents[4] / "examples" / "trainers"
FILES = sorted(file.stem for file in (TRAINERS / "agents").glob("*.onnx"))
WIDTH = 10
PLATFORM = "floating-platform"
THROTTLED = str(TRAINERS / "throttled-platform.toml")


def written(module: torch.nn.Module, file: Path, width: int = WIDTH, batch: str = "N") -> Path:
    """The module in evaluation mode as torch writes it, for batches of any size or of one."""
    with warnings.catch_warnings():
        # The other exporter needs one more package; SB3's distributions look at numbers while they are traced.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module.eval(),
            (torch.zeros(1, width),),
            str(file),
            opset_version=17,
            input_names=["observation"],
            dynamic_axes={"observation": {0: batch}} if batch else None,
            dynamo=False,
        )
    return file


def judged(file: Path, observations: np.ndarray) -> np.ndarray:
    """First output of ONNX Runtime for observations (N, width), one by one."""
    session = onnxruntime.InferenceSession(str(file))
    (item,) = session.get_inputs()
    return np.concatenate(
        [session.run(None, {item.name: row[None]})[0].reshape(1, -1) for row in observations]
    )


def by_numpy(file: Path, craft: Spacecraft, observations: np.ndarray) -> np.ndarray:
    program = foreign_program(file, observations.shape[1], craft)
    lines, tables = printed(program)
    names: dict[str, Any] = {"np": np, "w": {name: program.constants[name] for name in tables}}
    names["observation"] = observations
    exec("\n".join(lines), names)
    return names["command"]


def by_c(file: Path, craft: Spacecraft, observations: np.ndarray, folder: Path) -> np.ndarray:
    ports = Ports(observations.shape[1], craft.command_count)
    write_c(folder, foreign_program(file, observations.shape[1], craft), ports, "it")
    built = folder / "agent.so"
    source = str(folder / "agent.c")
    subprocess.run(
        ["cc", "-O2", *FLAGS, "-fPIC", "-shared", source, "-o", str(built), "-lm"], check=True
    )
    answer = ctypes.CDLL(str(built)).rans_agent_answer
    answer.argtypes = [ctypes.c_void_p] * 4
    results = np.zeros((len(observations), craft.command_count), np.float32)
    for row, result in zip(observations, results, strict=True):
        answer(row.ctypes.data, None, result.ctypes.data, None)
    return results


def observations(count: int = 50) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(count, WIDTH)).astype(np.float32)


@pytest.mark.parametrize("name", FILES)
def test_networks_of_eight_trainers_are_those_of_onnx_runtime(name: str) -> None:
    craft = load_spacecraft(THROTTLED if name in ("sb3-sac", "sb3-td3") else PLATFORM)
    file = TRAINERS / "agents" / f"{name}.onnx"
    rows = observations()
    expected = judged(file, rows)
    assert 0.05 < expected.mean() < 0.95
    # Single precision in another order of sums.
    np.testing.assert_allclose(by_numpy(file, craft, rows), expected, atol=1e-5)


class Function(torch.nn.Module):
    """A function of the observation as a module."""

    def __init__(self, of: Callable[[torch.Tensor], torch.Tensor]) -> None:
        super().__init__()
        self.of = of

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.of(x)


class _Everything(torch.nn.Module):
    """Layers, normalisations and activations of torch, a choice of columns and a product of two of them."""

    def __init__(self) -> None:
        super().__init__()
        torch.manual_seed(0)
        nn = torch.nn
        self.layers = nn.Sequential(
            nn.BatchNorm1d(WIDTH + 1),
            nn.Linear(WIDTH + 1, 24),
            nn.LayerNorm(24),
            *(nn.ELU(0.7), nn.Linear(24, 24)),
            *(nn.SiLU(), nn.Linear(24, 24, bias=False)),
            *(nn.LeakyReLU(), nn.Linear(24, 24)),
            *(nn.Softplus(), nn.Linear(24, 24)),
            *(nn.PReLU(24), nn.Linear(24, 24)),
            *(nn.Hardtanh(), nn.Linear(24, 8)),
            nn.Softmax(dim=-1),
        )
        norm: Any = self.layers[0]
        norm.running_mean += torch.linspace(-1.0, 1.0, WIDTH + 1)
        norm.running_var *= torch.linspace(0.5, 2.0, WIDTH + 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = torch.cat([x[:, 3:], (x[:, :1] * x[:, 1:2]), x[:, :3].clamp(-0.5, 0.5)], dim=1)
        return self.layers(y)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_c_answers_as_onnx_runtime_does(tmp_path: Path) -> None:
    file = written(_Everything(), tmp_path / "it.onnx")
    craft = load_spacecraft(THROTTLED)
    rows = observations()
    expected = judged(file, rows)
    assert expected.std(axis=0).min() > 1e-4
    np.testing.assert_allclose(by_c(file, craft, rows, tmp_path), expected, atol=1e-5)
    np.testing.assert_allclose(by_numpy(file, craft, rows), expected, atol=1e-5)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.parametrize("kind", ["box", "binary", "discrete"])
def test_sb3s_own_recipe_for_its_export(kind: str, tmp_path: Path) -> None:
    from gymnasium import spaces
    from stable_baselines3.common.policies import ActorCriticPolicy

    action = {
        "box": spaces.Box(0.0, 1.0, (8,)),
        "binary": spaces.MultiBinary(8),
        "discrete": spaces.MultiDiscrete([2] * 8),
    }[kind]
    torch.manual_seed(1)
    policy = ActorCriticPolicy(spaces.Box(-10.0, 10.0, (WIDTH,)), action, lambda _: 1e-3)
    last: Any = policy.action_net
    with torch.no_grad():  # so that commands differ
        last.weight *= 100.0

    class Onnxable(torch.nn.Module):
        """https://stable-baselines3.readthedocs.io/en/master/guide/export.html"""

        def __init__(self) -> None:
            super().__init__()
            self.policy = policy

        def forward(self, observation: torch.Tensor) -> tuple[torch.Tensor, ...]:
            return self.policy(observation, deterministic=True)

    file = written(Onnxable(), tmp_path / "sb3.onnx", batch="")
    craft = load_spacecraft(THROTTLED if kind == "box" else PLATFORM)
    rows = observations()
    expected = np.clip(judged(file, rows), 0.0, 1.0)  # thrusters take no more
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_allclose(by_c(file, craft, rows, tmp_path), expected, atol=1e-5)


def test_what_no_file_can_have_is_refused_by_operator_and_node(tmp_path: Path) -> None:
    craft = load_spacecraft(PLATFORM)

    class Recurrent(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.cell = torch.nn.LSTM(WIDTH, 8)

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return self.cell(x[None])[0][0]

    file = written(Recurrent(), tmp_path / "lstm.onnx", batch="")
    with pytest.raises(ConfigError, match=r"LSTM"):
        foreign_program(file, WIDTH, craft)

    # With an exponent that is observation 2: its number among the places is 2, too.
    file = written(Function(lambda x: x[:, :8] ** x[:, 2:3]), tmp_path / "power.onnx")
    with pytest.raises(ConfigError, match=r"Pow.*depend on the observation"):
        foreign_program(file, WIDTH, craft)
    file = written(torch.nn.Linear(WIDTH, 7), tmp_path / "few.onnx")
    with pytest.raises(ConfigError, match=r"7 numbers, but floating-platform takes 8"):
        foreign_program(file, WIDTH, craft)
    with pytest.raises(ConfigError, match="observes 10 numbers"):
        foreign_program(file, 12, craft)
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(file.read_bytes()[:100])
    with pytest.raises(ConfigError, match=r"broken\.onnx"):
        foreign_program(broken, WIDTH, craft)


@pytest.mark.parametrize(
    ("policy", "sentence"),
    [
        ("onnx:missing.onnx:go-to-pose-2d", "there is no file missing.onnx"),
        ("python:mine:act:go-to-pose-2d", "is no ONNX file"),
    ],
)
def test_a_policy_that_cannot_be_exported_is_a_sentence(
    policy: str, sentence: str, refused: Any
) -> None:
    assert sentence in refused(f"export {policy} --format c")


@pytest.mark.parametrize("approximate", ["none", "tanh"])
def test_gelu_as_one_operation_and_as_several(approximate: str, tmp_path: Path) -> None:
    """As exporters write it for version 20 of the operators; also far from zero, where it is zero or the input."""
    nodes = [
        step("Gelu", "observation", "units", approximate=approximate),
        step("Slice", "units first last axis", "command"),
    ]
    places: dict[str, Any] = {
        name: np.array([k]) for name, k in (("first", 0), ("last", 8), ("axis", 1))
    }
    ends = {"observation": ("N", WIDTH)}, {"command": ("N", 8)}
    file = tmp_path / "gelu.onnx"
    file.write_bytes(model_of(nodes, *ends, opset=20, **places))
    rows = np.linspace(-8.0, 8.0, 21 * WIDTH, dtype=np.float32).reshape(21, WIDTH)
    expected = np.clip(judged(file, rows), 0.0, 1.0)
    found = by_numpy(file, load_spacecraft(THROTTLED), rows)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert {0.0, 1.0} < {*np.round(expected.ravel(), 3)}
    # Torch writes several operations in its place: Erf among them, or those of the approximation.
    torch.manual_seed(0)
    layers = torch.nn.Sequential(torch.nn.Linear(WIDTH, 8), torch.nn.GELU(approximate))
    file = written(layers, tmp_path / "layers.onnx")
    expected = np.clip(judged(file, observations()), 0.0, 1.0)
    found = by_numpy(file, load_spacecraft(THROTTLED), observations())
    np.testing.assert_allclose(found, expected, atol=1e-6)
    if shutil.which("cc"):
        found = by_c(file, load_spacecraft(THROTTLED), observations(), tmp_path)
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_an_answer_that_is_no_number_stays_so_for_the_watchdog(tmp_path: Path) -> None:
    file = written(Function(lambda x: torch.log(x[:, :8])), tmp_path / "root.onnx")
    rows = np.full((1, WIDTH), -1.0, np.float32)
    with np.errstate(invalid="ignore"):
        assert np.isnan(by_numpy(file, load_spacecraft(THROTTLED), rows)).all()


def test_truths_that_were_moved_count_as_numbers(tmp_path: Path) -> None:
    """A half of each of two comparisons: both are true in a quarter of the rows, which is 1 and not a half."""

    def halves(x: torch.Tensor) -> torch.Tensor:
        truths = x > 0.0
        half = 0.5 * (truths[:, :4].float() + truths[:, 4:8].float())
        return torch.cat([half, half], dim=1)

    file = written(Function(halves), tmp_path / "halves.onnx")
    rows = observations()
    expected = judged(file, rows)
    assert {*np.unique(expected)} == {0.0, 0.5, 1.0}
    np.testing.assert_array_equal(by_numpy(file, load_spacecraft(THROTTLED), rows), expected)


def test_whole_numbers_are_not_divided_and_columns_of_tables_not_chosen(tmp_path: Path) -> None:
    def digits(x: torch.Tensor) -> torch.Tensor:
        whole = x[:, :8].to(torch.int64)
        return torch.div(whole, 2, rounding_mode="trunc").float()

    def column(x: torch.Tensor) -> torch.Tensor:
        table = torch.arange(80.0).reshape(8, WIDTH)
        return table.index_select(1, x[:1].argmax(dim=1)).T

    craft = load_spacecraft(THROTTLED)
    file = written(Function(digits), tmp_path / "digits.onnx")
    with pytest.raises(ConfigError, match="is the operator Div, of whole numbers"):
        foreign_program(file, WIDTH, craft)
    file = written(Function(column), tmp_path / "column.onnx")
    with pytest.raises(ConfigError, match="is the operator Gather, which computes with the number"):
        foreign_program(file, WIDTH, craft)


@pytest.mark.slow
def test_the_folder_flies_as_its_contract_says(tmp_path: Path) -> None:
    spec = f"onnx:{TRAINERS / 'agents/sb3-sac.onnx'}:go-to-pose-2d@{THROTTLED}"
    folder = tmp_path / "sac"
    with pytest.warns(RansWarning, match=r"flown every 0\.1 s"):
        card = write_foreign_export(spec, folder, "numpy", episodes=16, margins=0)
    assert card["training"] is None
    about = json.loads((folder / "contract.json").read_text("utf-8"))
    assert about["control_period"] == 0.1
    assert about["task"] == "go-to-pose"
    assert "not known" in about["conditions"]["summary"]
    names = exported(folder)
    right, count = names["check"](folder / "golden.json")
    assert right == count > 0
    # Watchdogs stand around the network.
    agent = names["Agent"](folder / "agent.npz", folder / "contract.json")
    assert not agent.act(np.full(WIDTH, np.nan, np.float32)).any()
    with pytest.raises(ConfigError, match="not as sb3"):
        write_foreign_export(spec, tmp_path / "other", "sb3", episodes=16, margins=0)


def test_a_network_with_states_is_not_exported(tmp_path: Path) -> None:
    """As RSL-RL exports recurrent networks: the states go in beside the observation, and come out."""
    nodes = [
        step("Add", "obs h_in", "h_out"),
        step("Add", "obs c_in", "c_out"),
        step("Relu", "h_out", "actions"),
    ]
    inputs, outputs = (
        dict.fromkeys(names, (1, WIDTH))
        for names in (("obs", "h_in", "c_in"), ("actions", "h_out", "c_out"))
    )
    file = tmp_path / "memory.onnx"
    file.write_bytes(model_of(nodes, inputs, outputs))
    with pytest.raises(ConfigError, match="3 inputs"):
        foreign_program(file, WIDTH, load_spacecraft(PLATFORM))
