"""Sampling on/off plans settles everywhere, and spends less than looking one period ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rans.errors import ConfigError
from rans.evaluation.measure.metrics import impulses
from rans.flight import fly
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2, map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.optimal.control.sampling import MPPI, Sampling
from rans.optimal.control.switching import Switching
from rans.scenario import Scenario, scenarios
from rans.tasks import TASKS, GoToPose

PLATFORM = load_spacecraft("floating-platform")
SHARED = load_spacecraft("floating-platform-shared")
TASK = GoToPose().for_evaluation()


@pytest.mark.slow
def test_spends_less_than_one_period_of_foresight() -> None:
    """23.2 against 27.9 N s from 64 starts; 8 of them leave half of that to chance."""
    timing = Timing()
    starts = scenarios(TASK, PLATFORM, 52, 8)
    ours, theirs = (
        impulses(fly(PLATFORM, TASK, kind(PLATFORM, TASK, timing), starts, timing)).mean()
        for kind in (MPPI, Switching)
    )
    assert ours < 0.94 * theirs


@pytest.mark.parametrize(
    "craft", [SHARED, load_spacecraft("free-flyer")], ids=lambda craft: craft.name
)
def test_goes_there_with_a_shared_supply_and_in_space(craft: Spacecraft) -> None:
    timing = Timing(episode_steps=60 if craft is SHARED else 32)
    flight = fly(craft, TASK, MPPI(craft, TASK, timing), scenarios(TASK, craft, 53, 2), timing)
    assert flight.errors()["position"][-1].max() < 0.1  # from 3 to 4 m
    if craft is SHARED:
        assert impulses(flight).max() <= 12.0 + 1e-9  # 1 N for 12 s


def test_is_the_same_after_a_reset() -> None:
    timing = Timing(episode_steps=10)
    controller = MPPI(PLATFORM, TASK, timing)
    starts = scenarios(TASK, PLATFORM, 54, 2)
    first, again = (fly(PLATFORM, TASK, controller, starts, timing).commands for _ in range(2))
    assert np.array_equal(first, again)


def test_rests_at_the_goal_and_pushes_towards_it() -> None:
    def at(x: float) -> PlanarState:
        zero = np.zeros(1)
        return PlanarState(Vec2(zero + x, zero), Heading(zero), Vec2(zero, zero), zero)

    controller = MPPI(PLATFORM, TASK, Timing())
    controller.reset(1)
    assert not controller.act(at(0.01), at(0.0), np.zeros((1, 0))).any()
    push = controller.act(at(-2.0), at(0.0), np.zeros((1, 0)))[0] @ np.array(PLATFORM.wrench_map)
    assert push[0] > 1.0  # of 2.8 N
    resting = map_leaves(lambda a, b: np.concatenate([a, b]), at(0.01), at(-2.0))
    controller.reset(2)
    both = controller.act(resting, map_leaves(lambda x: np.zeros(2), resting), np.zeros((2, 0)))
    assert both.any(axis=1).tolist() == [False, True]


def test_throttled_thrusters_give_parts_of_pulses() -> None:
    """A whole pulse of 10 s gives 0.83 m/s, and four metres from the goal docking allows 0.21 m/s."""
    task = TASKS["dock"]().for_evaluation()
    assert task.spacecraft is not None
    craft = load_spacecraft(task.spacecraft)
    drawn = scenarios(task, craft, 1, 1)
    away = replace(drawn.goal.p, x=drawn.goal.p.x + 4.0)
    start = replace(drawn.start, p=away, v=drawn.start.v.scale(0.0))
    flight = fly(craft, task, MPPI(craft, task), Scenario(start, drawn.goal), Timing(10.0, None, 8))
    first = flight.commands[0, 0]
    assert first[1] > first[0]  # along -x, towards the goal
    assert first.max() * 10.0 / craft.mass < 0.21
    assert flight.errors()["position"][-1].max() < 1.0


@pytest.mark.parametrize("settings", [{"samples": 0}, {"rounds": 1.5}, {"temperature": 0.0}])
def test_refuses_draws_that_mean_nothing(settings: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(settings))):
        Sampling(**settings)  # type: ignore[arg-type]
