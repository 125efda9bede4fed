"""What a trajectory is optimal for: closed forms, linear algebra, the task's own return."""

from dataclasses import replace

import pytest
from rans_optimal.objectives import (
    MaximumReward,
    MinimumEnergy,
    MinimumFuel,
    MinimumTime,
)

from rans import Timing
from rans.episode.flight import Flight
from rans.episode.scenario import scenario, scenarios
from rans.model.fields import map_leaves
from rans.tasks import (
    GoToPose,
    GoToPosition,
    TrackTwist,
    TrackVelocity,
    TrackVelocityHeading,
)
from tests.support.crafts import nasty_spatial
from tests.support.problems import (
    PLATFORM,
    replay_error,
    solved,
)
from tests.support.states import planar
from tests.support.switching import SwitchingGoToPose


def test_least_energy_along_a_body_axis_is_a_parabola_of_speed():
    """Force falling linearly from F to -F over T: F = 6 m d / T^2, shared by four nozzles at 45 degrees
    that each give F / (4 cos 45), so energy is F^2 / 2 * T / 3 = 6 m^2 d^2 / T^3.

    Held for whole periods, N of them, it takes 1 / (1 - 1 / N^2) times as much.
    """
    trajectory = solved(PLATFORM, MinimumEnergy(10.0, 0.5), planar(x=-2.0), planar())
    least = 6 * PLATFORM.mass**2 * 2.0**2 / 10.0**3 / (1 - 1 / 20**2)
    assert trajectory.cost == pytest.approx(least, rel=1e-4)  # turning a little may not save more


EVERY_TASK = [GoToPosition(), GoToPose(), TrackVelocity(), TrackTwist(), TrackVelocityHeading()]
EVERY_OBJECTIVE = [
    MinimumFuel(20.0, 0.5),
    MinimumTime(20),
    MinimumEnergy(20.0, 0.5),
    MinimumTime(20, "set"),
    MaximumReward(12.0, 0.4),
]


@pytest.mark.parametrize(
    ("task", "objective"),
    [
        (EVERY_TASK[number % len(EVERY_TASK)], objective)
        for number, objective in enumerate(EVERY_OBJECTIVE)
    ],
    ids=lambda x: getattr(x, "name", type(x).__name__),
)
def test_every_task_with_objectives(task, objective):
    """Every task and every objective.

    Drake flies them, and they end where the task asks: exactly, in its tolerances, or near.
    """
    case = scenario(task.for_evaluation(), 2, 5, 1)
    trajectory = solved(PLATFORM, objective, case.start, case.goal, task)
    assert replay_error(PLATFORM, trajectory) < 1e-4
    last = map_leaves(lambda x: float(x[-1]), trajectory.states)
    errors = task.errors(last, case.goal)
    tolerances = task.tolerances()
    for name, tolerance in tolerances.items():
        allowed = {"exact": 1e-6, "set": tolerance, "free": 2 * tolerance}[objective.ending]
        assert errors[name] < allowed, name
    if "position" in tolerances and objective.ending != "free":  # it stays there
        assert last.v.norm() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "objective"),
    [
        (GoToPose(), MinimumFuel(16.0, 0.8)),
        (TrackVelocityHeading(), MaximumReward(6.0, 0.6)),
    ],
    ids=["pose", "velocity and attitude"],
)
def test_space_with_an_awkward_body(task, objective):
    case = scenario(task.for_evaluation(), 3, 5, 2)
    trajectory = solved(nasty_spatial(), objective, case.start, case.goal, task)
    assert replay_error(nasty_spatial(), trajectory) < 0.02  # one Runge-Kutta step of 0.8 s


def test_the_cost_is_the_tasks_own_return():
    """As evaluations sum it over a flight: no rounded corner in it, switching and thrust included."""
    task = SwitchingGoToPose(switching_weight=0.01, spin_weight=0.02).for_evaluation()
    objective = MaximumReward(10.0, 0.5)
    starts = scenarios(task, PLATFORM, 6, 1)
    case = scenario(task, 2, 6, 0)
    trajectory = solved(PLATFORM, objective, case.start, case.goal, task)
    states = map_leaves(lambda x: x[:, None], trajectory.states)
    flight = Flight(
        PLATFORM,
        task,
        Timing(0.5, episode_steps=20),
        states,
        starts.goal,
        trajectory.commands[:, None],
        "reward",
    )
    assert "switching" in flight.rewards()
    total = sum(float(term.sum()) for term in flight.rewards().values())
    assert -trajectory.cost == pytest.approx(total, rel=1e-6)  # commands are clipped by up to 1e-8
    guessed = MinimumFuel(10.0, 0.5)
    other = replace(
        flight,
        states=map_leaves(
            lambda x: x[:, None], solved(PLATFORM, guessed, case.start, case.goal, task).states
        ),
    )
    assert total > sum(float(term.sum()) for term in other.rewards().values())
