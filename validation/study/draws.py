"""What episodes draw, against the ranges that docs/conditions.md and docs/tasks.md declare.

Drake is given what our code has drawn, so that it cannot judge it: here distributions are tested, and that
nothing which is drawn knows of anything else.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rans.episode import Setup, World
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.scenario import draws, scenarios
from rans.tasks import GoToPose
from validation.study.chance import (
    all_pairs,
    even_check,
    independence_check,
    share_check,
    uniform_check,
)
from validation.study.checks import NO_THRUSTERS, Check, Skipped

_COUNT = 8192
"""Episodes: a range whose end is moved by 4 % of it is found."""
_QUANTITIES = ("position", "attitude", "velocity", "spin")
_SENSOR = SensorConditions(noise=(0.1, 0.2), bias=(0.3, 0.6), dropout=(0.2, 0.4))

Ranged = dict[str, tuple[np.ndarray, float, float]]
"""What was drawn (N,), and the bounds it was declared with, by name."""


def draw_checks(craft: Spacecraft, seed: int) -> Iterator[Check | Skipped]:
    """Every range is uniform within its bounds, whole numbers are even, and nothing goes with another."""
    case = _case(craft, _everything(craft), seed)
    groups = {
        "start": _scenario(craft, seed),
        "body and thrust": _body(craft, case),
        "valves": _valves(craft, case),
        "pushes": _pushes(craft, case),
        "sensors": _sensors(case),
    }
    for name, group in groups.items():
        yield uniform_check(f"draws: {name}", group)
    if craft.dimension == 2:
        yield share_check("draws: torques to the left", case.push.torque > 0.0, 0.5)
    yield even_check("draws: delay of readings", case.sensors.delay, 4)
    if craft.thrusters:
        yield from _fault_checks(craft, seed)
    else:
        yield Skipped("draws: faults", NO_THRUSTERS)
    columns = {name: one for group in groups.values() for name, (one, *_) in group.items()}
    yield from _independence_checks(craft, seed, case, columns)


def _everything(craft: Spacecraft) -> Conditions:
    """A range of everything, torques for the craft's inertia; on/off valves alone have least times."""
    moment = craft.inertia[2][2]
    least = {} if craft.actuators.is_continuous else {"least_on": (0.1, 0.6)}
    return Conditions(
        BodyConditions(mass=(0.8, 1.3), inertia=(0.7, 1.5), centre=(0.01, 0.03)),
        ThrusterConditions(
            thrust=(0.7, 1.2),
            droop=(0.1, 0.3),
            latency=(0.02, 0.1),
            command_delay=0.05,
            rise=(0.01, 0.04),
            **least,
        ),
        disturbances=DisturbanceConditions(
            force=(0.1, 0.3),
            torque=(0.01 * moment, 0.02 * moment),
            slow_force=(0.2, 0.5),
            kick=(0.4, 0.6),
        ),
        sensors=SensorsConditions(
            _SENSOR,
            _SENSOR,
            _SENSOR,
            _SENSOR,
            delay=(0.0, 3.0),
            outage=(0.4, 1.0),
        ),
    )


def _case(craft: Spacecraft, conditions: Conditions, seed: int) -> Any:
    """What so many episodes draw, as they do when they begin."""
    task = GoToPose()
    starts = scenarios(task, craft, seed, _COUNT)
    world = World(Setup(craft, task, conditions=conditions))
    return world.begin(starts.start, starts.goal, 0, draws(seed, _COUNT)).parameters


def _scenario(craft: Spacecraft, seed: int) -> Ranged:
    """Starts of `go-to-pose` for training, at rest 0.5 to 4.5 m from the goal in any attitude."""
    start: Any = scenarios(GoToPose(), craft, seed, _COUNT).start
    return {
        **_direction(start.p, "start"),
        "start's distance": (start.p.norm(), 0.5, 4.5),
        **_attitude(start.attitude),
    }


def _attitude(attitude: Any) -> Ranged:
    """A heading; of a rotation uniform over SO(3) the angle and the axis (Shoemake, 1992)."""
    if not hasattr(attitude, "w"):
        return {"start's heading": (np.asarray(attitude.angle), -np.pi, np.pi)}
    w = np.abs(attitude.w)
    angle = 2.0 * np.arctan2(np.sqrt(attitude.x**2 + attitude.y**2 + attitude.z**2), w)
    # The angle has the density (1 - cos) / pi: its distribution function is uniform.
    turned = (angle - np.sin(angle)) / np.pi
    axis = np.sign(attitude.w) * attitude.z / np.sin(angle / 2.0)
    return {
        "start's angle of attitude": (turned, 0.0, 1.0),
        "start's axis of attitude": (axis, -1.0, 1.0),
    }


def _direction(vector: Any, name: str) -> Ranged:
    """Angles in the plane; in space longitudes, and heights on the sphere (Archimedes)."""
    x, y, *z = (np.asarray(column) for column in vector.columns())
    found: Ranged = {f"{name}'s direction": (np.arctan2(y, x), -np.pi, np.pi)}
    if z:
        found[f"{name}'s height"] = (z[0] / np.asarray(vector.norm()), -1.0, 1.0)
    return found


def _size(turn: Any) -> np.ndarray:
    """Of a turn about z, or of a vector."""
    return np.asarray(turn.norm() if hasattr(turn, "norm") else np.abs(turn))


