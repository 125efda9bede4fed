"""Local search over burns: what it returns is a flight that the engine repeats, and never a dearer one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rans_missions.control.mission_guidance import MissionGuidance
from rans_missions.improve import search
from rans_missions.tasks import Dock

from rans.effectors.commands import per_velocity
from rans.episode import Setup
from rans.errors import ConfigError
from rans.evaluation.fly.flights_file import FlightsFile
from rans.evaluation.measure.metrics import impulses
from rans.flight import fly
from rans.model.spacecraft_file import load_spacecraft
from rans.scenario import scenarios

CRAFT = load_spacecraft("afrl-deputy")
TASK = Dock(deadline=(600.0, 600.0)).for_evaluation()
SETUP = Setup(CRAFT, TASK, replace(TASK.timing, episode_steps=62))
LEVERS = np.array(per_velocity(CRAFT, SETUP.timing.control_period))


class Wasteful:
    """Guidance that also pushes against itself for a minute: a flight with something to find."""

    name = "wasteful"

    def __init__(self) -> None:
        self._inner = MissionGuidance(CRAFT, TASK)
        self._step = 0

    def reset(self, count: int) -> None:
        self._inner.reset(count)
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        commands = self._inner.act(state, goal, observation).copy()
        if self._step in (10, 11):
            # Across the orbit, there and back a period later.
            axis = [k for k, t in enumerate(CRAFT.thrusters) if t.direction[2] != 0.0]
            commands[:, axis] = 0.0
            commands[:, axis[self._step - 10]] = 0.05
        self._step += 1
        return commands


@pytest.mark.slow
def test_a_search_finds_what_a_flight_wastes_and_the_engine_repeats_it(tmp_path: Path) -> None:
    starts = scenarios(TASK, CRAFT, 2023, 2)
    found = search.improve(SETUP, starts, [Wasteful()], rounds=3)
    assert (found.after <= found.before).all()
    assert (found.after < 0.99 * found.before).any()
    file = found.write(tmp_path / "least.csv")
    flight = fly(CRAFT, TASK, FlightsFile(file, SETUP), starts, SETUP.timing)
    assert np.asarray(flight.verdict.solved).all()
    assert not flight.violated().any()
    np.testing.assert_allclose(impulses(flight), found.after, rtol=1e-9)


def test_a_flight_that_breaks_a_limit_or_does_not_arrive_is_never_cheap() -> None:
    """Three flights without any burn, of which the second broke a limit, and the third did not solve its task."""
    flight = SimpleNamespace(
        verdict=SimpleNamespace(solved=np.array([True, True, False])),
        violated=lambda: np.array([False, True, False]),
        failed=lambda: np.zeros(3, bool),
        craft=CRAFT,
        commands=np.zeros((4, 3, CRAFT.command_count)),
        timing=SETUP.timing,
        lengths=None,
    )
    judged: Any = flight
    np.testing.assert_array_equal(search._judged(judged), [0.0, np.inf, np.inf])


def test_changes_are_those_of_the_commands_and_end_with_the_flight() -> None:
    changes = np.random.default_rng(1).uniform(-0.1, 0.1, (5, 2, 3))
    flight: Any = SimpleNamespace(
        commands=np.clip(changes @ LEVERS.T, 0.0, 1.0), lengths=np.array([5, 3])
    )
    expected = changes.copy()
    expected[3:, 1] = 0.0
    np.testing.assert_allclose(search._changes(flight, LEVERS), expected, atol=1e-15)


@given(st.integers(0, 10_000), st.floats(1e-3, 1.0))
def test_a_changed_flight_keeps_within_what_a_period_gives(seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    flight = np.where(random.random((30, 1)) < 0.2, random.uniform(-0.5, 0.5, (30, 3)), 0.0)
    search._change(flight, size, 0.5, random)
    assert np.isfinite(flight).all()
    assert np.abs(flight).max() <= 0.5


def test_a_search_without_a_flight_to_begin_from_is_refused() -> None:
    class Coasting:
        name = "coasting"
        observes = False

        def reset(self, count: int) -> None: ...

        def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
            return np.zeros((len(observation), CRAFT.command_count))

    short = SETUP._replace(timing=replace(SETUP.timing, episode_steps=2))
    with pytest.raises(ConfigError, match="coasting solves Dock from any of 2 starts"):
        search.improve(short, scenarios(TASK, CRAFT, 2023, 2), [Coasting()], rounds=1)
    platform = SETUP._replace(craft=load_spacecraft("floating-platform"))
    with pytest.raises(ConfigError, match="in the plane"):
        search.improve(platform, scenarios(TASK, CRAFT, 2023, 1), [Coasting()], rounds=1)
