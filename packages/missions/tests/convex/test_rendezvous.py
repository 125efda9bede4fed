"""Bounds of a rendezvous: SciPy's linear program, weak duality, flights that keep the limit, and Drake."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rans_missions.convex.rendezvous import (
    Flights,
    least_impulse,
    least_margin,
    least_to_meet,
    proof,
    ranges_of_arrivals,
    rendezvous,
    trajectory,
)
from rans_missions.script import Script
from rans_missions.tasks import Dock, Hold, Rendezvous
from rans_missions.tasks.orbital import last_check

from rans.episode.flight import fly
from rans.episode.scenario import each, scenarios
from rans.evaluation.measure.metrics import impulses, won
from rans.reference.flight import fly_in_drake
from tests.support.rendezvous import DEPUTY, meeting_of, program


@pytest.mark.parametrize("strength", [(1.0, 1.0, 1.0), (1.0, 0.5, 2.0)])
def test_a_meeting_at_one_instant_costs_what_a_linear_program_says(strength):
    """With 2 mm and any speed; missing by 2 mm saves 1e-4 of the impulse at most."""
    meeting, states, _, _ = meeting_of(800.0, 4, 1)
    forces = meeting.forces * np.array(strength)[:, None]
    exact = replace(meeting, forces=forces, position_tolerance=2e-3, velocity_tolerance=10.0)
    for state in states:
        found = least_impulse(exact, state, 800)
        assert found is not None
        assert found.impulse == pytest.approx(program(state, 80, strength), rel=1e-4)


def test_no_multiplier_bounds_more_than_a_flight_needs():
    meeting, states, _, _ = meeting_of(300.0, 3, 2)
    rng = np.random.default_rng(0)
    for state in states:
        found = least_impulse(meeting, state, 300)
        assert found is not None
        best = found.multiplier
        # Tight at its own look, as commands of full thrust are not needed.
        assert proof(meeting, state, 300, best)[300] == pytest.approx(found.impulse, rel=1e-4)
        for spread in (0.01, 0.1, 1.0):
            other = best + spread * np.abs(best) * rng.normal(size=6)
            assert proof(meeting, state, 300, other)[300] <= found.impulse + 1e-6


@given(last=st.integers(1, 5000), interval=st.floats(0.05, 500.0))
def test_ranges_of_arrivals_have_every_check_once(last, interval):
    """Ranges of arrivals are at most 150 s long, where 100 s do not divide the time, and leave no arrival out."""
    ranges = ranges_of_arrivals(last, interval)
    assert [k for first, end in ranges for k in range(first, end + 1)] == [*range(1, last + 1)]
    assert all((end - first) * interval <= 150.0 for first, end in ranges)


@pytest.mark.slow
@pytest.mark.parametrize("deadline", [600.0, 1000.0])
def test_bounds_hold_flights_up_and_flights_keep_the_limit_in_both_engines(deadline):
    meeting, states, starts, task = meeting_of(deadline, 2, 3)
    answers = [rendezvous(meeting, state, deadline) for state in states]
    commands = np.zeros((task.timing.episode_steps, len(states), 6))
    planned = []
    for k, (state, answer) in enumerate(zip(states, answers, strict=True)):
        assert answer.transfer is not None
        least = answer.transfer.impulse
        planned.append(least)
        assert 0.0 < answer.lower <= answer.free.impulse <= least * (1 + 1e-9)
        assert least_margin(meeting.limits, trajectory(meeting, state, answer.transfer)) >= 0.0
        if deadline == 1000.0:
            assert least < 1.01 * answer.lower
        commands[: len(answer.transfer.commands), k] = answer.transfer.commands
    timing = replace(task.timing, episode_steps=round(deadline / 10))
    for flying in (fly, fly_in_drake):
        flight: Any = flying(DEPUTY, task, Script(commands), starts, timing)
        assert won(flight).all()
        np.testing.assert_allclose(impulses(flight), planned, rtol=1e-6)


def test_only_a_checked_certificate_says_that_a_meeting_is_impossible():
    """100 km away nothing meets in 100 s; multipliers that prove nothing are not believed."""
    meeting, (state,), _, _ = meeting_of(300.0, 1, 3)
    far = state + np.array([1e5, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert least_impulse(meeting, far, 100) is None
    flights = Flights(meeting, far, 100)
    flights.be_within(100)
    assert flights.least() == np.inf
    flights = Flights(meeting, state, 300)
    flights.be_within(300)
    rng = np.random.default_rng(0)
    assert flights.cheapest() is not None
    program = flights.program()
    size = len(program.right)
    assert not any(program.is_infeasible(rng.normal(size=size)) for _ in range(200))
    # Flights leave 1e-5 m of the tolerance; a bound leaves none.
    tiny = replace(meeting, position_tolerance=5e-6)
    assert least_impulse(tiny, state, 300) is None
    assert np.isfinite(least_to_meet(tiny, state, 300.0)[0])


MISSIONS = [Dock(), Hold(), Rendezvous()]
GOALS = [next(iter(each(scenarios(task, DEPUTY, 0, 1)))).goal for task in MISSIONS]


@given(
    number=st.integers(0, 2),
    check=st.integers(1, 400),
    offset=st.sampled_from([-2e-3, -9e-4, -5e-4, -1e-5, 0.0, 1e-5, 5e-4, 9e-4, 2e-3]),
)
def test_the_last_check_of_a_proof_is_the_last_that_the_judge_counts(number, check, offset):
    mission = MISSIONS[number]
    goal = GOALS[number]
    interval = mission.timing.control_period / mission.timing.checks
    deadline = check * interval + offset

    def is_in_time(last):
        """Whether the mission judges a success then, or only for being late none."""
        left = deadline - last * interval
        # A hold that begins then is judged when it has lasted.
        lasts = getattr(mission, "hold_seconds", 0.0)
        held = {"held": lasts} if hasattr(goal.notes, "held") else {}
        now, early = (
            replace(goal, notes=replace(goal.notes, deadline=t - lasts, **held))
            for t in (left, 1e3)
        )
        there = replace(goal, notes=None)
        return bool(mission.done(there, now)) == bool(mission.done(there, early))

    last = last_check(deadline, interval)
    assert is_in_time(last)
    assert not is_in_time(last + 1)


@pytest.mark.parametrize("offset", [-2e-3, -5e-4])
def test_a_bound_is_below_the_flights_of_a_deadline_beside_a_check(offset):
    """The check is at 300 s, and counts up to 1 ms after the deadline; that before costs 4 % more."""
    meeting, (state,), _, _ = meeting_of(300.0 + offset, 1, 3)
    lower = rendezvous(meeting, state, 300.0 + offset).lower
    flights = [least_impulse(meeting, state, check) for check in (299, 300)]
    costs = [one.impulse for one in flights if one is not None]
    assert costs[1] < 0.97 * costs[0]
    assert lower <= costs[0] * (1.0 + 1e-6)
    assert (lower <= costs[1] * (1.0 + 1e-6)) == (offset > -1e-3)
