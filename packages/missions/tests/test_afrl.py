"""Docking networks of AFRL: what they observe and command, with a network whose weights are written down here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_missions.afrl import docking
from rans_missions.tasks import Dock, Hold

from rans.errors import ConfigError
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft

onnx = pytest.importorskip("onnx")
CRAFT = load_spacecraft("afrl-deputy")
TASK = Dock()
TIMING = replace(TASK.timing, control_period=1.0, checks=1)
P = np.array([[30.0, -40.0, 120.0]])
V = np.array([[0.3, -0.4, 0.0]])


def _written(file: Path, columns: tuple[int, ...], outputs: int = 6, factor: float = 1.0) -> Path:
    """A linear network whose outputs 0, 2 and 4 are columns of the observation, and whose others are 9."""
    weights = np.zeros((8, outputs), np.float32)
    for k, column in enumerate(columns):
        weights[column, 2 * k] = factor
    bias = np.array([9.0 * (k % 2) for k in range(outputs)], np.float32)
    helper, real = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        [
            helper.make_node("Gemm", ["obs", "w", "b"], ["output"]),
            helper.make_node("Identity", ["state_ins"], ["state_outs"]),
        ],
        "network",
        [
            helper.make_tensor_value_info("obs", real, ["n", 8]),
            helper.make_tensor_value_info("state_ins", real, ["n"]),
        ],
        [
            helper.make_tensor_value_info("output", real, ["n", outputs]),
            helper.make_tensor_value_info("state_outs", real, ["n"]),
        ],
        [onnx.numpy_helper.from_array(weights, "w"), onnx.numpy_helper.from_array(bias, "b")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, file)
    return file


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ((0, 1, 2), (0.3, -0.4, 1.0)),  # position over 100 m; 1.2 is clipped to 1 N
        ((3, 4, 5), (0.6, -0.8, 0.0)),  # velocity over 0.5 m/s
        # Speed 0.5 m/s; the limit 0.2 + 2 x 0.001027 x (130 - 0.5) by hand.
        ((6, 7, 5), (0.5, 0.4659930, 0.0)),
    ],
)
def test_a_network_observes_what_its_own_simulation_gave_it(
    tmp_path: Path, columns: tuple[int, ...], expected: tuple[float, ...]
) -> None:
    network = docking(_written(tmp_path / "n.onnx", columns))(CRAFT, TASK, TIMING)
    np.testing.assert_allclose(network.forces(P, V)[0], expected, atol=1e-6)


def test_forces_are_commands_of_the_thrusters_that_push_that_way(tmp_path: Path) -> None:
    network = docking(_written(tmp_path / "n.onnx", (0, 1, 2), factor=0.5))(CRAFT, TASK, TIMING)
    state = SpatialState(Vec3(*P.T), Quat(1.0, 0.0, 0.0, 0.0), Vec3(*V.T), Vec3(0.0, 0.0, 0.0))
    (commands,) = network.act(state, state, np.zeros((1, 0)))
    force = sum(
        c * t.force * np.array(t.direction) for c, t in zip(commands, CRAFT.thrusters, strict=True)
    )
    np.testing.assert_allclose(force, (0.15, -0.2, 0.6), atol=1e-6)


def test_other_tasks_and_networks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="flies dock, got Hold"):
        docking(_written(tmp_path / "n.onnx", (0, 1, 2)))(CRAFT, Hold(), TIMING)
    with pytest.raises(ConfigError, match="gives \\[8\\]"):
        docking(_written(tmp_path / "m.onnx", (0, 1, 2), outputs=8))(CRAFT, TASK, TIMING)
    with pytest.raises(ConfigError, match="there is no file"):
        docking(tmp_path / "none.onnx")(CRAFT, TASK, TIMING)
    (tmp_path / "text.onnx").write_text("no network", "utf-8")
    with pytest.raises(ConfigError, match="no ONNX network"):
        docking(tmp_path / "text.onnx")(CRAFT, TASK, TIMING)
