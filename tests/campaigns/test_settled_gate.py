"""The settled-gate benchmark: its faults, starts, motion and oracles, and our entry at a small size."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from campaigns import settled_gate
from campaigns.settled_gate import (
    CLASSES,
    MOMENTS,
    Faults,
    Oracle,
    applied,
    battery,
    held_out,
    settled,
    starts,
    turns,
)
from campaigns.settled_gate_agent import Agent, Axes
from campaigns.settled_gate_entry import AGENT, Fly, ThreeAxes, sound
from rans.flight import fly
from rans.model.fields import Quat, Vec3, leaves, map_leaves
from rans.model.timing import Timing
from rans.reference.flight import fly_in_drake
from rans.scenario import Scenario


def test_faults_are_outside_of_what_training_may_know() -> None:
    for kind in CLASSES:
        found = held_out(kind)
        assert (((found.inertia >= 0.7) & (found.inertia < 0.8)) | (found.inertia > 2.0)).all()
        assert found.inertia.max() < 2.3
        lost = found.gain == 0.0
        assert (lost.sum(axis=1) == (kind == "axis lost")).all()
        assert ((found.gain < 0).sum(axis=1) + lost.sum(axis=1) >= 2).all()
        size = np.abs(found.gain[~lost])
        assert ((size == 1.0) if kind == "sign" else ((size < 0.5) | (size > 1.5))).all()
        bias = np.abs(found.bias)
        assert ((bias >= 0.2) & (bias <= 0.3)).all() if kind == "gain and bias" else not bias.any()


def test_starts_are_the_benchmarks_own_of_a_seed() -> None:
    """Worked from its description with SciPy: an axis, the tangent of a quarter of the angle, three rates."""
    begun: Any = starts([0, 3]).start
    for k, seed in enumerate((0, 3)):
        rng = np.random.default_rng(seed)
        axis = rng.normal(size=3)
        size = rng.uniform(0.0, 0.3)
        spin = rng.uniform(-0.05, 0.05, 3)
        angle = 4 * np.arctan(size)
        expected = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_quat(
            scalar_first=True
        )
        np.testing.assert_allclose(
            [x[k] for x in (begun.attitude.w, *_vector(begun.attitude))], expected
        )
        np.testing.assert_allclose([x[k] for x in begun.w.columns()], spin)


def _vector(q: Any) -> tuple[Any, ...]:
    return q.x, q.y, q.z


def test_a_faulty_torque_by_hand() -> None:
    """0.5 asked of a gain of -0.4 and a bias of 0.3 gives 0.1; 1 of 2 is 1; -1 of 1.5, and 0.2, is -1."""
    told = np.array([[0.7, 0.2, 1.0, 0.0, 0.0, 1.0]])
    done = applied(told, np.array([[-0.4, 2.0, 1.5]]), np.array([[0.3, 0.0, 0.2]]))
    np.testing.assert_allclose(done, [[0.1, 0.0, 1.0, 0.0, 0.0, 1.0]], atol=1e-15)


class Recorded:
    """A controller that keeps what it saw and told."""

    name = "recorded"

    def __init__(self, controller: Any) -> None:
        self._controller = controller
        self.states = []
        self.told = []

    def reset(self, count: int) -> None:
        self._controller.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self.states.append(state)
        self.told.append(self._controller.act(state, goal, observation))
        return self.told[-1]


def short(monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
    monkeypatch.setattr(settled_gate, "TIMING", Timing(0.5, episode_steps=steps))


def test_bodies_turn_as_eulers_equations_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """A period of torque 0.2 clip(g a + b) about each axis, against DOP853, to 1e-9."""
    short(monkeypatch, 8)
    faults, begun = battery("gain and bias", 3, 2)
    watch = Recorded(Oracle(faults, "", knows_bias=True))
    settled(watch, faults, begun)
    for (before, after), told in zip(pairwise(watch.states), watch.told, strict=False):
        for k in (0, 5):
            torque = 0.2 * np.clip(
                faults.gain[k] * (told[k, ::2] - told[k, 1::2]) + faults.bias[k], -1, 1
            )
            moments = np.array(MOMENTS) * faults.inertia[k]

            def rate(
                _: float, w: np.ndarray, torque: Any = torque, moments: Any = moments
            ) -> np.ndarray:
                return (torque - np.cross(w, moments * w)) / moments

            spin = [x[k] for x in before.w.columns()]
            moved = solve_ivp(rate, (0.0, 0.5), spin, method="DOP853", rtol=1e-12, atol=1e-14).y[
                :, -1
            ]
            np.testing.assert_allclose([x[k] for x in after.w.columns()], moved, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("knows", "published"),
    [("nothing", (0, 0, 0, 0)), ("gain", (1, 1, 0, 0)), ("gain and bias", (1, 1, 1, 0))],
)
def test_oracles_settle_where_they_do_in_the_benchmark(
    knows: str, published: tuple[int, ...]
) -> None:
    """Of the first eight faults and a start; of all 500, with all known, 95.8 % settle there and here."""
    each = [held_out(kind, 8) for kind in CLASSES]
    faults = Faults(*(np.concatenate(parts) for parts in zip(*each, strict=True)))
    known = sound(faults) if knows == "nothing" else faults
    one = Oracle(known, knows, knows_bias=knows == "gain and bias")
    found = settled(one, faults, starts([0] * 32)).reshape(4, 8).mean(axis=1)
    np.testing.assert_allclose(found, published, atol=0.2)


def test_drake_turns_them_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """To 1e-9, as of every motion; it goes on as it began, so 20 s do."""
    short(monkeypatch, 40)
    faults, begun = battery("gain and bias", 2, 1)
    flights = [Recorded(Oracle(faults, "", knows_bias=True)) for _ in range(2)]
    for watch, move in zip(flights, (fly, fly_in_drake), strict=True):
        settled(watch, faults, begun, move)
    ours, drakes = (
        np.array([leaves(state)[3:7] + leaves(state)[10:13] for state in watch.states])
        for watch in flights
    )
    np.testing.assert_allclose(drakes, ours, rtol=0, atol=1e-9)


def test_turns_are_rotation_vectors() -> None:
    begun: Any = starts(range(5))
    expected = Rotation.from_quat(
        np.array([begun.start.attitude.w, *_vector(begun.start.attitude)]).T, scalar_first=True
    ).as_rotvec()
    np.testing.assert_allclose(turns(begun.start, begun.goal).T, expected, atol=1e-12)
    flipped = map_leaves(lambda x: -x, begun.start.attitude)
    again: Any = begun.start.__class__(begun.start.p, flipped, begun.start.v, begun.start.w)
    np.testing.assert_allclose(turns(again, begun.goal).T, expected, atol=1e-12)


def test_an_axis_moves_as_a_body_that_turns_about_it_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 s about the second axis from 0.4 rad, in space by the equations of every flight."""
    short(monkeypatch, 40)
    faults = Faults(np.array([1.3]), np.array([[1.0, -1.4, 1.0]]), np.array([[0.0, 0.15, 0.0]]))
    zero = np.zeros(1)
    one = np.ones(1)
    still: Any = starts([0]).goal
    begun = replace(
        still,
        attitude=Quat(np.cos(0.2) * one, zero, np.sin(0.2) * one, zero),
        w=Vec3(zero, 0.03 * one, zero),
    )
    watch = Recorded(Wavering())
    settled(watch, faults, Scenario(begun, still))
    axes = Axes(*torch.tensor([[1.3 * MOMENTS[1]], [-1.4], [0.15]], dtype=torch.float64))
    angle, spin = torch.tensor([[0.4], [0.03]], dtype=torch.float64)
    for state, told in zip(watch.states, watch.told, strict=True):
        assert turns(state, still)[1, 0] == pytest.approx(float(angle), abs=1e-9)
        assert state.w.y[0] == pytest.approx(float(spin), abs=1e-9)
        angle, spin = axes.move(angle, spin, torch.tensor([told[0, 2] - told[0, 3]]))


