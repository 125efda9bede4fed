"""Goal sets of tasks and pulses of certificates."""

import math
from dataclasses import replace
from typing import Any

import pytest
from rans_bounds.goal_set import GoalSet, goal_set, pulse

from rans import ConfigError
from rans.episode.verdict import Failure, kinds_of_failure
from rans.evaluation.compare.bounds import rounded_up
from rans.model.fields import absolute, sin
from rans.model.spacecraft_file import load_spacecraft
from rans.tasks import GoToPose, TrackTwist, TrackVelocity
from rans.tasks.shapes import Ball
from tests.support.tiny_lattice import lopsided

PLATFORM = load_spacecraft("floating-platform")


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.0, 0.2, 0.0),
        (-1.0, 0.2, 0.0),
        (0.6, 0.2, 0.6),
        (3 * 0.2, 0.2, 0.6),
        (0.601, 0.2, 0.8),
        (math.inf, 0.2, math.inf),
    ],
)
def test_rounded_up(value, unit, expected):
    """0.6 / 0.2 is 2.9999999999999996 and 0.6000000000000001 / 0.2 is 3.0000000000000004."""
    assert rounded_up(value, unit) == pytest.approx(expected)


def test_pulses_of_a_craft():
    assert pulse(PLATFORM, 0.25) == pytest.approx(0.25)
    assert pulse(replace(PLATFORM, thrust_sharing="split"), 0.25) == pytest.approx(0.25)
    assert pulse(lopsided(), 0.25) is None


def test_goal_set_of_a_task():
    """Tolerances of the task, rest (5 cm/s, 5 degrees/s) beside a place, nothing for what is left open."""
    degrees = math.radians(5.0)
    assert goal_set(GoToPose()) == GoalSet(0.05, 0.05, degrees, degrees)
    tracked = TrackVelocity()
    assert goal_set(tracked) == GoalSet(0.0, tracked.tolerances()["velocity"], 0.0, degrees)


class OnALine(GoToPose):
    """Reached wherever y is that of the goal."""

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        """See the base."""
        return super().errors(state, goal) | {"position": absolute(goal.p.y - state.p.y)}


class EitherEnd(GoToPose):
    """Reached with the nose at the goal or away from it."""

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        """See the base."""
        angle = state.attitude.to(goal.attitude).magnitude()
        return super().errors(state, goal) | {"attitude": absolute(sin(angle))}


class RollsFreely(TrackTwist):
    """Tracked whatever the spin about the craft's first axis is."""

    dimensions = (3,)

    def errors(self, state: Any, goal: Any) -> dict[str, Any]:
        """See the base."""
        return super().errors(state, goal) | {"spin": absolute(state.w.z - goal.w.z)}


class BesideAWall(GoToPose):
    """With a constraint."""

    def limits(self, goal: Any) -> dict[str, Any]:
        """A ball to keep out of."""
        return {"wall": Ball(goal.p, goal.v, 0.1)}


def test_what_leaves_a_direction_free_or_has_limits_is_not_bounded():
    """Bounds for the whole pose would be beaten by its flights, and those without limits say too little."""
    for free, quantity in ((OnALine, "position"), (EitherEnd, "attitude"), (RollsFreely, "spin")):
        with pytest.raises(
            ConfigError, match=f"{free.__name__} counts as .* tolerance of {quantity}"
        ):
            goal_set(free())
    with pytest.raises(ConfigError, match="without constraints, and BesideAWall has some"):
        goal_set(BesideAWall())
    assert Failure.VIOLATED in kinds_of_failure(BesideAWall())
    assert Failure.VIOLATED not in kinds_of_failure(OnALine())
