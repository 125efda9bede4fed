"""What a craft at rest can do to stay so: hand-worked states, all commands tried, and plans flown."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import rans
from campaigns.staying import balanced_changes, commands_that_stay
from rans.episode import Setup, World, step
from rans.errors import ConfigError
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.tasks.goal_set import arrived

PERIOD = 0.2
RADIUS = 0.05
PLATFORM = load_spacecraft("floating-platform")
CHANGES = balanced_changes(PLATFORM, PERIOD)


def test_sets_of_the_platform_without_torque() -> None:
    """Two nozzles push with the root of 2 N along an axis of B, or with 2 N along a diagonal; 5.32 kg, 0.2 s."""
    speeds = np.sort(np.linalg.norm(CHANGES.velocities, axis=1))
    axis = np.sqrt(2.0) / 5.32 * PERIOD
    assert speeds == pytest.approx([0.0, *[axis] * 4, *[np.sqrt(2.0) * axis] * 4], abs=1e-6)
    assert CHANGES.impulses == pytest.approx([0.0, *[0.4] * 8])


@pytest.mark.parametrize(
    ("position", "velocity", "periods", "pulses"),
    [
        ((0.0, 0.0), (0.0, 0.0), 100, 0),
        # 4.9 cm at 3 mm/s: out after 30 periods; 53.2 - 3 mm/s the other way is faster than 50.
        ((0.049, 0.0), (0.003, 0.0), 10, None),
        # At 4 mm/s it is 49.2 mm/s the other way.
        ((0.049, 0.0), (0.004, 0.0), 10, 1),
        # To and fro at 26.6 mm/s: at the edge after 9 periods, unless it turns round.
        ((0.0, 0.0), (0.0266, 0.0), 15, 1),
    ],
)
def test_hand_worked(
    position: tuple[float, float], velocity: tuple[float, float], periods: int, pulses: int | None
) -> None:
    found = commands_that_stay(
        np.array(position), np.array(velocity), periods, CHANGES, PERIOD, RADIUS
    )
    assert (None if found is None else int(found.any(axis=1).sum())) == pulses


def flown(state: PlanarState, commands: np.ndarray) -> np.ndarray:
    """(N,) whether each of N sequences of commands (N, T, thrusters) stays in the goal set, by the engine."""
    world = World(Setup(PLATFORM, rans.GoToPose(), Timing()))
    count = len(commands)
    full = np.zeros(count)
    begun = PlanarState(
        Vec2(state.p.x + full, state.p.y + full),
        Heading(state.attitude.angle + full),
        Vec2(state.v.x + full, state.v.y + full),
        state.w + full,
    )
    goal = PlanarState(Vec2(full, full), Heading(full), Vec2(full, full), full)
    episode = world.begin(begun, goal)
    stays = np.ones(count, dtype=bool)
    for now in np.moveaxis(commands.astype(float), 1, 0):
        episode = step(world, episode, tuple(now.T)).episode
        stays &= arrived(world.task, episode.state, episode.goal)
    return stays


def test_no_commands_at_all_stay_where_the_search_finds_none() -> None:
    """All 65,536 pairs of commands, states drawn near the edge of the set so that both answers occur."""
    random = np.random.default_rng(0)
    pairs = np.array(list(product(product((0, 1), repeat=8), repeat=2)))
    answers = []
    for _ in range(6):
        bearing, course = random.uniform(0.0, 2.0 * np.pi) + np.array([0.0, 0.3])
        p = 0.0485 * np.array([np.cos(bearing), np.sin(bearing)])
        v = random.uniform(0.01, 0.05) * np.array([np.cos(course), np.sin(course)])
        state = PlanarState(Vec2(*map(float, p)), Heading(0.0), Vec2(*map(float, v)), 0.0)
        plan = commands_that_stay(p, v, 2, CHANGES, PERIOD, RADIUS)
        assert (plan is not None) == flown(state, pairs).any()
        answers.append(plan is not None)
    assert 0 < sum(answers) < len(answers)


def test_a_plan_stays_when_it_is_flown() -> None:
    state = PlanarState(Vec2(0.02, -0.01), Heading(0.0), Vec2(0.02, 0.011), 0.0)
    plan = commands_that_stay(
        np.array([0.02, -0.01]), np.array([0.02, 0.011]), 95, CHANGES, PERIOD, RADIUS
    )
    assert plan is not None
    assert flown(state, plan[None]).all()
    late = np.roll(plan, 12, axis=0)
    assert not flown(state, late[None]).all()


def test_crafts_of_other_kinds_are_refused() -> None:
    with pytest.raises(ConfigError, match="shares thrust"):
        balanced_changes(load_spacecraft("floating-platform-shared"), PERIOD)
    weak = replace(PLATFORM, thrusters=tuple(replace(one, force=0.1) for one in PLATFORM.thrusters))
    with pytest.raises(ConfigError, match="degrees/s"):
        balanced_changes(weak, PERIOD)
