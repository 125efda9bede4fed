"""Optimal trajectories against closed forms, a linear program and Drake."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from rans_optimal import optima
from rans_optimal.objectives import (
    MinimumFuel,
    MinimumTime,
)
from rans_optimal.transcription import (
    Transcription,
    _best,
    unsolved,
    usual_guesses,
)
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from rans import GoToPosePriced, GoToPosition, Thruster, Timing, TrackVelocity
from rans.episode.scenario import Scenario, batch, scenario
from rans.model.drift import FREE, ClohessyWiltshire, UniformGravity, step_goal
from rans.model.fields import Vec2, leaves, map_leaves
from rans.reference.flight import replay
from rans.tasks.go_to_pose_priced import DrawnTradeOff
from tests.support.crafts import nasty_planar
from tests.support.problems import (
    FLYER,
    FORWARD,
    PLATFORM,
    SHARED,
    SOLVER,
    TASK,
    replay_error,
    solved,
    spatial,
    transcription,
)
from tests.support.states import planar


def test_least_time_along_a_body_axis_is_bang_bang():
    """Half the way at full thrust, half braking: 2 sqrt(d m / F), and no direction gives more force.

    An even number of periods puts the switch on a boundary, so that discretisation costs nothing.
    """
    trajectory = solved(PLATFORM, MinimumTime(20), planar(x=-3.0), planar())
    assert trajectory.cost == pytest.approx(
        2 * math.sqrt(3.0 * PLATFORM.mass / FORWARD), rel=SOLVER
    )
    assert trajectory.control_period == pytest.approx(trajectory.cost / 20)


def test_shared_thrust_is_slower():
    """One nozzle's worth of force, whichever are open, and it need not be aligned: at least
    2 sqrt(d m / 1 N); along a nozzle pair's common direction no turn is needed to reach it."""
    goal = planar(heading=math.pi / 4)
    trajectory = solved(SHARED, MinimumTime(20), planar(x=-3.0, heading=math.pi / 4), goal)
    assert trajectory.cost == pytest.approx(2 * math.sqrt(3.0 * SHARED.mass), rel=SOLVER)
    assert (
        trajectory.commands.sum(axis=1).max() <= 1.0 + 1e-7
    )  # the optimiser's bounds give by 1e-8


def test_least_fuel_along_a_nozzle_pair_is_a_linear_programs():
    """Two nozzles point along the body's diagonal: no other way spends less per newton, so the
    one-dimensional problem, which is linear, has the same optimum."""
    goal = planar(heading=math.pi / 4)
    objective = MinimumFuel(10.0)
    trajectory = solved(PLATFORM, objective, planar(x=-3.0, heading=math.pi / 4), goal)
    least = _linear_program(3.0, PLATFORM.mass, 2.0, 50, 0.2)
    assert trajectory.cost == pytest.approx(least, rel=SOLVER)
    assert trajectory.commands.shape == (50, 8)


def _linear_program(distance: float, mass: float, force: float, count: int, period: float) -> float:
    """Least impulse from rest to rest with piecewise constant thrust within +-force."""
    push = force * period / mass  # speed gained in one period at full thrust
    way = push * (count - np.arange(count) - 0.5) * period  # and where that ends up
    conditions = np.array(
        [np.append(way, -way), np.full(2 * count, push) * np.repeat([1, -1], count)]
    )
    price = np.full(2 * count, force * period)
    return linprog(price, A_eq=conditions, b_eq=[distance, 0.0], bounds=(0, 1)).fun


@pytest.mark.parametrize(
    ("craft", "objective"),
    [
        (PLATFORM, MinimumTime(30)),
        (SHARED, MinimumFuel(20.0, 0.4)),
        (nasty_planar(), MinimumTime(30)),
    ],
    ids=lambda x: x.name,
)
def test_random_starts_arrive_in_drake(craft, objective):
    """In the plane the equations are exact, so only the optimiser's 1e-8 per interval is left."""
    for episode in range(2):
        case = scenario(TASK, 2, 7, episode)
        trajectory = solved(craft, objective, case.start, case.goal)
        assert replay_error(craft, trajectory) < 1e-5
        last = map_leaves(lambda x: float(x[-1]), trajectory.states)
        for name, error in TASK.errors(last, case.goal).items():
            assert error < 1e-6, name
        assert max(last.v.norm(), abs(last.w)) < 1e-6
        assert trajectory.commands.min() >= 0.0
        assert trajectory.commands.max() <= 1.0


def test_space_arrives_in_drake():
    """One Runge-Kutta step a period: less than a millimetre is lost, see `Transcription`."""
    for episode in range(2):
        case = scenario(TASK, 3, 9, episode)
        trajectory = solved(FLYER, MinimumTime(40), case.start, case.goal)
        assert replay_error(FLYER, trajectory) < 1e-3
        last = map_leaves(lambda x: float(x[-1]), trajectory.states)
        assert TASK.errors(last, case.goal)["attitude"] < 1e-5
        assert float(last.w.norm()) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [179.0, 180.0])
