"""What each effect of conditions costs an engine's step: operations, and steps per second on a GPU.

``python -m campaigns.speed.conditions [--num-envs N]`` prints a table for the plane and one for space,
of engines that draw again in every step what their episodes have drawn. Without a GPU there are only counts,
as in docs/speed.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from rans.fast.engine import Engine
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.randomization.conditions import (
    BodyConditions,
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)
from rans.randomization.conditions_file import load_conditions
from rans.tasks import GoToPose
from validation.speed.engine import engine_rate
from validation.speed.measurement import Clock
from validation.speed.roofline import step_work

_BODY = BodyConditions(mass=(0.75, 1.25), inertia=(0.75, 1.25), centre=(0.0, 0.02))
_THRUST = ThrusterConditions(thrust=(0.75, 1.25), pressure=(0.75, 1.0), droop=(0.0, 0.3))
_LATE = ThrusterConditions(latency=(0.0, 0.1))
_SLOW = ThrusterConditions(latency=(0.0, 0.1), rise=(0.0, 0.06))
_FAULT = FaultConditions(count=(0.0, 1.0), time=(0.0, 25.0))
_BIAS = SensorConditions(bias=(0.0, 0.01))
_NOISE = SensorConditions(noise=(0.0, 0.01))

EFFECTS: dict[str, Conditions] = {
    "mass, inertia, centre": Conditions(_BODY),
    "thrust, pressure, droop": Conditions(thrusters=_THRUST),
    "latency": Conditions(thrusters=_LATE),
    "latency and rise": Conditions(thrusters=_SLOW),
    "force": Conditions(disturbances=DisturbanceConditions(force=(0.0, 0.25))),
    "torque": Conditions(disturbances=DisturbanceConditions(torque=(0.0, 0.03))),
    "swing": Conditions(
        disturbances=DisturbanceConditions(slow_force=(0.0, 0.25), slow_torque=(0.0, 0.03))
    ),
    "kick": Conditions(disturbances=DisturbanceConditions(kicks=1, kick=(0.0, 0.5))),
    "a fault": Conditions(faults=_FAULT),
    "sensor bias": Conditions(sensors=SensorsConditions(_BIAS, _BIAS, _BIAS, _BIAS)),
    "sensor noise": Conditions(sensors=SensorsConditions(_NOISE, _NOISE, _NOISE, _NOISE)),
    "every effect an episode draws": Conditions(
        _BODY,
        ThrusterConditions((0.75, 1.25), (0.75, 1.0), (0.0, 0.3), (0.0, 0.1), 0.0, (0.0, 0.06)),
        _FAULT,
        DisturbanceConditions(
            (0.0, 0.25),
            (0.0, 0.03),
            (0.0, 0.25),
            (0.0, 0.03),
            (5.0, 25.0),
            1,
            (0.0, 0.5),
            (0.0, 0.05),
        ),
        SensorsConditions(_BIAS, _BIAS, _BIAS, _BIAS),
    ),
    **{name: load_conditions(name) for name in ("roboran", "lab", "orbit", "harsh")},
}
"""All but what needs more memory: readings that are late or drop out, and valves that stay for a time."""


@dataclass(frozen=True)
class Cost:
    """Of one effect."""

    name: str
    substeps: int
    operations: int
    """Of a step."""
    bytes_moved: int
    rate: float | None
    """M steps/s; None: there is no GPU."""


def costs(craft: Spacecraft, num_envs: int, clock: Clock) -> Iterator[Cost]:
    """Of a perfect world, then of every effect."""
    for name, conditions in {"a perfect world": None, **EFFECTS}.items():
        engine = Engine(craft, GoToPose(), 1, conditions=conditions)
        work = step_work(engine, remember=False)
        rate = None
        if clock.on_gpu:
            rate = engine_rate(craft, GoToPose(), num_envs, clock, conditions=conditions).value
        yield Cost(
            name,
            engine._world.timing.substeps or 1,
            sum(work.operations.values()),
            work.bytes_moved,
            rate,
        )


def table(found: list[Cost]) -> str:
    """In Markdown."""
    perfect = found[0].rate
    head = ["effect", "substeps", "operations", "bytes", "G steps/s", "share of a perfect world's"]
    rows = [head, ["---"] * len(head)]
    for one in found:
        timed = (
            ["", ""]
            if one.rate is None or perfect is None
            else [f"{one.rate / 1e3:.2f}", f"{100 * one.rate / perfect:.0f} %"]
        )
        rows.append(
            [one.name, str(one.substeps), f"{one.operations:,}", str(one.bytes_moved), *timed]
        )
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--num-envs", type=int, default=2**22)
    parser.add_argument("--repeats", type=int, default=7)
    given = parser.parse_args()
    clock = Clock("cuda" if torch.cuda.is_available() else "cpu", given.repeats)
    for name in ("floating-platform", "free-flyer"):
        found = list(costs(load_spacecraft(name), given.num_envs, clock))
        sys.stdout.write(f"\n{name}, {given.num_envs:,} environments\n\n{table(found)}\n")


if __name__ == "__main__":
    main()
