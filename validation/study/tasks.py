"""What tasks pay, show and call an end, in one state that is worked out by hand for each of them.

Drake's flights are rewarded, shown and ended by the same code as ours. Expected here is what docs/tasks.md
and `rans list TASK` say, written with numbers: 0.25 m, 0.25 rad, 0.5 m/s and 0.5 rad/s from the goal, at
0.05 m/s and 0.2 rad/s, with two valves open of which one was open before.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import cos, exp, sin
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rans.episode import Episode, Outcome, Setup, World, step
from rans.model.dynamics import PlanarState, SpatialState
from rans.model.fields import Heading, Quat, Vec2, Vec3
from rans.model.spacecraft import Spacecraft, Thruster
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, SensorConditions, SensorsConditions
from rans.scenario import draws
from rans.tasks import TASKS, GoToPose, MultiTask, Task
from rans.tasks.go_to_pose_priced import DrawnTradeOff
from rans.tasks.multi_task import DrawnTask
from validation.study.checks import Check
from validation.study.missions import mission_checks

_NEAR = exp(-0.25 / 0.25)
"""Of the narrow rewards of distance and angle."""
_APPROACH = 0.5 * exp(-0.25 / 1.5)
_TURN = 0.5 * exp(-0.25 / 1.0)
_STILL = 0.5 * exp(-0.2 / 0.25)
_FAST = exp(-0.5 / 0.25)
"""Of the narrow rewards of velocity and spin."""
_REWARDS = {
    "go-to-position": _NEAR + _APPROACH + _STILL - 0.02 * 2,
    "go-to-pose": 2 * _NEAR + _APPROACH + _TURN - 0.02 * 2,
    # The scales are 1, 0.25 and 0.02 rad, and 0.02 rad/s; wheels, where there are any, do nothing.
    "go-to-attitude": exp(-0.25 / 1.0)
    + _NEAR * (1.0 + exp(-0.2 / 0.02))
    + exp(-0.25 / 0.02)
    - 0.02 * 2,
    "track-velocity": _FAST + 1.0 * exp(-0.5 / 0.02) + _STILL - 0.02 * 2,
    "track-twist": 2 * _FAST + 0.5 * exp(-0.5 / 0.05) - 0.02 * 2,
    "track-velocity-heading": _FAST + _NEAR + 0.5 * exp(-0.5 / 0.05) + _TURN - 0.05 * 2,
    # With the trade-off in the middle, prices are 0.5 * sqrt(8 / 0.5) = 2 times as high.
    "go-to-pose-priced": 2 * _NEAR + _APPROACH + _TURN - 2 * 0.02 * 2,
}
_FLAGS = {
    "go-to-position": 0.0,
    "go-to-pose": 1.0,
    "go-to-attitude": -1.0,
    "track-velocity": 2.0,
    "track-twist": 3.0,
    "track-velocity-heading": 4.0,
    "go-to-pose-priced": 1.0,
}
_TRADE_OFF = 0.5
_REASON = "The sum of the documented terms: rounding."
_AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


@dataclass(frozen=True)
class Moment:
    """A state and a goal, and the columns that a policy is shown of them."""

    state: Any
    goal: Any
    own: tuple[float, ...]
    """Attitude, velocity, spin."""
    way: tuple[float, ...]
    """To the goal, m in W."""
    turn: tuple[float, ...]
    """Still to make."""
    faster: tuple[float, ...]
    """Velocity still to gain, m/s in W."""
    spin: tuple[float, ...]
    """Still to gain, rad/s."""

    def data(self) -> Mapping[str, tuple[float, ...]]:
        """What each task shows of it."""
        pose = self.way + self.turn
        return {
            "go-to-position": self.way,
            "go-to-pose": pose,
            "go-to-attitude": self.turn,
            "track-velocity": self.faster,
            "track-twist": self.faster + self.spin,
            "track-velocity-heading": self.faster + self.turn,
            "go-to-pose-priced": (*pose, _TRADE_OFF),
        }


def task_checks(craft: Spacecraft) -> Iterator[Check]:
    """Rewards and observations of every task, prices, when episodes end, and what missions declare."""
    craft = _with_three(craft)
    moment = _in_plane() if craft.dimension == 2 else _in_space()
    yield from _reward_checks(craft, moment)
    yield _sight_check(craft, moment)
    yield from _end_checks(craft, moment)
    yield from mission_checks(craft.dimension)


def _in_plane() -> Moment:
    state = PlanarState(Vec2(0.15, -0.2), Heading(0.75), Vec2(0.03, -0.04), -0.2)
    goal = PlanarState(Vec2(0.0, 0.0), Heading(1.0), Vec2(0.33, 0.36), 0.3)
    return Moment(
        state,
        goal,
        (cos(0.75), sin(0.75), 0.03, -0.04, -0.2),
        (-0.15, 0.2),
        (cos(0.25), sin(0.25)),
        (0.3, 0.4),
        (0.5,),
    )


def _in_space() -> Moment:
    attitude = Rotation.from_rotvec([0.4, -0.9, 0.7])
    turn = Rotation.from_rotvec(0.25 * _AXIS)
    spin = 0.2 * np.array([1.0, 2.0, -2.0]) / 3.0
    state = SpatialState(
        Vec3(0.09, -0.12, 0.2), _quat(attitude), Vec3(0.03, -0.04, 0.0), Vec3(*spin)
    )
    goal = SpatialState(
        Vec3(0.0, 0.0, 0.0),
        _quat(attitude * turn),
        Vec3(0.33, 0.36, 0.0),
        Vec3(*(spin + 0.5 * _AXIS)),
    )
    own = (*_two_rows(attitude), 0.03, -0.04, 0.0, *spin)
    return Moment(
        state, goal, own, (-0.09, 0.12, -0.2), _two_rows(turn), (0.3, 0.4, 0.0), tuple(0.5 * _AXIS)
    )


def _reward_checks(craft: Spacecraft, moment: Moment) -> Iterator[Check]:
    for name, expected in _REWARDS.items():
        paid = _arrived(craft, TASKS[name](), moment).reward
        yield _gap(f"tasks: reward of {name}", paid, expected, _REASON)
    several = MultiTask()
    paid = [
        float(_arrived(craft, several, moment, DrawnTask(_FLAGS[name])).reward) - _REWARDS[name]
        for name in several.parts()
    ]
    yield Check(
        "tasks: reward of multi-task",
        max(map(abs, paid)),
        1e-12,
        "-",
        "That of the task which was drawn.",
    )
    # Two valves are open, and the spin is 0.2 rad/s.
    dear = GoToPose(thrust_weight=0.3, spin_weight=0.7)
    prices = 0.3 * 2 + 0.7 * 0.2
    yield _gap(
        "tasks: prices",
        _arrived(craft, dear, moment).reward,
        _REWARDS["go-to-pose"] + 0.02 * 2 - prices,
        _REASON,
    )
    yield _gap(
        "tasks: reward where sensors err",
        _misled(craft, moment).reward,
        _REWARDS["go-to-pose"],
        "Rewards are of the true state, whatever sensors say.",
    )


def _sight_check(craft: Spacecraft, moment: Moment) -> Check:
    """Of every task the documented columns in their order."""
    width = 4 if craft.dimension == 2 else 9
    worst = 0.0
    where = ""
    for name, data in moment.data().items():
        goal = _noted(TASKS[name](), moment.goal)
        shown = World(Setup(craft, TASKS[name]())).observe(Episode(moment.state, goal))
        unused = (0.0,) * (width - len(data))
        expected = (*moment.own, _FLAGS[name], *data, *unused)
        alike = len(shown) == len(expected)
        apart = float(np.abs(np.subtract(shown, expected)).max()) if alike else np.inf
        if not apart <= worst:
            worst = apart
            where = name
    return Check(
        "tasks: observations",
        worst,
        1e-12,
        "SI",
        "Documented columns in their order: rounding.",
        where,
    )


def _end_checks(craft: Spacecraft, moment: Moment) -> Iterator[Check]:
    """Beyond 8 m, or the fastest spin; reached within 5 cm and 5 degrees; cut off after 125 periods."""
    task = GoToPose()
    direction = (0.6, 0.8) if craft.dimension == 2 else (0.6, 0.8, 0.0)
    kind = type(moment.state.p)
    at = {
        far: _arrived(
            craft,
            task,
            replace(
                moment,
                state=replace(
                    moment.state,
                    p=kind(*(far * x for x in direction)),
                    attitude=moment.goal.attitude,
                ),
            ),
        )
        for far in (0.049, 0.051, 7.99, 8.01)
    }
    failed = [bool(at[far].terminated) for far in at] != [False, False, False, True]
    reached = [bool(at[far].reached) for far in at] != [True, False, False, False]
    yield _right("tasks: failing beyond 8 m", not failed)
    yield _right("tasks: reached within 5 cm", not reached)
    tracking = TASKS["track-twist"]()
    spins = [
        _arrived(craft, tracking, replace(moment, state=_spinning(moment.state, rate))).terminated
        for rate in (5.9, 6.1)
    ]
    yield _right("tasks: tracking fails beyond 6 rad/s", [bool(x) for x in spins] == [False, True])
    ends = [bool(_arrived(craft, task, moment, clock=clock).truncated) for clock in (0, 123, 124)]
    yield _right("tasks: cut off after 125 control periods", ends == [False, False, True])


def _arrived(
    craft: Spacecraft,
    task: Task,
    moment: Moment,
    notes: DrawnTask | None = None,
    clock: int = 0,
) -> Outcome:
    """One control period that ends in the state: the first and third valve open, the second alone before."""
    goal = _noted(task, moment.goal) if notes is None else replace(moment.goal, notes=notes)
    episode = Episode(moment.state, goal, clock=clock, commands=(_valves(craft, 1),))
    return step(
        World(Setup(craft, task, Timing())),
        episode,
        _valves(craft, 0, 2),
        None,
        lambda *_: (moment.state,),
    )


def _misled(craft: Spacecraft, moment: Moment) -> Outcome:
    """The same, told to be 50 m away."""
    blind = Conditions(sensors=SensorsConditions(SensorConditions(bias=50.0)))
    own = draws(0, 1)
    world = World(Setup(craft, GoToPose(), Timing(), blind))
    begun = world.begin(moment.state, moment.goal, 0, own)
    # With the tanks full and wheels at rest of the craft's begin.
    return step(world, begun, _valves(craft, 0, 2), own, lambda *_: (begun.state,))


def _noted(task: Task, goal: Any) -> Any:
    return replace(goal, notes=DrawnTradeOff(_TRADE_OFF)) if hasattr(task, "trade_off") else goal


def _valves(craft: Spacecraft, *opened: int) -> tuple[float, ...]:
    """Commands of thrusters, with wheels that do nothing."""
    return tuple(float(k in opened) for k in range(len(craft.commands)))


def _with_three(craft: Spacecraft) -> Spacecraft:
    """The craft with three thrusters at least: nothing is flown, but three are paid for."""
    missing = max(0, 3 - len(craft.thrusters))
    if not missing:
        return craft
    with warnings.catch_warnings(action="ignore"):
        more = craft.thrusters[:1] or (Thruster(craft.centre_of_mass, (1.0, 0.0, 0.0), 1.0),)
        return replace(craft, thrusters=craft.thrusters + more * missing)


def _spinning(state: Any, rate: float) -> Any:
    """About the last axis."""
    return replace(state, w=rate if isinstance(state, PlanarState) else Vec3(0.0, 0.0, rate))


def _gap(name: str, found: Any, expected: float, reason: str) -> Check:
    return Check(name, float(np.abs(np.squeeze(found) - expected)), 1e-12, "-", reason)


def _right(name: str, right: bool) -> Check:
    return Check(name, float(not right), 0.0, "-", "It is so, or it is not.")


def _two_rows(rotation: Rotation) -> tuple[float, ...]:
    return tuple(rotation.as_matrix()[:2].ravel())


def _quat(rotation: Rotation) -> Quat:
    x, y, z, w = rotation.as_quat()
    return Quat(w, x, y, z)
