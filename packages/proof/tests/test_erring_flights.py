"""Flights with the errors of a certificate of poses: late valves against the engine's own delay, and readings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("flint")

from rans_proof.erring_flights import LateValves, Misread, between, erring_body

import rans
from rans.extend import fly
from rans.model.body import Body
from rans.model.fields import map_leaves
from rans.scenario import Scenario, draws
from tests.support.played import Played

CRAFT = rans.load_spacecraft("floating-platform")
TIMING = rans.Timing(control_period=0.1, episode_steps=6)
START = rans.scenario.scenarios(rans.GoToPose(), CRAFT, 3, 50)
SPUN = Scenario(replace(START.start, w=np.linspace(-1.0, 1.0, 50)), START.goal)


class Chance:
    """Random numbers that are all at the upper end."""

    def uniform(self, low: float, high: float, shape: Any) -> np.ndarray:
        return np.full(shape, high)


PULSES = np.random.default_rng(0).integers(0, 2, (6, 50, 8)).astype(float)
PULSES[-1] = 0.0


def flown(**settings: Any) -> rans.Flight:
    return fly(CRAFT, rans.GoToPose(), Played(PULSES), SPUN, TIMING, **settings)


@pytest.mark.parametrize("late", [0.0, 0.02])
def test_valves_that_are_all_as_late_fly_as_with_one_delay(late: float) -> None:
    """The engine's own delay has other code; a control period before the last one all valves have shut."""
    valves = LateValves(CRAFT, 0.1, late, late, Chance())  # type: ignore[arg-type]
    conditions = rans.Conditions(thrusters=rans.ThrusterConditions(latency=late))
    expected = flown(conditions=conditions, draws=draws(0, 50))
    flight = flown(move=valves)
    for mine, theirs in zip(*(rans_leaves(x.states) for x in (flight, expected)), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)
    # From where the last valves shut the craft coasts, as if it had from the state that a cell has.
    coasting, last = valves.coasting[-1], map_leaves(lambda x: x[-1], flight.states)
    np.testing.assert_allclose((coasting.p + coasting.v.scale(0.1)).x, last.p.x, atol=1e-9)
    np.testing.assert_allclose(coasting.v.y, last.v.y, atol=1e-9)
    np.testing.assert_allclose(coasting.w, last.w, atol=1e-9)
    if late:
        assert np.abs(coasting.v.y - flight.states.v.y[-2]).max() > 1e-3


def rans_leaves(states: Any) -> list[np.ndarray]:
    return [states.p.x, states.p.y, states.v.x, states.v.y, states.attitude.angle, states.w]


def test_each_valve_has_a_delay_of_its_own() -> None:
    """All thrusters open together, whose torques cancel but for the delays of those that turn one way."""
    begin = map_leaves(lambda x: np.zeros(1000), START.start)
    inputs = rans.episode.StepInputs(Body.of(CRAFT), (tuple(np.ones((8, 1000))),))
    turning = sum(max(torque, 0.0) for _, _, torque in CRAFT.wrench_map) / CRAFT.inertia[2][2]
    for opening, shutting in ((0.05, 0.0), (0.0, 0.05)):
        valves = LateValves(CRAFT, 0.1, opening, shutting, np.random.default_rng(1))
        (state,) = valves(begin, inputs)
        spin = np.abs(state.w)
        assert 0.7 * opening * turning <= spin.max() <= opening * turning + 1e-12
        assert len(np.unique(spin.round(9))) > 900 if opening else not spin.any()


def test_errors_reach_their_bounds_and_no_farther() -> None:
    random = np.random.default_rng(0)
    numbers = between(random, 2.0, 10_000, -1.0)
    assert numbers.min() == -1.0
    assert numbers.max() == 2.0
    assert 0.4 < ((numbers == -1.0) | (numbers == 2.0)).mean() < 0.6
    body = erring_body(CRAFT, {"mass": 0.1, "thrust": 0.2}, random, 1000)
    nominal = Body.of(CRAFT)
    np.testing.assert_allclose(np.ptp(body.mass), 0.2 * nominal.mass)
    np.testing.assert_allclose(body.inertia[0] / nominal.inertia[0], body.mass / nominal.mass)
    np.testing.assert_allclose(np.ptp(body.gain[3]), 0.4)
    assert body.gain[0] is body.gain[7]


def test_readings_are_off_by_their_errors() -> None:
    """What an agent is given, less what it is given without errors."""

    class Asked:
        name = "asked"

        def __copy__(self) -> Any:
            return self  # what it keeps is read after the flight

        def reset(self, count: int) -> None:
            pass

        def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
            self.state, self.observation = state, observation
            return np.zeros((len(observation), 8))

    asked = Asked()
    run: Any = type("Run", (), {"controller": asked, "task": rans.GoToPose()})
    off = {"position": 0.1, "velocity": 0.2, "heading": 0.3, "spin": 0.4}
    pilot = Misread(run, off, np.random.default_rng(2))
    state, goal = START.start, START.goal
    pilot.act(state, goal, np.zeros((50, 0)))
    read = asked.state
    for name, largest, error in (
        ("position", 0.1, np.hypot(read.p.x - state.p.x, read.p.y - state.p.y)),
        ("velocity", 0.2, np.hypot(read.v.x - state.v.x, read.v.y - state.v.y)),
        ("heading", 0.3, np.abs(read.attitude.angle - state.attitude.angle)),  # pyrefly: ignore[missing-attribute]
        ("spin", 0.4, np.abs(read.w - state.w)),
    ):
        np.testing.assert_allclose(error.max(), largest, err_msg=name)
        assert (error < 0.9 * largest).any()
    # The observation is of what is read.
    np.testing.assert_allclose(asked.observation[:, 4], read.w, rtol=1e-6)
