"""How a mission ends: won, lost by a violated constraint, or by time; and what happens between two commands.

A craft that nothing pushes flies along x at a known speed, so that every instant is worked out by hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from rans import Engine, GoToPose, Timing
from rans.episode.flight import fly
from rans.episode.scenario import scenarios
from rans.episode.step import Setup, World, step
from rans.episode.verdict import Failure
from rans.model.fields import where
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.flight import DrakeMover, fly_in_drake
from tests.support.missions import Pass
from tests.support.played import Played

PLATFORM = load_spacecraft("floating-platform")
SHUT = (0.0,) * len(PLATFORM.thrusters)


def outcomes(task: Pass, checks: int, periods: int, move: Any = None) -> list[Any]:
    """What periods of 1 s with shut thrusters give."""
    world = World(Setup(PLATFORM, task, Timing(1.0, 1, 10, checks)))
    one = scenarios(task, PLATFORM, seed=1, count=1)
    now = world.begin(one.start, one.goal)
    found = []
    for _ in range(periods):
        found.append(step(world, now, SHUT, None, move))
        now = found[-1].episode
    return found


def drake(checks: int) -> DrakeMover:
    return DrakeMover(PLATFORM, Timing(1.0, 1, 10, checks))


@pytest.mark.parametrize("mover", [None, drake], ids=["ours", "drake"])
def test_a_contact_between_two_commands_counts(mover):
    """At 0.8 m/s it is at x = -0.2 m after 1 s and at 0.6 m after 2 s; at the origin after 1.25 s."""
    blind = outcomes(Pass(wall=9.0), 1, 2, mover and mover(1))
    assert [bool(one.done) for one in blind] == [False, False]
    seeing = outcomes(Pass(wall=9.0), 4, 2, mover and mover(4))
    assert [bool(one.done) for one in seeing] == [False, True]
    last = seeing[-1]
    assert [bool(x) for x in (last.terminated, last.at_goal, last.failed)] == [True, True, False]
    assert float(last.terms["done"][0]) == 5.0
    # Looks at x = 0, 0.2, 0.4, 0.6 m: what follows the contact is no violation of anything.
    wall = outcomes(Pass(wall=0.3), 4, 2, mover and mover(4))[-1]
    assert bool(wall.at_goal)
    assert float(wall.margins["wall"][0]) == pytest.approx(0.3, abs=1e-9)
    assert float(wall.terms["violation"][0]) == 0.0


def steady(command: float) -> Played:
    """Gives every thruster one command."""
    return Played(lambda _, count: np.full((count, len(SHUT)), command))


@pytest.mark.parametrize("flying", [fly, fly_in_drake])
def test_what_fails_after_the_contact_in_the_same_period_is_won(flying):
    """At 0.6 m after 2 s it is too far away, but it was at the origin after 1.25 s; with one check it is lost."""
    pilot = steady(0.0)
    task = Pass(wall=9.0, fail_distance=0.5)
    starts = scenarios(task, PLATFORM, seed=1, count=2)
    for checks, failure in ((4, 0), (1, Failure.TERMINATED)):
        flight = flying(PLATFORM, task, pilot, starts, Timing(1.0, 1, 5, checks))
        assert flight.verdict.failure().tolist() == [failure] * 2
        assert bool(outcomes(task, checks, 2)[-1].failed) == bool(failure)


def test_goals_flow_and_remember_at_every_look():
    """After 2 s in eight checks; the farthest way is that of the last check."""
    goal = outcomes(Pass(wall=9.0, lead=1.0), 4, 2)[-1].episode.goal
    assert float(goal.notes.seconds[0]) == pytest.approx(2.0, abs=1e-12)
    assert float(goal.notes.farthest[0]) == pytest.approx(1.6, abs=1e-12)


def test_the_engine_and_environments_end_in_the_same_way():
    """Whether by programs in single precision or by equations in double."""
    timing = Timing(1.0, 1, 4, 4)
    for task, ends in (
        (Pass(wall=9.0), (False, True)),
        (Pass(wall=-0.1), (False, True)),
        (Pass(wall=-0.1, violation_ends=False), (False, True)),
    ):
        expected = outcomes(task, 4, 2)
        for dtype in (torch.float32, torch.float64):
            engine = Engine(PLATFORM, task, 3, timing, seed=1, dtype=dtype)
            for one, over in zip(expected, ends, strict=True):
                result = engine.step(torch.zeros(3, len(SHUT)))
                assert result.terminated.tolist() == [over] * 3
                assert result.at_goal.tolist() == [bool(one.at_goal)] * 3
                named = dict(zip(engine.term_names, result.terms[:, 0].tolist(), strict=True))
                assert named == pytest.approx(
                    {k: float(np.squeeze(v)) for k, v in one.terms.items()}, abs=1e-5
                )
        env = gymnasium.make("rans/GoToPose2D-v0", task=task, timing=timing, spacecraft=PLATFORM)
        _, info = env.reset(seed=1)
        for one, over in zip(expected, ends, strict=True):
            _, _, terminated, truncated, info = env.step(np.zeros(len(SHUT), int))
            assert (terminated, truncated) == (over, False)
            assert info["margins"]["wall"] == pytest.approx(float(one.margins["wall"][0]))
        assert info["is_success"] == bool(expected[-1].at_goal)


def test_looks_do_not_change_the_motion():
    """Turning, pushed, pulsed and late: the end of the period is the same however often one checks."""
    commands = np.random.default_rng(3).integers(0, 2, (20, 4, 8)).astype(float)
    flown = []
    for checks, flying in ((1, fly), (3, fly), (3, fly_in_drake)):
        task = GoToPose()
        starts = scenarios(task, PLATFORM, seed=4, count=4)
        timing = Timing(0.2, 4, 20, checks)
        flown.append(flying(PLATFORM, task, Played(commands), starts, timing).states.p.x)
    np.testing.assert_allclose(flown[1], flown[0], rtol=0, atol=1e-11)
    np.testing.assert_allclose(flown[2], flown[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("flying", [fly, fly_in_drake])
def test_a_flight_stands_still_once_its_mission_is_won(flying):
    """At the origin after 1.25 s, so in the second period, at x = 0.6 m; what it passes later is nothing."""
    pilot = steady(0.0)
    timing = Timing(1.0, 1, 5, 4)
    task = Pass(wall=0.3)
    starts = scenarios(task, PLATFORM, seed=1, count=3)
    flight = flying(PLATFORM, task, pilot, starts, timing)
    assert flight.done.tolist() == [True] * 3
    assert flight.lengths.tolist() == [2] * 3
    np.testing.assert_allclose(flight.states.p.x[:, 0], [-1.0, -0.2, 0.6, 0.6, 0.6, 0.6], atol=1e-9)
    assert not flight.violated().any()
    assert not flight.failed().any()
    np.testing.assert_allclose(flight.margins["wall"][:2, 0], [0.5, 0.3], atol=1e-9)
    assert flight.rewards()["done"].sum(axis=0).tolist() == [5.0] * 3
    assert flight.rewards()["position"][2:].max() == 0.0
    verdict = flight.verdict
    assert verdict.solved.all()
    assert (verdict.settled[verdict.solved] * timing.control_period).tolist() == [2.0] * 3
    lost = flying(PLATFORM, replace(task, wall=-0.1), pilot, starts, timing)
    assert not lost.done.any()
    assert lost.failed().all()
    assert lost.lengths.tolist() == [5] * 3
    assert lost.verdict.failure().tolist() == [Failure.VIOLATED] * 3
    forgiving = replace(task, wall=-0.1, violation_ends=False)
    touched = flying(PLATFORM, forgiving, pilot, starts, timing)
    assert touched.done.all()
    assert not touched.failed().any()
    assert touched.verdict.failure().tolist() == [Failure.VIOLATED] * 3
    slow = flying(
        PLATFORM,
        replace(task, speed=0.01),
        pilot,
        scenarios(replace(task, speed=0.01), PLATFORM, seed=1, count=3),
        timing,
    )
    assert slow.verdict.failure().tolist() == [Failure.UNFINISHED] * 3


@dataclass(frozen=True)
class Cautious:
    """Shuts every thruster right of the line x = ``line``."""

    line: float

    def admitted(self, world: Any, state: Any, goal: Any, command: Any) -> Any:
        beyond = state.p.x > self.line
        changed = beyond & (sum(command) > 0.0)
        return tuple(where(beyond, 0.0, one) for one in command), changed


def test_a_guard_stands_between_policy_and_effectors_in_every_engine():
    """At 0.8 m/s from x = -1 m it is left of -0.5 m at 0 s only, and right of it from 1 s on."""
    guard = Cautious(-0.5)
    task = Pass(wall=9.0, done_weight=0.0, thrust_weight=1.0)
    timing = Timing(1.0, 1, 4)
    engines = [
        Engine(PLATFORM, task, 2, timing, dtype=dtype, guard=guard)
        for dtype in (torch.float32, torch.float64)
    ]
    env = gymnasium.make(
        "rans/GoToPose2D-v0", task=task, timing=timing, spacecraft=PLATFORM, guard=guard
    )
    env.reset(seed=0)
    pilot = steady(1.0)
    starts = scenarios(task, PLATFORM, seed=0, count=2)
    for flying in (fly, fly_in_drake):
        flight = flying(PLATFORM, task, pilot, starts, timing, guard=guard)
        assert flight.commands.sum(axis=2).tolist() == [[8.0] * 2] + [[0.0] * 2] * 3
    for opened in (8.0, 0.0):
        for engine in engines:
            result = engine.step(torch.ones(2, len(SHUT)))
            terms = dict(zip(engine.term_names, result.terms, strict=True))
            assert terms["thrust"].tolist() == [-opened] * 2
        assert env.step(np.ones(len(SHUT), int))[-1]["reward_terms"]["thrust"] == -opened
