"""Networks of AFRL: what they observe and command, with networks whose weights are written down here."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rans_missions.afrl import clusters, docking, inspection
from rans_missions.tasks import Dock, Hold, Inspect

from rans.errors import ConfigError
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios
from tests.support.graphs import model_of, step

onnx = pytest.importorskip("onnx")
CRAFT = load_spacecraft("afrl-deputy")
TASK = Dock()
TIMING = replace(TASK.timing, control_period=1.0, checks=1)
P = np.array([[30.0, -40.0, 120.0]])
V = np.array([[0.3, -0.4, 0.0]])


def _written(
    file: Path, columns: tuple[int, ...], outputs: int = 6, factor: float = 1.0, width: int = 8
) -> Path:
    """A linear network whose outputs 0, 2 and 4 are columns of the observation, and whose others are 9."""
    weights = np.zeros((width, outputs), np.float32)
    for k, column in enumerate(columns):
        weights[column, 2 * k] = factor
    bias = np.array([9.0 * (k % 2) for k in range(outputs)], np.float32)
    nodes = [step("Gemm", "obs w b", "output"), step("Identity", "state_ins", "state_outs")]
    inputs = {"obs": ("n", width), "state_ins": ("n",)}
    ends = {"output": ("n", outputs), "state_outs": ("n",)}
    file.write_bytes(model_of(nodes, inputs, ends, w=weights, b=bias))
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
    with pytest.raises(ConfigError, match="flies Dock, got Hold"):
        docking(_written(tmp_path / "n.onnx", (0, 1, 2)))(CRAFT, Hold(), TIMING)
    with pytest.raises(ConfigError, match="gives \\[8\\]"):
        docking(_written(tmp_path / "m.onnx", (0, 1, 2), outputs=8))(CRAFT, TASK, TIMING)
    with pytest.raises(ConfigError, match="there is no file"):
        docking(tmp_path / "none.onnx")(CRAFT, TASK, TIMING)
    (tmp_path / "text.onnx").write_text("no network", "utf-8")
    with pytest.raises(ConfigError, match="no ONNX network"):
        docking(tmp_path / "text.onnx")(CRAFT, TASK, TIMING)
    with pytest.raises(ConfigError, match="flies Inspect, got Dock"):
        inspection(_written(tmp_path / "i.onnx", (0, 1, 2), width=11))(CRAFT, TASK, TIMING)
    with pytest.raises(ConfigError, match="11 or 15"):
        inspection(tmp_path / "n.onnx")(CRAFT, Inspect(), TIMING)


def _inspects(
    file: Path, columns: tuple[int, ...], width: int, sun: float, seen: tuple[float, ...]
) -> np.ndarray:
    """Forces, N, at `P` and `V` with the sun at an angle and points inspected, by words of 20 bits."""
    task = Inspect()
    network = inspection(
        _written(file, columns, factor=0.1, width=width), priority=(0.0, 0.0, 2.0)
    )(CRAFT, task, TIMING)
    goal = scenarios(task, CRAFT, 0, 1).goal
    count = sum(bin(int(word)).count("1") for word in seen)
    notes = replace(
        goal.notes,
        sun=np.array([sun]),
        count=np.array([float(count)]),
        words=tuple(np.array([word]) for word in seen),
    )
    network.reset(1)
    state = SpatialState(Vec3(*P.T), Quat(1.0, 0.0, 0.0, 0.0), Vec3(*V.T), Vec3(0.0, 0.0, 0.0))
    (commands,) = network.act(state, replace(goal, notes=notes), np.zeros((1, 0)))
    directions = np.array([t.force * np.array(t.direction) for t in CRAFT.thrusters])
    return np.asarray(commands) @ directions


_ALL = 2.0**20 - 1.0


@pytest.mark.parametrize(
    ("columns", "width", "sun", "seen", "expected"),
    [
        (
            (0, 4, 2),
            11,
            0.0,
            (0.0,) * 5,
            (0.03, -0.08, 0.12),
        ),  # 0.3 m, -0.4 m/s and 120 m over their norms
        # The source's sun is at (cos, -sin): ours at 0.4 rad is theirs at 2 pi - 0.4. Two points of 100 are seen.
        ((6, 10, 10), 11, 0.4, (3.0, 0.0, 0.0, 0.0, 0.0), (0.002, 0.58831853, 0.58831853)),
        # Point 0 alone is left. Its height is 0.99 and its azimuth 0; the sun along x lights it.
        ((7, 8, 9), 11, 0.0, (_ALL - 1.0, _ALL, _ALL, _ALL, _ALL), (0.01410674, 0.0, 0.099)),
        # With the sun along -x it is dark, so that no cluster is left to go to.
        ((7, 8, 9), 11, np.pi, (_ALL - 1.0, _ALL, _ALL, _ALL, _ALL), (0.0, 0.0, 0.0)),
        # Priority is a unit vector, and all points have been seen: their weight is 1.
        ((11, 13, 14), 15, 0.0, (_ALL,) * 5, (0.0, 0.1, 0.1)),
    ],
)
def test_an_inspection_network_observes_points_and_sun_as_in_its_own_simulation(
    tmp_path: Path,
    columns: tuple[int, ...],
    width: int,
    sun: float,
    seen: tuple[float, ...],
    expected: tuple[float, ...],
) -> None:
    force = _inspects(tmp_path / "n.onnx", columns, width, sun, seen)
    np.testing.assert_allclose(force, expected, atol=1e-6)


def test_the_point_opposite_to_priority_weighs_least(tmp_path: Path) -> None:
    # Point 0 is 8.1 degrees from the priority, and point 99 171.9 degrees: weights as 171.9 to 8.1.
    first = _inspects(tmp_path / "n.onnx", (14, 14, 14), 15, 0.0, (1.0, 0.0, 0.0, 0.0, 0.0))
    last = _inspects(tmp_path / "n.onnx", (14, 14, 14), 15, 0.0, (0.0,) * 4 + (2.0**19,))
    assert first[0] / last[0] == pytest.approx(171.8903 / 8.1097, rel=1e-4)


def test_clusters_are_where_points_are_apart() -> None:
    # Three groups far apart; the first centres are all at the origin, as in the source.
    middles = np.array([[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, -10.0]])
    spread = np.random.default_rng(3).normal(scale=0.1, size=(3, 10, 3))
    points = (middles[:, None] + spread).reshape(-1, 3)
    centres = clusters(points, np.zeros((0, 3)))
    means = (middles[:, None] + spread).mean(axis=1)
    order = [int(np.argmin(np.linalg.norm(centres - mean, axis=1))) for mean in means]
    np.testing.assert_allclose(centres[order], means, atol=1e-12)
    # Fewer points are left: the first centres of before are kept, each beside its own points.
    kept = clusters(points[:20], centres[order])
    np.testing.assert_allclose(kept, means[:2], atol=1e-12)