def _body(craft: Spacecraft, case: Any) -> Ranged:
    moment = craft.inertia[2][2]
    # Of the designed body the centre is zero: it is an offset.
    offset = [np.asarray(x) for x in case.body.centre]
    return {
        "mass": (case.body.mass / craft.mass, 0.8, 1.3),
        "inertia": (np.asarray(case.body.inertia[-1]) / moment, 0.7, 1.5),
        "centre of mass": (np.linalg.norm(offset, axis=0), 0.01, 0.03),
        "droop": (case.body.droop, 0.1, 0.3),
        **{
            f"thrust of thruster {k}": (np.asarray(gain), 0.7, 1.2)
            for k, gain in enumerate(case.body.gain)
        },
    }


def _valves(craft: Spacecraft, case: Any) -> Ranged:
    found = {
        "latency and a command delay of 0.05 s": (case.lag.latency, 0.07, 0.15),
        "rise": (case.lag.rise, 0.01, 0.04),
    }
    if craft.actuators.is_continuous:
        return found
    return found | {"least on-time": (case.dwell.on, 0.1, 0.6)}


def _pushes(craft: Spacecraft, case: Any) -> Ranged:
    moment = craft.inertia[2][2]
    return {
        "force": (case.push.force.norm(), 0.1, 0.3),
        **_direction(case.push.force, "force"),
        "torque": (_size(case.push.torque) / moment, 0.01, 0.02),
        "swinging force": (case.swing.amplitude.force.norm(), 0.2, 0.5),
        **_direction(case.swing.amplitude.force, "swinging force"),
        "period of swinging": (2.0 * np.pi / case.swing.rate, 5.0, 25.0),
        "phase of swinging": (case.swing.phase, 0.0, 2.0 * np.pi),
        "kick": (case.kick.impulse.force.norm(), 0.4, 0.6),
        **_direction(case.kick.impulse.force, "kick"),
    }


def _sensors(case: Any) -> Ranged:
    found: Ranged = {}
    for k, name in enumerate(_QUANTITIES):
        found[f"noise of {name}"] = (case.sensors.noise[k], 0.1, 0.2)
        found[f"bias of {name}"] = (_size(case.sensors.bias[k]), 0.3, 0.6)
        found[f"dropout of {name}"] = (case.sensors.dropout[k], 0.2, 0.4)
    outage = case.sensors.outage
    return found | {
        "outage": (outage.fraction / outage.rate, 0.4, 1.0),
        "moment of the first outage": (outage.phase, 0.0, 1.0),
    }


def _fault_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """None, one or two thrusters fail, any of them, dead or stuck open, at any time."""
    count = len(craft.thrusters)
    most = min(2, count)
    faults = FaultConditions(
        count=(0.0, float(most)), kinds=("dead", "stuck-open"), time=(1.0, 20.0)
    )
    fault = _case(craft, Conditions(faults=faults), seed).fault
    gain, leak = (
        np.array([np.broadcast_to(x, _COUNT) for x in part]) for part in (fault.gain, fault.leak)
    )
    lost = gain == 0.0
    yield even_check("draws: number of faults", lost.sum(axis=0), most + 1)
    yield even_check("draws: thruster that fails", np.nonzero(lost)[0], count)
    yield even_check("draws: kind of fault", leak[lost], 2)
    stuck = FaultConditions(count=1.0, kinds=("stuck",), share=(0.3, 0.9))
    leaks = _case(craft, Conditions(faults=stuck), seed).fault.leak
    yield uniform_check(
        "draws: time and share of faults",
        {"time": (fault.begins, 1.0, 20.0), "share": (np.sum(list(leaks), axis=0), 0.3, 0.9)},
    )


def _independence_checks(
    craft: Spacecraft, seed: int, case: Any, columns: dict[str, np.ndarray]
) -> Iterator[Check]:
    """Of one another, of the episode before, of another seed, and of what else is switched on."""
    columns = columns | {
        "delay": case.sensors.delay,
        "kick's step": case.kick.step,
    }
    yield independence_check("draws: each beside the others", all_pairs(columns))
    yield independence_check(
        "draws: each beside the episode before",
        {name: (values[1:], values[:-1]) for name, values in columns.items()},
    )
    other = _case(craft, _everything(craft), seed ^ 1)
    yield independence_check(
        "draws: each beside another seed",
        {
            f"number {k}": (one, two)
            for k, (one, two) in enumerate(zip(_varying(case), _varying(other), strict=True))
        },
    )
    apart = (
        _case(craft, Conditions(disturbances=_everything(craft).disturbances), seed),
        _case(craft, Conditions(sensors=_everything(craft).sensors), seed),
    )
    among = (case.push, case.swing, case.kick), case.sensors
    alone = (apart[0].push, apart[0].swing, apart[0].kick), apart[1].sensors
    changed = max(
        float(np.max(np.abs(np.asarray(a) - b)))
        for a, b in zip(leaves(alone), leaves(among), strict=True)
    )
    yield Check(
        "draws: an effect alone and among others",
        changed,
        0.0,
        "SI",
        "Switching one on changes no other.",
    )


def _varying(case: Any) -> list[np.ndarray]:
    """Every number that differs from episode to episode, but for the episodes' own."""
    fields = (
        np.asarray(x) for x in leaves((case.body, case.lag, case.push, case.swing, case.sensors))
    )
    return [x for x in fields if x.shape == (_COUNT,) and np.ptp(x) > 0.0]
