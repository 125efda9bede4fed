"""Real spacecraft: their authority, the faults they bear, and the agent of each beside what is possible.

``python -m campaigns craft`` computes authority, single faults and bounds, and flies the agent of each in Drake
too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tyro.conf import Positional

from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.model.authority import authorities, authority_rows
from rans.model.fields import map_leaves
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.optimal.certificate.hull import least_time, settling_set
from rans.pretrained import pretrained_card, pretrained_names
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.faults import fault_sets
from rans.scenario import EVALUATION_SEED, scenarios
from rans.tasks import GoToPose, Task

CRAFTS = {
    "pingu": "2d",
    "atmos": "2d",
    "roboran-platform": "2d",
    "freeflyer2": "2d",
    "astrobee-granite": "2d",
    "astrobee-iss": "3d",
    "atmos-orbit-12": "3d",
    "atmos-orbit-16": "3d",
    "spheres": "3d",
    "apollo-csm": "3d",
    "afrl-12kg": "3d",
    "cubesat-3u": "3d",
    "cubesat-6u": "3d",
}
"""Real craft, and where they fly."""
_STARTS = 256
"""Of which bounds are averaged: the first of an evaluation."""


def luckiest(craft: Spacecraft, conditions: Conditions | None) -> Spacecraft:
    """The lightest and strongest craft that conditions may draw, without its wheels.

    Wheels push nothing, and every drawn craft accelerates less than this one: what bounds the time of its
    translation bounds that of all.
    """
    met = conditions or Conditions()
    strength = bounds(met.thrusters.thrust)[1] * bounds(met.thrusters.pressure)[1]
    thrusters = tuple(replace(one, force=one.force * strength) for one in craft.thrusters)
    return replace(
        craft,
        mass=craft.mass * bounds(met.body.mass)[0],
        thrusters=thrusters,
        wheels=(),
    )


def least_settling_times(agent: str, count: int) -> np.ndarray:
    """Seconds before which nobody has settled in position, of the first evaluation starts: (count,).

    See `rans.optimal.certificate.hull.settling_set`; the time that attitude takes is left out.
    """
    run = contestant(f"pretrained:{agent}")
    craft = luckiest(run.craft, run.conditions)
    task = _task(run.task)
    starts = scenarios(task, run.craft, EVALUATION_SEED, count)
    within = settling_set(
        craft, task.position_tolerance, task.attitude_tolerance, run.timing.control_period
    )
    found = []
    for k in range(count):
        start, goal = (
            map_leaves(lambda x, k=k: float(np.broadcast_to(x, count)[k]), state)
            for state in (starts.start, starts.goal)
        )
        found.append(least_time(craft, ("position", "velocity"), start, goal, within))
    return np.array(found)


def _task(task: Task) -> GoToPose:
    """The task with the starts of evaluations; every agent here goes to a pose."""
    judged = task.for_evaluation()
    assert isinstance(judged, GoToPose)
    return judged


def facts(name: str) -> dict[str, Any]:
    """Of a craft: authority, and how many single thrusters may be dead or stuck open."""
    craft = load_spacecraft(name)
    kinds: Any = ("dead", "stuck-open")
    return {
        "authority": [list(row) for row in authority_rows(authorities(craft))],
        "thrusters": len(craft.thrusters),
        "wheels": len(craft.wheels),
        "mass": craft.mass,
        "bearable": {
            kind: sum(one.recoverable for one in fault_sets(craft, 1, kind)) for kind in kinds
        },
    }


def agent_facts(agent: str) -> dict[str, Any]:
    """Of an agent: what its card says, its period and starts, and the mean bound of these."""
    run = contestant(f"pretrained:{agent}")
    card = pretrained_card(agent)
    own = card["evaluation"]["own"][""]
    return {
        "agent": agent,
        "period": run.timing.control_period,
        "seconds": run.timing.control_period * run.timing.episode_steps,
        "distance": list(_task(run.task).spawn_distance),
        "episodes": card["episodes"],
        "settled": own["settled"][:3],
        "settling time": own["settling time"][0],
        "position error": own["position error"][0],
        "attitude error": own["attitude error"][0],
        "bound": float(least_settling_times(agent, _STARTS).mean()),
    }


def drake_facts(agent: str, episodes: int) -> dict[str, Any]:
    """How the agent settles where Drake moves the craft."""
    run = contestant(f"pretrained:{agent}")
    flown = fly_episodes(run.controller, run.judged, EVALUATION_SEED, episodes, "drake", workers=1)
    found = measure(flown.flight)
    return {
        "episodes": episodes,
        "settled": found["settled"].value,
        "settling time": found["settling time"].value,
    }


@dataclass(frozen=True)
class Craft:
    """Measure real craft and their agents."""

    only: Positional[tuple[str, ...]] = ()
    """Names of craft; by default all. The others stay as they are in the evidence."""
    drake: int = 64
    """Flights of each agent in Drake; 0: none."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Authority, single faults, and the agent of each craft."""
        for name in self.only or CRAFTS:
            row = {"name": name, **facts(name)}
            agent = f"go-to-pose-{CRAFTS[name]}-{name}"
            if agent in pretrained_names():
                row |= agent_facts(agent)
                if self.drake:
                    row["drake"] = drake_facts(agent, self.drake)
            yield row


def authority(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table of authority and single faults."""
    for one in evidence["rows"]:
        forces = [row for row in one["authority"] if row[0].startswith("force")]
        torques = [row for row in one["authority"] if row[0].startswith("torque")]
        yield {
            **one,
            "mass": f"{one['mass']:,.0f}" if one["mass"] >= 1000.0 else f"{one['mass']:.4g}",
            "force": _axes(forces),
            "torque": _axes(torques),
            "m/s²": _accelerations(forces),
            "rad/s²": _accelerations(torques),
        }


def agent_cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table of agents; text of flights in Drake, empty where none flew."""
    for one in evidence["rows"]:
        drake = one.get("drake")
        there = "" if drake is None else f"{drake['settled']:.1f} %, {drake['settling time']:.1f} s"
        yield {**one, "there": there}


def _axes(rows: list[list[str]]) -> str:
    """Of three axes the smaller of both ways each, without units, once if all are alike."""
    values = [
        min((row[1], row[2]), key=lambda x: float(x.split()[0].replace(",", ""))).split()[0]
        for row in rows
    ]
    return values[0] if len(set(values)) == 1 else " / ".join(values)


def _accelerations(rows: list[list[str]]) -> str:
    values = [row[3].split()[0] for row in rows]
    return values[0] if len(set(values)) == 1 else " / ".join(values)