class Wavering:
    """Turns about the second axis to and fro, beyond what a torque can."""

    name = "wavering"

    def reset(self, count: int) -> None:
        self._period = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        self._period += 1
        return settled_gate.nozzles(np.array([[0.0, np.sin(self._period), 0.0]]))


def test_our_entry_sees_each_axis_alone() -> None:
    """What happens to the first axis changes what it is told, and nothing for the others."""
    torch.manual_seed(0)
    agent = Agent()
    begun = starts(range(4))
    told = []
    for push in (0.0, 0.3):
        one = ThreeAxes(agent)
        now = begun.start
        one.reset(4)
        first = one.act(now, begun.goal, np.zeros((4, 0)))
        np.testing.assert_allclose(first, [[0.2, 0.0] * 3] * 4, rtol=1e-6)
        later = replace(now, w=replace(now.w, x=now.w.x + push))
        told.append(one.act(later, begun.goal, np.zeros((4, 0))))
    assert told[0].shape == (4, 6)
    assert (told[0][:, :2] != told[1][:, :2]).any(axis=1).all()
    np.testing.assert_array_equal(told[0][:, 2:], told[1][:, 2:])


@pytest.mark.slow
def test_an_agent_flies_from_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    short(monkeypatch, 20)
    save_file(Agent().state_dict(), tmp_path / AGENT)
    found = Fly((tmp_path,), faults=1, seeds=2).measured()["settled"]
    assert tuple(found[str(tmp_path)]) == CLASSES


@pytest.mark.slow
def test_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    short(monkeypatch, 20)
    found = Fly(faults=1, seeds=2).measured()["settled"]
    assert list(found) == ["proportional-derivative", "gain oracle", "gain and bias oracle"]
    assert all(tuple(row) == CLASSES for row in found.values())
    assert found["gain oracle"]["sign"]["value"] == 0.0  # 10 s are too short to turn
