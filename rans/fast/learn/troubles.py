"""What the robust agents are trained in: a laboratory at its worst, or one trouble at a time."""

from __future__ import annotations

from dataclasses import replace
from math import radians

from rans.model.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.model.conditions_file import load_conditions

_QUANTITIES = ("position", "attitude", "velocity", "spin")
_FINE, _COARSE = (SensorConditions(noise=(0.0, size)) for size in (0.03, radians(3.0)))

TROUBLES: dict[str, Conditions] = {
    "latency": Conditions(thrusters=ThrusterConditions(latency=(0.0, 0.2))),
    "delay": Conditions(thrusters=ThrusterConditions(command_delay=(0.0, 0.2))),
    "rise": Conditions(thrusters=ThrusterConditions(rise=(0.0, 0.1))),
    "least on-time": Conditions(thrusters=ThrusterConditions(least_on=0.4)),
    "mass": Conditions(body=BodyConditions(mass=(0.7, 2.0))),
    "inertia": Conditions(body=BodyConditions(inertia=(0.5, 2.0))),
    "centre of mass": Conditions(body=BodyConditions(centre=(0.0, 0.03))),
    "force": Conditions(disturbances=DisturbanceConditions(force=(0.0, 0.3))),
    "torque": Conditions(disturbances=DisturbanceConditions(torque=(0.0, 0.1))),
    "noise": Conditions(sensors=SensorsConditions(_FINE, _COARSE, _FINE, _COARSE)),
}
"""Each alone, over the whole range in which it broke agents that knew one perfect world."""


_FINER, _COARSER = (SensorConditions(noise=(0.6 * size, size)) for size in (0.03, radians(3.0)))
_HARD = (
    Conditions(thrusters=ThrusterConditions(latency=(0.15, 0.2))),
    Conditions(thrusters=ThrusterConditions(command_delay=(0.15, 0.2))),
    Conditions(body=BodyConditions(inertia=(0.5, 0.7))),
    Conditions(thrusters=ThrusterConditions(least_on=0.4), weight=4.0),
    Conditions(sensors=SensorsConditions(_FINER, _COARSER, _FINER, _COARSER), weight=6.0),
)
"""The ends of those ranges that are learnt last, as often as they need it."""
_OTHER_BODY = BodyConditions(mass=(0.8, 1.25), inertia=(0.8, 1.25), centre=(0.0, 0.02))
"""Than promised, by so much that thrust seems a fourth weaker or stronger."""


def _failing() -> Conditions:
    """`faults`, and as often with all of them there from the start, of which an agent sees too few else."""
    late = load_conditions("faults")
    return replace(
        late, others=(replace(late, faults=replace(late.faults, count=(1.0, 2.0), time=0.0)),)
    )


def failing_in_other_bodies(weight: float = 0.06) -> Conditions:
    """`faults`, and as often there from the start; each with this weight in other bodies as well.

    Who has met weaker accelerations than promised holds thrusters at a share of their force, which no
    training has; who meets them often brakes early in every flight (decision 018).
    """
    given = _failing()
    return replace(
        given,
        others=(
            *given.others,
            *(
                replace(one, body=_OTHER_BODY, others=(), weight=weight)
                for one in (given, *given.others)
            ),
        ),
    )


def robust(share: float = 0.4) -> Conditions:
    """`lab` in this share of the episodes, else a perfect world or a trouble, the hard ends oftener."""
    others = Conditions(), *TROUBLES.values(), *_HARD
    weight = sum(one.weight for one in others) * share / (1.0 - share)
    return replace(load_conditions("lab"), weight=weight, others=others)


def robust_poses(
    valves: float, noise: float = 6.0, lab: float = 20.0, missed: float = 0.0
) -> Conditions:
    """`robust`, as often with `lab` and what is learnt last of poses: valves that stay open, noise.

    Missed readings, alone and in `lab`, have the given weight.
    """
    given = robust()
    slow = Conditions(thrusters=ThrusterConditions(least_on=0.4))
    noisy = _HARD[-1].sensors
    others = tuple(
        replace(one, weight=valves)
        if replace(one, weight=1.0) == slow
        else replace(one, weight=noise)
        if one.sensors == noisy
        else one
        for one in given.others
    )
    if missed:
        lab_missed = load_conditions("lab-dropouts")
        alone = replace(
            Conditions(),
            sensors=replace(
                lab_missed.sensors,
                **{name: SensorConditions(dropout=(0.0, 0.4)) for name in _QUANTITIES},
            ),
        )
        others = *others, replace(alone, weight=0.5 * missed), replace(lab_missed, weight=missed)
    return replace(given, others=others, weight=lab)
