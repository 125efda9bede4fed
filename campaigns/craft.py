"""Real spacecraft: their authority, the faults they bear, and who flies each best beside what is possible.

``python -m campaigns craft`` computes authority, single faults and bounds, and flies each in the engine and in
Drake.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rans_bounds.hull import least_time, settling_set
from tyro.conf import Positional

from rans.base.files import read_text
from rans.base.structure import read_toml, structure
from rans.episode.scenario import EVALUATION_SEED, each, scenarios
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.any_craft import for_spacecraft, frugal
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.model.authority import authorities, authority_rows
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, bounds
from rans.randomization.conditions_file import load_conditions
from rans.randomization.faults import fault_sets
from rans.tasks import GoToPose, Task


@dataclass(frozen=True)
class RealCraft:
    """Who flies a real craft, and in what."""

    agent: str
    """An agent for any craft, with its value."""
    period: float
    """Control period, s."""
    steps: int
    """Control periods of a flight."""
    conditions: str = "real"
    distance: tuple[float, float] = (3.0, 4.0)
    """From the start to the goal, m."""


CRAFTS = {
    name: structure(row, RealCraft, name)
    for name, row in read_toml(read_text(Path(__file__).with_suffix(".toml"))).items()
}
"""By the names of the craft, of craft.toml."""
_STARTS = 256
"""Of which bounds are averaged: the first of an evaluation."""


def flown(name: str) -> LoadedRun:
    """A real craft with who flies it best, in the task, period and conditions of the craft."""
    setting = CRAFTS[name]
    agent, value = setting.agent.split("#")
    task = GoToPose(spawn_distance=setting.distance, evaluation_distance=setting.distance)
    run = for_spacecraft(
        contestant(f"pretrained:{agent}"),
        load_spacecraft(name),
        Timing(setting.period, 1, setting.steps),
    )._replace(task=task, conditions=load_conditions(setting.conditions))
    return frugal(run, float(value))


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


def least_settling_times(name: str, count: int) -> np.ndarray:
    """Seconds before which nobody has settled in position, of the first evaluation starts: (count,).

    See `rans_bounds.hull.settling_set`; the time that attitude takes is left out.
    """
    run = flown(name)
    craft = luckiest(run.craft, run.conditions)
    task = _task(run.task)
    starts = scenarios(task, run.craft, EVALUATION_SEED, count)
    within = settling_set(
        craft, task.position_tolerance, task.attitude_tolerance, run.timing.control_period
    )
    aimed = "position", "velocity"
    found = (least_time(craft, aimed, one.start, one.goal, within) for one in each(starts))
    return np.array([*found])


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


def agent_facts(name: str, episodes: int) -> dict[str, Any]:
    """Facts of the flights of one craft: its agent, how it flies, period, starts, and the starts' mean bound."""
    run = flown(name)
    flights = fly_episodes(run.controller, run.judged, EVALUATION_SEED, episodes, workers=1)
    found = measure(flights)
    settled = found["solved"]
    return {
        "agent": f"{CRAFTS[name].agent}@{name}",
        "period": run.timing.control_period,
        "seconds": run.timing.control_period * run.timing.episode_steps,
        "distance": list(_task(run.task).spawn_distance),
        "episodes": episodes,
        "settled": [settled.value, settled.low, settled.high],
        **{key: found[key].value for key in ("settling time", "position error", "attitude error")},
        "bound": float(least_settling_times(name, _STARTS).mean()),
    }


def drake_facts(name: str, episodes: int) -> dict[str, Any]:
    """How who flies it settles where Drake moves the craft."""
    run = flown(name)
    flights = fly_episodes(
        run.controller, run.judged, EVALUATION_SEED, episodes, "drake", workers=1
    )
    found = measure(flights)
    return {
        "episodes": episodes,
        "settled": found["solved"].value,
        "settling time": found["settling time"].value,
    }


@dataclass(frozen=True)
class Craft:
    """Measure real craft and their agents."""

    only: Positional[tuple[str, ...]] = ()
    """Names of craft; by default all. The others stay as they are in the evidence."""
    episodes: int = 1024
    """Flights of each craft."""
    drake: int = 64
    """Flights of each craft in Drake; 0: none."""

    def measured(self) -> Iterator[dict[str, Any]]:
        """Authority, single faults, and the flights of each craft."""
        for name in self.only or CRAFTS:
            row = {"name": name, **facts(name), **agent_facts(name, self.episodes)}
            if self.drake:
                row["drake"] = drake_facts(name, self.drake)
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
