"""Controllers in the drift of their task: against SciPy's integrator, and against the engine's own step."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rans.episode import Setup, World, step
from rans.evaluation.measure.metrics import settling_times
from rans.flight import fly
from rans.model.coordinates import around
from rans.model.drift import FREE, ClohessyWiltshire, Drift, UniformGravity, step_goal
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.lqr import LQR
from rans.optimal.control.mpc import MPC, shortest
from rans.optimal.control.regulator import Deadband
from rans.optimal.control.switching import Switching
from rans.scenario import scenarios
from rans.tasks import GoToPose, GoToPosition, Task
from tests.support.clohessy_wiltshire import orbit
from tests.support.crafts import deputy

PLATFORM = load_spacecraft("floating-platform")
FLYER = load_spacecraft("free-flyer")
ORBIT = ClohessyWiltshire(0.05)
"""Forty times as fast as a low orbit, so that the drift matters within a minute."""
SLOPE = UniformGravity((0.05, -0.08))
"""A floor that is tilted by half a degree."""


@dataclass(frozen=True)
class Pose(GoToPose):
    """In a drift."""

    pulled: Drift = FREE

    def __post_init__(self) -> None:
        """Settings may be anything."""

    @property
    def drift(self) -> Drift:
        return self.pulled


@dataclass(frozen=True)
class Place(GoToPosition):
    """In a drift; the goal may be anywhere, and moves as free points do."""

    pulled: Drift = FREE
    aside: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Of the goal from the origin, m."""

    def __post_init__(self) -> None:
        """Settings may be anything."""

    @property
    def drift(self) -> Drift:
        return self.pulled

    def sample(self, random: Any) -> tuple[Any, Any]:
        start, goal = super().sample(random)
        aside = type(goal.p)(*self.aside[: len(goal.p.columns())])
        return replace(start, p=start.p + aside), replace(goal, p=goal.p + aside)


@dataclass(frozen=True)
class Chase(Place):
    """The goal moves as free points do."""

    def later(self, goal: Any, time: Any) -> Any:
        return step_goal(goal, self.drift, time)


def integrated(
    controller: Any, craft: Spacecraft, start: Any, goal: Any, period: float, steps: int
) -> np.ndarray:
    """Positions (steps + 1, 3) of a craft that keeps its attitude under its controller, by SciPy alone."""
    w, x, y, z = (float(number[0]) for number in leaves(start.attitude))
    axes = Rotation.from_quat([x, y, z, w])
    controller.reset(1)
    state = start
    path = [np.array(leaves(start.p))[:, 0]]
    for _ in range(steps):
        commands = controller.act(state, goal, np.zeros((1, 0)))[0]
        push = axes.apply(commands @ np.array(craft.wrench_map)[:, :3] / craft.mass)
        end = solve_ivp(
            lambda _, x, push=push: orbit(0.05) @ x + [0.0, 0.0, 0.0, *push],
            (0.0, period),
            np.array([*leaves(state.p), *leaves(state.v)])[:, 0],
            method="DOP853",
            rtol=1e-11,
            atol=1e-12,
        ).y[:, -1]
        p, v = (type(state.p)(*half.reshape(3, 1)) for half in (end[:3], end[3:]))
        state = replace(state, p=p, v=v)
        path.append(end[:3])
    return np.array(path)


@pytest.mark.parametrize(
    "kind", [LQR, pytest.param(MPC, marks=pytest.mark.slow)], ids=lambda kind: kind.name
)
def test_a_throttled_craft_settles_in_an_independent_model_of_its_orbit(kind: Any) -> None:
    """Its goal is 8 m out along the orbit's radius, where nothing stays by itself: staying takes
    3 n^2 x = 0.06 m/s^2 of the 0.083 that it has. It is turned, as it was drawn."""
    craft = deputy()
    task = Place(pulled=ORBIT, aside=(8.0, 0.0, 0.0), spawn_distance=(1.0, 2.0))
    timing = Timing(control_period=0.5)
    starts = scenarios(task, craft, 3, 1)
    restless = kind(craft, task, timing, deadband=Deadband(share=0.0))
    path = integrated(restless, craft, starts.start, starts.goal, 0.5, 120)
    gaps = np.linalg.norm(path - [8.0, 0.0, 0.0], axis=1)
    assert gaps[0] > 0.9
    assert gaps[-20:].max() < 1e-3


