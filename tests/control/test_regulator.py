"""The gains against optimisations that know no Riccati equation; rest against hand-worked coasts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans import GoToPose, GoToPosition, Timing, TrackVelocityHeading
from rans.control.allocation import Allocation
from rans.control.linear_motion import LinearMotion
from rans.control.regulator import Deadband, Gains, Regulator, Weights
from rans.episode.scenario import scenarios
from rans.model.spacecraft_file import load_spacecraft

PERIOD = 0.2
PUSH = 0.5
PLATFORM = load_spacecraft("floating-platform")


def axis_of(deviation: float | None, push: float = PUSH) -> Gains:
    """Gains of a regulator of a double integrator; a speed of 0.3 m/s costs 1 where no deviation is held."""
    return Gains.of(LinearMotion.free(1, PERIOD), push, 0.3, deviation)


def least_squares(axis: Gains, start: np.ndarray, steps: int = 400) -> tuple[float, float]:
    """First acceleration and cost of the best 80 s from a (deviation, speed), all at once: the cost is a
    sum of squares that are linear in the accelerations."""
    motion = np.array([[1.0, PERIOD], [0.0, 1.0]])
    effect = np.array([0.5 * PERIOD**2, PERIOD])
    state = start
    response = np.zeros((2, steps))
    rows = []
    target = []
    for k in range(steps):
        rows.append(np.sqrt(axis.price)[:, None] * response)
        target.append(-np.sqrt(axis.price) * state)
        state = motion @ state
        response = motion @ response
        response[:, k] += effect
    system = np.vstack([*rows, np.eye(steps) / PUSH])
    wanted = np.concatenate([*target, np.zeros(steps)])
    best, *_ = np.linalg.lstsq(system, wanted)
    return float(best[0]), float(np.sum((system @ best - wanted) ** 2))


@pytest.mark.parametrize("axis", [axis_of(0.6), axis_of(None)], ids=["held", "free"])
def test_gain_and_cost_to_go_are_optimal(axis):
    """What is left after 80 s, over ten times the slowest time constant, is below rounding."""
    for start in np.array([[1.0, 0.0], [0.0, 1.0], [0.7, -0.4]]):
        acceleration, cost = least_squares(axis, start)
        assert acceleration == pytest.approx(-axis.gain @ start, rel=1e-8, abs=1e-10)
        assert cost == pytest.approx(start @ axis.cost_to_go @ start, rel=1e-8, abs=1e-10)


def test_the_regulator_reckons_with_the_axis_that_is_hardest_to_turn():
    """Of moments 0.2, 0.4 and 0.25 kg m^2 with the middle one, and with full thrust over the mass, 4 kg."""
    moments = ((0.2, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.25))
    craft = replace(load_spacecraft("free-flyer"), mass=4.0, inertia=moments)
    force, torque = Allocation(craft).authority()
    found = Regulator.of(craft, GoToPose(), Timing(), Weights(position=0.5, attitude=0.7))
    np.testing.assert_allclose(
        found.translation.gain,
        np.kron(axis_of(0.5, force / 4.0).gain, np.eye(3)),
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        found.rotation.gain, np.kron(axis_of(0.7, torque / 0.4).gain, np.eye(3)), rtol=1e-12
    )


def test_tasks_hold_what_they_have_a_tolerance_for():
    held = {
        task: Regulator.of(PLATFORM, task, Timing(), Weights()).carried(PLATFORM).tolist()
        for task in (GoToPose(), GoToPosition(), TrackVelocityHeading())
    }
    assert list(held.values()) == [[True, True, True], [True, True, False], [False, False, True]]


@pytest.mark.parametrize(
    ("distance", "speed", "rests"),
    [
        (0.03, 0.0, True),
        (0.045, 0.0, False),  # 0.8 of 5 cm are 4 cm
        (0.03, 0.01, True),  # 0.8 s later at 3.8 cm
        (0.03, 0.02, False),  # at 4.6 cm
        (-0.03, 0.08, True),  # through the goal, to 3.4 cm
    ],
)
def test_rests_while_a_coast_stays_inside(distance, speed, rests):
    task = GoToPose()
    starts = scenarios(task, PLATFORM, 3, 2)
    goal = starts.goal
    state = replace(
        goal, p=replace(goal.p, x=goal.p.x + distance), v=replace(goal.v, x=goal.v.x + speed)
    )
    assert Deadband().holds(PLATFORM, task, state, goal).tolist() == [rests, rests]
    assert not Deadband(share=0.0).holds(PLATFORM, task, state, goal).any()


def test_does_not_rest_while_spinning():
    task = GoToPosition()  # has no tolerance for it
    goal = scenarios(task, PLATFORM, 3, 1).goal
    spinning = replace(goal, w=np.array([0.15]))
    assert not Deadband().holds(PLATFORM, task, spinning, goal).any()
    assert Deadband().holds(PLATFORM, task, goal, goal).all()