def test_never_arrives_the_wrong_way_round(degrees):
    """Conditions on a rotation's entries also vanish at opposite attitudes: it must not end there."""
    angle = math.radians(degrees)
    flat = solved(PLATFORM, MinimumTime(30), planar(x=1.0, heading=angle), planar())
    assert math.cos(float(flat.states.attitude.angle[-1])) == pytest.approx(1.0)
    for axis in np.eye(3)[::2]:
        start = spatial(1.0, Rotation.from_rotvec(angle * axis))
        trajectory = solved(FLYER, MinimumTime(40), start, spatial())
        last = map_leaves(lambda x: float(x[-1]), trajectory.states)
        assert TASK.errors(last, spatial())["attitude"] < 1e-5


@pytest.mark.parametrize("craft", [PLATFORM, SHARED], ids=["platform", "shared"])
def test_too_short_a_horizon_is_a_status(craft):
    trajectory = transcription(craft, MinimumFuel(2.0)).solve(planar(x=-3.0), planar())
    assert not trajectory.solved
    assert trajectory.status == "Infeasible_Problem_Detected"
    assert trajectory.attempts == 2  # one guess was asked for, one more tried
    assert math.isnan(trajectory.cost)  # what it ended with reaches no goal, so it would be cheap


def test_a_craft_without_guesses_still_flies_straight():
    """Two opposite nozzles through the centre: nothing to guess commands with, but a way to go."""
    with pytest.warns(UserWarning, match="cannot push and turn"):
        pair = replace(
            PLATFORM,
            thrusters=tuple(Thruster((0.0, 0.0, 0.0), (way, 0.0, 0.0), 2.0) for way in (1.0, -1.0)),
        )
    trajectory = solved(pair, MinimumFuel(10.0), planar(x=-3.0), planar(), GoToPosition())
    assert trajectory.cost == pytest.approx(
        _linear_program(3.0, pair.mass, 2.0, 50, 0.2), rel=SOLVER
    )


def test_the_best_is_the_cheapest_of_those_solved():
    """An attempt that stopped on the way may be cheaper, as it need not arrive."""
    one = solved(PLATFORM, MinimumFuel(10.0), planar(x=-3.0), planar())
    lost = replace(one, solved=False, cost=0.1, iterations=5, seconds=1.0)
    dear = replace(one, cost=one.cost + 1.0, iterations=7, seconds=2.0)
    for found in itertools.permutations((lost, dear, one)):
        best = _best(found)
        assert (best.solved, best.cost) == (True, one.cost)
        assert best.iterations == one.iterations + 12
        assert best.seconds == pytest.approx(one.seconds + 3.0)
    assert _best((lost, replace(lost, cost=0.05))).cost == 0.05
    assert _best((replace(lost, cost=math.nan), one)).solved


@pytest.mark.parametrize("periods", [43, 81, 86, 91])
def test_horizons_are_whole_periods(periods):
    """0.2 s times these, over 0.2 s again, is just below the whole number."""
    assert MinimumFuel(periods * 0.2, 0.2).intervals == periods