@pytest.mark.parametrize("craft", [PLATFORM, FLYER], ids=lambda craft: craft.name)
@pytest.mark.parametrize("chased", [False, True])
def test_the_mpcs_prediction_is_the_engines_step(craft: Spacecraft, chased: bool) -> None:
    """In float64, of a goal that stands still and of one that drifts; in space the engine steps more finely."""
    task = (Chase if chased else Place)(pulled=ORBIT, aside=(2.0, -1.0, 0.5))
    timing = Timing(substeps=1)
    world = World(Setup(craft, task, timing))
    starts = scenarios(task, craft, 4, 5)
    start = replace(starts.start, v=starts.start.p.scale(0.1))
    commands = np.random.default_rng(0).uniform(size=(5, len(craft.thrusters)))
    outcome = step(world, world.begin(start, starts.goal), tuple(commands.T))
    controller = MPC(craft, task, timing)
    goals = controller._goals(start, starts.goal)
    errors = shortest(start, starts.goal)
    linearised = controller._program._linearised
    plan = np.zeros((len(craft.thrusters), controller._settings.horizon))
    for k in range(5):
        plan[:, 0] = commands[k]
        predicted = np.array(linearised(errors[:, k], plan, goals[:, :, k])[0])[:, 0]
        goal = map_leaves(lambda x, k=k: np.asarray(x)[k], outcome.episode.goal)
        there = around(goal, predicted)
        engine = map_leaves(lambda x, k=k: np.asarray(x)[k], outcome.episode.state)
        np.testing.assert_allclose(leaves(there.p), leaves(engine.p), rtol=0, atol=1e-12)
        np.testing.assert_allclose(leaves(there.v), leaves(engine.v), rtol=0, atol=1e-12)


KINDS = (LQR, MPC, Switching)


@pytest.mark.parametrize(
    ("kind", "drift"), [*zip(KINDS, itertools.cycle((ORBIT, SLOPE)), strict=False)], ids=str
)
def test_every_controller_settles_in_a_drift(kind: Any, drift: Drift) -> None:
    """On/off, from 3 to 4 m, to a pose; free flight's plans miss it, which the test after this one shows."""
    task = Pose(pulled=drift).for_evaluation()
    timing = Timing(episode_steps=75 if kind is MPC else 125)
    starts = scenarios(task, PLATFORM, 6, 2)
    flight = fly(PLATFORM, task, kind(PLATFORM, task, timing), starts, timing)
    assert np.isfinite(settling_times(flight)).all()


def test_a_controller_of_free_flight_does_not_hold_a_slope() -> None:
    """The oracle of the test before: gravity is felt, and the LQR without feed-forward rests beside the goal."""
    task = Pose(pulled=UniformGravity((0.1, -0.2))).for_evaluation()
    timing = Timing()
    starts = scenarios(task, PLATFORM, 6, 4)
    knows, guesses = (
        fly(
            PLATFORM,
            task,
            LQR(PLATFORM, known, timing, deadband=Deadband(share=0.0)),
            starts,
            timing,
        )
        for known in (task, Pose().for_evaluation())
    )
    assert knows.errors()["position"][-25:].mean() < 0.03
    assert guesses.errors()["position"][-25:].mean() > 0.1


@pytest.mark.parametrize("kind", [LQR, Switching, MPC], ids=lambda kind: kind.name)
def test_a_goal_that_drifts_is_followed(kind: Any) -> None:
    """It goes round a moving ellipse of the orbit, up to 0.2 m/s fast."""
    task: Task = Chase(pulled=ORBIT, aside=(1.0, 0.0, 0.0), spawn_distance=(2.0, 3.0))
    timing = Timing(episode_steps=60)
    starts = scenarios(task, PLATFORM, 7, 2)
    flight = fly(PLATFORM, task, kind(PLATFORM, task, timing), starts, timing)
    moved = (
        map_leaves(lambda x: x[-1], flight.goals).p - map_leaves(lambda x: x[0], flight.goals).p
    ).norm()
    assert moved.min() > 0.3
    assert flight.errors()["position"][-10:].max() < 0.1
