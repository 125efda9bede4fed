"""What becomes of a flight, against loops over its steps."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rans import GoToPose, Timing
from rans.episode.verdict import Failure, FlightAccumulator, kinds_of_failure
from rans.model.dynamics import PlanarState
from rans.model.fields import Heading, Vec2
from tests.support.engines import PLATFORM

STEPS = 10
COUNT = 4000
LAST = 2


class History:
    """Random flights: whether they are inside, terminated or lost after each step, their reward, commands."""

    def __init__(self, constrained: bool = False) -> None:
        self.constrained = constrained
        generator = np.random.default_rng(3)
        stay = generator.random((STEPS + 1, COUNT)) < 0.5
        self.inside = np.where(
            generator.random((1, COUNT)) < 0.7, np.arange(STEPS + 1)[:, None] > 3, stay
        )
        self.inside ^= generator.random((STEPS + 1, COUNT)) < 0.04
        self.lost = generator.random((STEPS + 1, COUNT)) < 0.005
        self.failed = generator.random((STEPS + 1, COUNT)) < 0.005
        self.reward = generator.normal(size=(STEPS + 1, COUNT))
        self.command = generator.random((STEPS + 1, 8, COUNT))
        self.margin = generator.choice(
            [1.0, 1e-6, 0.0, -1e-6], (STEPS + 1, COUNT), p=[0.9, 0.04, 0.04, 0.02]
        )

    def verdict(self) -> FlightAccumulator:
        task = SimpleNamespace(
            reached=lambda *_: self.inside[0],
            done=lambda *_: None,
            constraints=lambda *_: {"zone": 0.0} if self.constrained else {},
        )
        world: Any = SimpleNamespace(
            craft=PLATFORM, task=task, timing=Timing(control_period=0.2, episode_steps=STEPS)
        )
        zero = np.zeros(COUNT)
        clock = np.zeros(COUNT, np.int32)
        start: Any = SimpleNamespace(clock=clock, state=None, goal=None)
        verdict = FlightAccumulator.begin(world, start, effort=True)
        for k in range(1, STEPS + 1):
            place = np.where(self.lost[k], np.nan, 0.0)
            state = PlanarState(Vec2(place, zero), Heading(zero), Vec2(zero, zero), zero)
            outcome: Any = SimpleNamespace(
                episode=SimpleNamespace(state=state, clock=clock + k),
                terminated=self.lost[k] | self.failed[k],
                lost=self.lost[k],
                done=None,
                margins={"zone": self.margin[k]} if self.constrained else {},
                reached=self.inside[k],
                reward=np.where(self.lost[k], np.nan, self.reward[k]),
                command=tuple(self.command[k]),
            )
            verdict = verdict.after(world, outcome)
        return verdict

    def judged(self, i: int) -> tuple[int, float]:
        """Failure, and settling instant if it is solved."""
        inside = self.inside[:, i].copy()
        violated = False
        for k in range(1, STEPS + 1):
            violated |= self.constrained and self.margin[k, i] < 0.0
            if self.lost[k, i]:
                return Failure.NOT_FINITE, math.inf
            if self.failed[k, i]:
                return (Failure.VIOLATED if violated else Failure.TERMINATED), math.inf
        if violated:
            return Failure.VIOLATED, math.inf
        end = list(inside[-LAST:])
        settled = math.inf
        if inside[-1]:
            settled = max((k + 1 for k in range(STEPS + 1) if not inside[k]), default=0)
        if all(end):
            return 0, settled
        before = [inside[-LAST - 1], *end]
        if any(a and not b for a, b in pairwise(before)):
            return Failure.LEFT, math.inf
        return (Failure.UNSETTLED if not any(end) else Failure.LATE), math.inf


@pytest.mark.parametrize("constrained", [False, True])
def test_every_flight_is_judged_as_by_hand(constrained):
    history = History(constrained)
    with np.errstate(invalid="ignore"):
        verdict = history.verdict()
    expected = [history.judged(i) for i in range(COUNT)]
    np.testing.assert_array_equal(verdict.failure(), [kind for kind, _ in expected])
    kinds = {0, *kinds_of_failure(GoToPose())} | ({Failure.VIOLATED} if constrained else set())
    assert set(np.unique(verdict.failure())) == kinds
    settled = np.where(verdict.solved, verdict.settled, np.inf)
    np.testing.assert_array_equal(settled, [instant for _, instant in expected])
    np.testing.assert_array_equal(verdict.solved, [kind == 0 for kind, _ in expected])
    ended = (history.lost | history.failed)[1:].any(axis=0)
    np.testing.assert_array_equal(verdict.failed, ended)


def test_sums_go_on_until_a_flight_ends():
    history = History()
    with np.errstate(invalid="ignore"):
        verdict = history.verdict()
    effort = verdict.effort
    assert effort is not None
    gained, impulse, opened = np.zeros((3, COUNT))
    for i in range(COUNT):
        for k in range(1, STEPS + 1):
            command = history.command[k, :, i]
            gained[i] += 0.0 if history.lost[k, i] else history.reward[k, i]
            impulse[i] += 0.2 * sum(
                c * t.force for c, t in zip(command, PLATFORM.thrusters, strict=True)
            )
            opened[i] += command.sum() if k > STEPS - LAST else 0.0
            if history.lost[k, i] or history.failed[k, i]:
                break
    # Ten numbers of order one, added in the same order.
    for found, expected in (
        (effort.gained, gained),
        (effort.impulse, impulse),
        (effort.opened, opened),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
