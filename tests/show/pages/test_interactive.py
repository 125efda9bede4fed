"""A flight that a person changes: as any other flight until it is changed, and then as physics says."""

from __future__ import annotations

import numpy as np
import pytest

from rans.api.pages import flyers
from rans.errors import ConfigError
from rans.flight import fly
from rans.model.fields import leaves
from rans.scenario import scenarios
from rans.show.pages.interactive import InteractiveFlight

SEED = 7
PERIODS = 30


def flight(*names: str) -> InteractiveFlight:
    return InteractiveFlight(flyers(names or ("lqr:go-to-pose-2d",), None, False), SEED, 3)


def flown(one: InteractiveFlight, periods: int) -> np.ndarray:
    """States (periods + 1, columns)."""
    states = [leaves(one.state)]
    for _ in range(periods):
        one.step()
        states.append(leaves(one.state))
    return np.array(states, dtype=float)[:, :, 0]


@pytest.mark.parametrize(
    ("name", "tolerance"), [("lqr:go-to-pose-2d", 1e-9), ("pretrained:go-to-pose-3d", 1e-6)]
)
def test_untouched_it_is_the_flight_of_every_other_command(name: str, tolerance: float) -> None:
    """In the plane steps are exact; in space states to draw cut them into shorter, more accurate ones."""
    (run,) = flyers((name,), None, False)
    setup = run.judged
    start = scenarios(setup.task, setup.craft, SEED, 1, first=3)
    expected = fly(setup.craft, setup.task, run.controller, start, setup.timing).states
    found = flown(flight(name), PERIODS)
    np.testing.assert_allclose(
        found.T, np.stack(leaves(expected))[:, : PERIODS + 1, 0], rtol=0, atol=tolerance
    )


def test_with_every_thruster_dead_it_drifts_along_a_straight_line() -> None:
    one = flight()
    flown(one, 5)
    one.dead.update(range(8))
    states = flown(one, 10)
    period = one.world.timing.control_period
    times = period * np.arange(11)[:, None]
    np.testing.assert_allclose(states[:, :2], states[0, :2] + times * states[0, 3:5], atol=1e-12)
    np.testing.assert_allclose(states[:, 5], states[0, 5], atol=1e-12)


def test_a_stuck_thruster_pushes_without_a_command() -> None:
    """With all others dead the spin grows by force times lever over inertia, whoever commands."""
    one = flight()
    craft = one.world.craft
    one.dead.update(range(1, 8))
    one.stuck.add(0)
    before = float(one.state.w[0])
    flown(one, 5)
    torque = craft.wrench_map[0][2]
    gained = torque / craft.inertia[2][2] * 5 * one.world.timing.control_period
    assert float(one.state.w[0]) - before == pytest.approx(gained, rel=1e-9)


def test_late_commands_arrive_so_many_periods_later() -> None:
    prompt = flight()
    late = flight()
    late.delay = 2
    prompt.step()
    first = prompt.command
    assert any(first)
    for expected in ((0.0,) * 8, (0.0,) * 8, first):
        late.step()
        assert late.command == expected


@pytest.mark.parametrize("name", ["lqr:go-to-pose-2d", "pretrained:go-to-pose-2d"])
def test_what_is_flown_again_after_going_back_is_the_same(name: str) -> None:
    """The LQR remembers what rounding owes; nothing else differs."""
    one = flight(name)
    flown(one, 4)
    first = flown(one, 12)
    one.rewind(12)
    assert one.time == pytest.approx(4 * one.world.timing.control_period)
    np.testing.assert_array_equal(flown(one, 12), first)


def test_it_goes_where_the_goal_is_moved_to() -> None:
    one = flight()
    one.place_goal((1.0, -0.5, 0.3))
    flown(one, 120)
    assert one.errors()["position"] < 0.05
    assert float(one.state.p.x[0]) == pytest.approx(1.0, abs=0.05)
    assert float(one.state.attitude.angle[0]) == pytest.approx(0.3, abs=0.1)


def test_noise_makes_a_flight_another_one_and_none_is_none() -> None:
    clean = flown(flight(), 10)
    noisy = flight()
    noisy.noise = 1.0
    assert np.abs(flown(noisy, 10) - clean).max() > 1e-3


def test_one_flight_has_one_craft_and_one_task() -> None:
    with pytest.raises(ConfigError, match="one craft and one task"):
        flight("lqr:go-to-pose-2d", "lqr:go-to-pose-3d")
