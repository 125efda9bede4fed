"""What agents hold under every perturbation alone, and under all of `lab`.

``python -m campaigns robustness`` flies run folders and ``pretrained:NAME``, on a GPU if there is one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tyro.conf import Positional

from campaigns.batch import Rows, study
from rans.base.files import number, read_json
from rans.episode.scenario import EVALUATION_SEED
from rans.episode.step import Setup
from rans.evaluation.measure.statistics import share
from rans.fast.flights import Flights
from rans.policy.network import Network
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

_FINE = SensorConditions(noise=(0.0, 0.03))
_COARSE = SensorConditions(noise=(0.0, math.radians(3.0)))
SINGLE: dict[str, Conditions] = {
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
"""Single disturbances, each over the whole range in which it broke agents that were trained without any."""
_TITLES = {
    "none": "none",
    "lab": "`lab`, all at once",
    "latency": "latency of valves and commands 0 to 200 ms",
    "rise": "thrust rises in 0 to 100 ms",
    "least on-time": "valves open at least 0.4 s",
    "mass": "mass x 0.7 to 2",
    "inertia": "inertia x 0.5 to 2",
    "centre of mass": "centre of mass 0 to 3 cm off",
    "force": "force 0 to 0.3 N",
    "torque": "torque 0 to 0.1 N m",
    "noise": "noise 0 to 3 cm, 3 degrees, 3 cm/s, 3 degrees/s",
    "noise, worst": "noise, all of it",
    "inertia halved": "inertia x 0.5",
    "spin missed": "30 % of the angular velocities missed",
    "all missed": "30 % of every reading missed",
    "outages": "no readings for 1 s every 5 s",
    "lab-dropouts": "`lab-dropouts`",
    "latency 220 ms": "latency 220 ms",
    "latency 260 ms": "latency 260 ms",
    "thruster dead": "one thruster dead",
}
"""What the document calls its rows."""


def rows() -> dict[str, Conditions]:
    """What is flown in: nominal conditions, `lab`, every perturbation over its range and at its end."""
    # Late commands and late valves add up to one latency: two rows would be one twice.
    single = {name: found for name, found in SINGLE.items() if name != "delay"}
    worst = {
        f"{name}, worst": _at_worst(found)
        for name, found in single.items()
        if name not in ("least on-time", "inertia")
    }
    halved = Conditions(body=BodyConditions(inertia=0.5))
    missed = SensorConditions(dropout=0.3)
    sensors = {
        "spin missed": SensorsConditions(spin=missed),
        "all missed": SensorsConditions(missed, missed, missed, missed),
        "outages": SensorsConditions(outage=1.0),
    }
    return {
        "none": Conditions(),
        "lab": load_conditions("lab"),
        **single,
        **worst,
        "inertia halved": halved,
        **{name: Conditions(sensors=x) for name, x in sensors.items()},
        "lab-dropouts": load_conditions("lab-dropouts"),
        **_beyond(),
    }


def _beyond() -> dict[str, Conditions]:
    """Conditions that no training of a robust agent had: where they stop."""
    latencies = {f"latency {ms} ms": ThrusterConditions(latency=ms / 1000.0) for ms in (220, 260)}
    dead = FaultConditions(count=1.0, kinds=("dead",))
    return {
        **{name: Conditions(thrusters=x) for name, x in latencies.items()},
        "thruster dead": Conditions(faults=dead),
    }


def _at_worst(given: Any) -> Any:
    """The same with every range at its largest."""
    values = {one.name: getattr(given, one.name) for one in fields(given)}
    return replace(
        given,
        **{
            name: _at_worst(x) if is_dataclass(x) else x[1]
            for name, x in values.items()
            if is_dataclass(x) or (isinstance(x, tuple) and set(map(type, x)) == {float})
        },
    )


def flown_by_agent(
    network: Network, setup: Setup, conditions: Conditions, episodes: int, seed: int, device: str
) -> dict[str, Any]:
    """What is said of an agent in one world, from the outcomes of whole flights."""
    world = setup._replace(conditions=conditions.or_none)
    found = Flights(network, world, device).fly(0, episodes, seed)
    held = share(np.arange(found.flights) >= found.unsolved)
    return {
        "held": {key: 100.0 * x for key, x in asdict(held).items()},
        "settling time": found.settling_step() * setup.timing.control_period,
        "duty at rest": 100.0 * found.sums["duty at rest"].mean,
    }


@dataclass(frozen=True)
class Robustness:
    """Fly agents under every perturbation."""

    agents: Positional[tuple[str, ...]]
    """Run folders, or pretrained:NAME; all of one task and spacecraft."""
    episodes: int = 10_000
    seed: int = EVALUATION_SEED

    def measured(self) -> dict[str, Any]:
        """By agent and row.

        Raises:
            ConfigError: there is no such agent.
        """

        def measure(network: Network, setup: Setup, device: str) -> Rows:
            return {
                row: flown_by_agent(network, setup, found, self.episodes, self.seed, device)
                for row, found in rows().items()
            }

        return {"agents": study(self.agents, measure)}


def in_document(docs: Path) -> tuple[tuple[str, ...], Sequence[tuple[str, ...]]]:
    """The table of robustness.md: of every figure the worst training, in the plane and in space."""
    found = [
        read_json(docs / "validation" / f"{name}.json")["agents"].values()
        for name in ("robustness", "robustness-space")
    ]
    rows = [
        (title, *(cell for agents in found for cell in _worst([agent[row] for agent in agents])))
        for row, title in _TITLES.items()
    ]
    headings = (
        "perturbation",
        "plane: solved",
        "settling, s",
        "space: solved",
        "settling, s",
    )
    return headings, rows


def _worst(said: list[dict[str, Any]]) -> tuple[str, str]:
    settles = max(number(one["settling time"]) for one in said)
    return (
        f"{min(one['held']['value'] for one in said):.2f}",
        f"{settles:.1f}" if math.isfinite(settles) else "never",
    )
