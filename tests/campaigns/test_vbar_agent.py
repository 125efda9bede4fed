"""The network that flies V-BAR's scenarios, and the points that the campaign gives it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import onnxruntime
import pytest
import scipy.linalg
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from campaigns import vbar_agent

N = 0.0011
PERIOD = 10.0


def motion_rate() -> np.ndarray:
    """Rates of position, velocity and acceleration (constant) in Clohessy-Wiltshire motion, (9, 9)."""
    rate = np.zeros((9, 9))
    rate[:3, 3:6] = np.eye(3)
    rate[3:6, :3] = np.diag([3.0 * N * N, 0.0, -N * N])
    rate[3, 4] = 2.0 * N
    rate[4, 3] = -2.0 * N
    rate[3:6, 6:] = np.eye(3)
    return rate


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Clohessy-Wiltshire motion over a period by SciPy: of a state, and of an acceleration."""
    whole = scipy.linalg.expm(motion_rate() * PERIOD)
    return whole[:6, :6], whole[:6, 6:]


def test_onnx_runtime_and_torch_answer_alike(tmp_path: Path) -> None:
    torch.manual_seed(4)
    network = vbar_agent.Network()
    vbar_agent.export(network, tmp_path / "agent.onnx")
    rows = np.random.default_rng(1).normal(size=(500, vbar_agent.INPUTS)).astype(np.float32)
    rows *= np.array([100.0, 0.3, 1e-3, 100.0, 0.3], np.float32)
    session = onnxruntime.InferenceSession(str(tmp_path / "agent.onnx"))
    with torch.no_grad():
        ours = network(torch.tensor(rows)).numpy()
    answers: Any = session.run(None, {"observation": rows})[0]
    theirs = answers[:, 0]
    # Sums of some ten products in single precision.
    np.testing.assert_allclose(theirs, ours, atol=1e-5)
    assert np.abs(theirs).max() <= 1.0


@pytest.mark.parametrize(
    "start", [(300.0, 20.0, -40.0), (-5.0, 260.0, 10.0), (20.0, -400.0, 100.0)]
)
def test_the_network_flies_around_the_ball_to_a_point_and_stays(start: tuple[float, ...]) -> None:
    """Judged by SciPy's motion: V-BAR's approach-vbar without V-BAR."""
    point = (0.0, -100.0, 0.0)
    view: Any = SimpleNamespace(
        n=N,
        dt=PERIOD,
        max_accel=0.02,
        scenario_id="approach",
        goal={"task": "hold", "hold_point": point, "target": {}},
        constraints=(
            {"type": "keep_out", "radius": 50.0},
            {"type": "closing_speed_limit", "v0": 0.2, "v1": 0.0044},
        ),
    )
    agent = vbar_agent.Agent()
    agent.reset(view)
    state = np.array([*start, 0.0, 0.0, 0.0])
    carry, push = motion()
    states = []
    for step in range(360):
        command = agent.act(state, {"time_s": step * PERIOD})
        assert np.abs(command).max() <= 1.0
        state = carry @ state + push @ (command * view.max_accel)
        states.append(state)
    flown = np.array(states)
    assert np.linalg.norm(flown[:, :3], axis=1).min() > 50.0
    away = np.linalg.norm(flown[-60:, :3] - point, axis=1)
    assert away.max() < 5.0
    assert np.linalg.norm(flown[-60:, 3:], axis=1).max() < 0.05


@settings(max_examples=25)
@given(
    st.floats(0.0, 2.0 * np.pi),
    st.floats(-1.2, 1.2),
    st.floats(90.0, 600.0),
    st.sampled_from([(0.0, -100.0, 0.0), (-100.0, 0.0, 0.0), (0.0, 0.0, -100.0)]),
)
def test_who_goes_to_the_next_point_comes_around_the_ball(
    turn: float, rise: float, away: float, point: tuple[float, ...]
) -> None:
    place = away * np.array(
        [np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)]
    )
    goal = np.array(point)
    for _ in range(2000):
        line = vbar_agent.beside(place, goal, 65.0) - place
        left = float(np.linalg.norm(line))
        if left < 1.0:
            break
        place = place + line / left
        assert np.linalg.norm(place) > 50.0
    np.testing.assert_allclose(place, goal, atol=1.0)


def test_the_network_reads_the_motion_in_the_frame_that_turns_with_the_port() -> None:
    """Its velocity changes by its natural acceleration: judged by SciPy's motion, turned back."""
    rate = -N
    view: Any = SimpleNamespace(n=N, dt=PERIOD, max_accel=0.02)
    rows: list[np.ndarray] = []

    def answer(inputs: np.ndarray) -> np.ndarray:
        rows.append(inputs)
        return np.zeros(3)

    leg = vbar_agent.Learned(view, answer, lambda s, t: np.zeros(3), lambda s, t: 1.0, rate=rate)
    state = np.array([3.0, -20.0, 5.0, -0.02, 0.05, 0.01])
    short = 1e-3
    carry = scipy.linalg.expm(short * motion_rate()[:6, :6])
    leg.change(state, 0.0)
    leg.change(carry @ state, short)
    (before, after) = (one[:, 1] for one in rows)
    turned_back = Rotation.from_rotvec([0.0, 0.0, -rate * short]).apply(after)
    # The rate of a change is rounded to 1e-14, and the acceleration changes by 1e-7 m/s^3.
    np.testing.assert_allclose((turned_back - before) / short, rows[0][:, 2], atol=1e-9)


def test_the_network_says_what_it_does_not_fly() -> None:
    view: Any = SimpleNamespace(scenario_id="inspection", goal={"task": "inspect"}, constraints=())
    with pytest.raises(ValueError, match="flies no inspection"):
        vbar_agent.Agent().reset(view)
