"""Guidance by the velocity to gain: it arrives in SciPy's model, in time, and spends what a linear program does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from rans_missions.control.guidance import VelocityToGain
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from rans.evaluation.measure.metrics import impulses
from rans.flight import fly
from rans.model.drift import FREE, ClohessyWiltshire, Drift, step_goal
from rans.model.fields import leaves, map_leaves
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.regulator import Deadband
from rans.optimal.trajectory.allocation import Allocation
from rans.scenario import Scenario, scenarios
from rans.tasks import GoToPosition
from tests.support.clohessy_wiltshire import orbit
from tests.support.crafts import deputy

MEAN_MOTION = 0.001027
"""rad/s, that of AFRL's docking environment."""
ORBIT = ClohessyWiltshire(MEAN_MOTION)
RESTLESS = Deadband(share=0.0)
PLATFORM = load_spacecraft("floating-platform")
SLOW = Timing(control_period=10.0, episode_steps=100)


@dataclass(frozen=True)
class Place(GoToPosition):
    """A place in a drift, 100 to 150 m away."""

    pulled: Drift = ORBIT
    chased: bool = False

    def __post_init__(self) -> None:
        """Settings may be anything."""

    @property
    def drift(self) -> Drift:
        return self.pulled

    def later(self, goal: Any, time: Any) -> Any:
        return step_goal(goal, self.drift, time) if self.chased else goal


FAR = Place(spawn_distance=(100.0, 150.0), fail_distance=1e6)


def axes(starts: Scenario, k: int) -> np.ndarray:
    """Axes of B in W as columns, (3, 3)."""
    attitude = np.array(leaves(starts.start.attitude))[:, k]
    return Rotation.from_quat(np.roll(attitude, -1)).as_matrix()


def least_impulse(starts: Scenario, k: int, periods: int, rows: slice) -> float:
    """N s: a linear program over all commands of the deputy held for 10 s, by SciPy's exponentials."""
    held = np.zeros((9, 9))
    held[:6, :6] = orbit(MEAN_MOTION)
    held[3:6, 6:] = axes(starts, k) / 12.0
    one = expm(10.0 * held)
    effects = [one[:6, 6:]]
    for _ in range(periods - 1):
        effects.insert(0, one[:6, :6] @ effects[0])
    begin = np.array([*leaves(starts.start.p), *leaves(starts.start.v)])[:, k]
    coasted = np.linalg.matrix_power(one[:6, :6], periods) @ begin
    matrix = np.hstack(effects)
    found = linprog(
        np.full(2 * matrix.shape[1], 10.0),
        A_eq=np.hstack([matrix, -matrix])[rows],
        b_eq=-coasted[rows],
        bounds=(0.0, 1.0),
    )
    assert found.success
    return float(found.fun)


@pytest.mark.slow
@pytest.mark.parametrize("stop", [True, False])
@pytest.mark.parametrize("periods", [50, 100])
def test_spends_what_a_linear_program_spends(periods: int, stop: bool) -> None:
    """Two burns, or one, are within 3 % of all 50 or 100 together, start by start, and end at the goal."""
    craft = deputy()
    timing = replace(SLOW, episode_steps=periods)
    starts = scenarios(FAR, craft, 3, 4)
    pilot = VelocityToGain(craft, FAR, timing, 10.0 * periods, stop, RESTLESS)
    flight = fly(craft, FAR, pilot, starts, timing)
    assert flight.errors()["position"][-1].max() < 1e-4
    arrived = np.array(leaves(map_leaves(lambda x: x[-1], flight.states).v))
    assert (np.abs(arrived).max() < 1e-5) == stop
    rows = slice(0, 6 if stop else 3)
    least = [least_impulse(starts, k, periods, rows) for k in range(4)]
    ratios = impulses(flight) / least
    assert (ratios > 1.0 - 1e-4).all()
    assert ratios.max() < 1.03


def test_arrives_at_the_deadline_in_an_independent_model_of_the_orbit() -> None:
    """SciPy integrates the equations; the pilot sees its states only, and coasts in most periods."""
    craft = deputy()
    starts = scenarios(FAR, craft, 5, 1)
    pilot = VelocityToGain(craft, FAR, SLOW, 800.0, deadband=RESTLESS)
    pilot.reset(1)
    state = starts.start
    turned = axes(starts, 0)
    distances = []
    coasts = 0
    for _ in range(100):
        commands = pilot.act(state, starts.goal, np.zeros((1, 0)))[0]
        coasts += commands.sum() < 1e-3
        push = turned @ (commands @ np.array(craft.wrench_map)[:, :3]) / craft.mass
        end = solve_ivp(
            lambda _, x, push=push: orbit(MEAN_MOTION) @ x + [0.0, 0.0, 0.0, *push],
            (0.0, 10.0),
            np.array([*leaves(state.p), *leaves(state.v)])[:, 0],
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        ).y[:, -1]
        p, v = (type(state.p)(*half.reshape(3, 1)) for half in (end[:3], end[3:]))
        state = replace(state, p=p, v=v)
        distances.append(np.linalg.norm(end[:3]))
    assert distances[70] > 1.0
    assert max(distances[79:]) < 1e-4  # and stays there
    assert coasts > 80


def test_free_flight_is_two_burns_by_hand() -> None:
    """1 m in 10 periods of 1 s: a for 1 s, 8 s of coast, -a for 1 s go (1/2 + 8 + 1/2) a: 5.32 / 9 N."""
    timing = Timing(control_period=1.0, episode_steps=10)
    task = Place(pulled=FREE, spawn_distance=(1.0, 1.0))
    pilot = VelocityToGain(PLATFORM, task, timing, 10.0)
    goal = scenarios(task, PLATFORM, 1, 1).goal
    start = replace(goal, p=type(goal.p)(goal.p.x - 1.0, goal.p.y))
    np.testing.assert_allclose(pilot.wrench(start, goal), [[5.32 / 9.0, 0.0, 0.0]], atol=1e-12)


def test_where_thrust_does_not_suffice_for_the_deadline_it_arrives_later() -> None:
    """100 to 150 m in 20 s take 5 m/s or more, of which 10 s of 1 N give 12 kg less than 1 m/s."""
    craft = deputy()
    starts = scenarios(FAR, craft, 5, 4)
    wanted = VelocityToGain(craft, FAR, SLOW, 20.0).wrench(starts.start, starts.goal)
    load = Allocation(craft).load(wanted)
    assert (load <= 0.95 + 1e-9).all()
    assert (load > 0.3).all()
