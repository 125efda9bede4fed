"""Conditions of tests: every effect at once, and each alone."""

from rans import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)

_READING = SensorConditions(noise=(0.0, 0.01), bias=(0.0, 0.01))
_LOST = SensorConditions(noise=(0.0, 0.01), bias=(0.0, 0.01), dropout=(0.0, 0.3))
_KINDS = ("dead", "stuck-open", "stuck", "weak")
_Thrusters = ThrusterConditions
_Disturbances = DisturbanceConditions

EFFECTS = {
    "body": Conditions(BodyConditions(mass=(0.7, 1.4), inertia=(0.7, 1.4), centre=(0.0, 0.03))),
    "thrust": Conditions(
        thrusters=_Thrusters(thrust=(0.7, 1.3), pressure=(0.8, 1.0), droop=(0.0, 0.3))
    ),
    "latency": Conditions(thrusters=_Thrusters(latency=(0.0, 0.1), command_delay=(0.0, 0.2))),
    "rise": Conditions(thrusters=_Thrusters(latency=(0.0, 0.1), rise=(0.0, 0.1))),
    "hold": Conditions(thrusters=_Thrusters(least_on=(0.0, 0.6))),
    "faults": Conditions(faults=FaultConditions(count=(0.0, 2.0), kinds=_KINDS, time=(0.0, 2.0))),
    "named": Conditions(faults=FaultConditions(kinds=_KINDS, time=(0.0, 2.0), thrusters=(2, 0))),
    "recoverable": Conditions(
        faults=FaultConditions(1.0, _KINDS, time=(0.0, 2.0), among="recoverable")
    ),
    "push": Conditions(disturbances=_Disturbances(force=(0.0, 0.3), torque=(0.0, 0.1))),
    "swing": Conditions(disturbances=_Disturbances(slow_force=(0.0, 0.3))),
    "kick": Conditions(disturbances=_Disturbances(kick=(0.0, 1.0))),
    "sensors": Conditions(
        sensors=SensorsConditions(_READING, _READING, _READING, _READING, (0.0, 2.0))
    ),
    "dropout": Conditions(sensors=SensorsConditions(_LOST, SensorConditions(noise=0.01))),
    "outage": Conditions(sensors=SensorsConditions(_READING, outage=(2.0, 4.5))),
    "mountings": Conditions(thrusters=_Thrusters(noise=(0.0, 0.3), misalignment=(0.0, 0.1))),
    "all": Conditions(
        BodyConditions(mass=(0.7, 1.4), inertia=(0.7, 1.4), centre=(0.0, 0.03)),
        _Thrusters(
            (0.7, 1.3),
            (0.8, 1.0),
            (0.0, 0.3),
            (0.0, 0.1),
            (0.0, 0.2),
            (0.0, 0.1),
            (0.0, 0.6),
            (0.0, 0.3),
            (0.0, 0.1),
        ),
        FaultConditions(count=(0.0, 2.0), kinds=_KINDS, time=(0.0, 2.0)),
        _Disturbances((0.0, 0.3), (0.0, 0.1), (0.0, 0.3), (0.0, 1.0)),
        SensorsConditions(_LOST, _LOST, _LOST, _LOST, (0.0, 2.0), (2.0, 4.5)),
    ),
}

PAIRS = Conditions(faults=FaultConditions((0.0, 2.0), _KINDS, time=(0.0, 2.0), among="recoverable"))
"""One or two failing thrusters, which crafts with some to spare can do without."""