@pytest.mark.parametrize(
    "drift",
    [
        UniformGravity((0.05, -0.08)),
        pytest.param(ClohessyWiltshire(0.05), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_optima_under_a_drift_fly_in_drake(drift, monkeypatch):
    """Its commands, by the CasADi function that it optimised with, lead where Drake flies them; its own path
    has gaps of up to 1e-8 between intervals beyond that, which add up."""
    monkeypatch.setattr(type(TASK), "drift", drift)
    problem = Transcription(PLATFORM, TASK, MinimumFuel(20.0, 0.4))
    found = problem.solve(planar(3.0, -1.0, 2.0), planar())
    assert found.solved, found.status
    start = map_leaves(lambda x: float(x[0]), found.states)
    timing = Timing(found.control_period)
    flown = replay(PLATFORM, start, found.commands, timing, drift)
    state = np.array(leaves(start))
    for command in found.commands:
        state = np.array(
            problem._step(state, np.array(PLATFORM.wrench_map).T @ command, 0.4)
        ).ravel()
    last = [x[-1] for x in leaves(flown)]
    np.testing.assert_allclose(state, last, rtol=0, atol=1e-9 * math.hypot(3.0, 1.0))
    assert float((flown.p - found.states.p).norm().max()) < 1e-5
    # In free flight the same commands end elsewhere: the drift was felt.
    free = replay(PLATFORM, start, found.commands, timing)
    assert float((free.p - found.states.p).norm().max()) > 1.0


def test_where_no_guess_leads_anywhere_the_next_one_is_tried(monkeypatch):
    """And not one that has failed already; where one of them does, no more."""
    problem = transcription(PLATFORM, MinimumTime(20))
    tried = []
    lost = unsolved(MinimumTime(20), PLATFORM, planar(), "Infeasible_Problem_Detected")

    def attempt(start, goal, number):
        tried.append(number)
        return replace(lost, solved=number == good)

    monkeypatch.setattr(problem, "attempt", attempt)
    for good, numbers in ((None, [0, 1, 2]), (1, [0, 1]), (2, [0, 1, 2])):
        tried.clear()
        assert problem.solve(planar(1.0), planar(), 2).solved is (good is not None)
        assert tried == numbers


def test_what_a_goal_notes_is_no_part_of_the_state_that_arrives():
    """A task with a trade-off asks for the same pose: least fuel is that of the task without one."""
    start = planar(x=-1.0)
    goal = planar(x=0.1, heading=0.3)
    objective = MinimumFuel(6.0)
    priced = solved(
        PLATFORM, objective, start, replace(goal, notes=DrawnTradeOff(0.5)), GoToPosePriced()
    )
    assert priced.cost == pytest.approx(solved(PLATFORM, objective, start, goal).cost, rel=SOLVER)


@dataclass(frozen=True)
class Moving(GoToPosition):
    """The goal moves as free points do."""

    def later(self, goal: Any, time: Any) -> Any:
        return step_goal(goal, FREE, time)


@dataclass(frozen=True)
class Careful(GoToPosition):
    """Slow, and out of a ball of 0.5 m around (-1.5, 0.1) m."""

    def constraints(self, state: Any, goal: Any) -> dict[str, Any]:
        way = state.p - type(state.p)(-1.5, 0.1, *(0.0,) * (len(state.p.columns()) - 2))
        return {"ball": way.norm() - 0.5, "speed": 0.4 - state.v.norm()}


def test_a_goal_that_moves_evenly_is_one_that_stands_still_seen_from_elsewhere():
    """By Galilei: a goal at 0.2 m/s costs what one at rest costs from a start at -0.2 m/s."""
    objective = MinimumFuel(10.0)
    goal = replace(planar(), v=Vec2(0.2, 0.0))
    moving = solved(PLATFORM, objective, planar(x=-3.0), goal, Moving())
    start = replace(planar(x=-3.0), v=Vec2(-0.2, 0.0))
    standing = solved(PLATFORM, objective, start, planar(), Moving())
    assert moving.cost == pytest.approx(standing.cost, rel=SOLVER)
    assert moving.states.p.x[-1] == pytest.approx(2.0, abs=1e-6)


def test_constraints_are_kept_at_every_instant_and_cost_something():
    objective = MinimumFuel(15.0, 0.25)
    start = planar(x=-3.0)
    kept = solved(PLATFORM, objective, start, planar(), Careful())
    free = solved(PLATFORM, objective, start, planar(), GoToPosition())
    margins = Careful().constraints(kept.states, planar())
    assert min(margin.min() for margin in margins.values()) >= -1e-7
    # The straight way leads through the ball.
    assert Careful().constraints(free.states, planar())["ball"].min() < -0.1
    assert kept.cost > free.cost * 1.01


def test_from_midway_between_two_attitudes_one_guess_is_not_enough():
    """2 N along a diagonal of the body, 2.83 N along an axis: to gain 2 m/s it pays to turn by 45 degrees.

    At the diagonal both ways to turn are alike, so that the first guess, which does not turn, has no slope: it
    takes 2 m/s * 5.32 kg / 2 N. From an axis on it would take 3.76 s, and with the turn no more than 4.5 s.
    """
    task = TrackVelocity()
    start = planar(heading=math.pi / 4)
    goal = replace(planar(heading=math.pi / 4), v=Vec2(2.0, 0.0))
    problem = transcription(PLATFORM, MinimumTime(20), task)
    one = problem.solve(start, goal)
    best = problem.solve(start, goal, usual_guesses(PLATFORM, task, MinimumTime(20)))
    assert one.cost == pytest.approx(2.0 * PLATFORM.mass / 2.0, rel=SOLVER)
    assert 2.0 * PLATFORM.mass / FORWARD < best.cost < 4.5


@pytest.mark.parametrize("ending", ["exact", "set"])
def test_from_the_goal_to_the_goal_takes_no_time(ending):
    """And 1 mm away it takes some: 2 sqrt(d m / F) at least, along the strongest axis of the body."""
    problem = Transcription(PLATFORM, TASK, MinimumTime(20, ending))
    found = problem.solve(planar(x=1.0), planar(x=1.0))
    assert (found.solved, found.cost, found.control_period) == (True, 0.0, 0.0)
    assert found.commands.shape == (20, 8)
    if ending == "exact":
        near = problem.solve(planar(x=1.001), planar(x=1.0))
        assert near.cost == pytest.approx(2 * math.sqrt(1e-3 * PLATFORM.mass / FORWARD), rel=1e-4)


def test_a_least_time_of_none_is_flown_and_said():
    starts = batch([Scenario(planar(x=1.0), planar(x=1.0))])
    (answer,) = optima.optima(PLATFORM, TASK, MinimumTime(5), starts, workers=1)
    assert answer.good
    assert answer.sentence == "0 s: the start is the goal"
    assert answer.errors["position"] == 0.0
