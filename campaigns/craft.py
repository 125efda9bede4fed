"""Real spacecraft: their authority, the faults they bear, and the agent of each beside what is possible.

``python -m campaigns.craft`` computes authority, single faults and bounds, flies the agent of each in
Drake too, and writes docs/validation/craft.json and the tables of docs/craft.md. Names after it measure those
anew and keep the others; ``--drake 0`` leaves Drake's flights as they were.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tyro.conf import Positional

from campaigns.markdown import Table
from rans.evaluation.fly.contestants import contestant
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.files import read_json, write_json, write_text
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

COMMAND = "python -m campaigns.craft"
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
_FILE = "validation/craft.json"
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

    names: Positional[tuple[str, ...]] = ()
    """Names of craft; by default all."""
    drake: int = 64
    """Flights of each agent in Drake; 0: none."""

    def run(self) -> int:
        """Write the file and the tables."""
        docs = Path("docs")
        file = docs / _FILE
        found = read_json(file) if file.exists() else {}
        for name in self.names or CRAFTS:
            before = found.get(name, {})
            found[name] = facts(name)
            agent = f"go-to-pose-{CRAFTS[name]}-{name}"
            if agent in pretrained_names():
                found[name] |= agent_facts(agent)
                if self.drake:
                    found[name]["drake"] = drake_facts(agent, self.drake)
                elif "drake" in before:
                    found[name]["drake"] = before["drake"]
            write_json(file, {one: found[one] for one in CRAFTS if one in found})
            draw(name, docs / "pictures/craft")
        for make in (authority_table, agent_table):
            make(docs).write(docs)
        return 0


def draw(name: str, folder: Path) -> None:
    """A small picture of a craft's thrusters: text as text, and coordinates to a tenth of a point."""
    from matplotlib import rc_context

    from rans.drawing import draw_layout, save_picture

    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.svg"
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        save_picture(draw_layout(load_spacecraft(name)), file)
    text = file.read_text("utf-8")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"-?\d+\.\d{2,}", lambda found: f"{float(found[0]):.1f}", text)
    write_text(file, text)


def authority_table(docs: Path) -> Table:
    """Authority and single faults of every craft."""
    rows = []
    for name, one in read_json(docs / _FILE).items():
        forces = [row for row in one["authority"] if row[0].startswith("force")]
        torques = [row for row in one["authority"] if row[0].startswith("torque")]
        count = one["thrusters"]
        rows.append(
            (
                f"`{name}`",
                f"{one['mass']:,.0f}" if one["mass"] >= 1000.0 else f"{one['mass']:.4g}",
                _axes(forces),
                _axes(torques),
                _accelerations(forces),
                _accelerations(torques),
                f"{one['bearable']['dead']} and {one['bearable']['stuck-open']} of {count}",
            )
        )
    headings = (
        "spacecraft",
        "mass, kg",
        "force, N",
        "torque, N m",
        "m/s²",
        "rad/s²",
        "dead, stuck open",
    )
    return Table("craft.md", COMMAND, headings, rows, "")


def agent_table(docs: Path) -> Table:
    """The agent of every craft beside Drake and the bound."""
    rows = []
    for name, one in read_json(docs / _FILE).items():
        if "agent" not in one:
            rows.append((f"`{name}`", "none yet", *[""] * 6))
            continue
        drake = one.get("drake")
        value, low, _ = one["settled"]
        rows.append(
            (
                f"`{one['agent']}`",
                f"{one['period']:g} s, {one['seconds']:g} s",
                f"{one['distance'][0]:g} to {one['distance'][1]:g} m",
                f"{value:.1f} % (≥ {low:.1f})",
                f"{one['settling time']:.1f} s",
                f"{one['bound']:.1f} s",
                f"{one['position error']:.2f} cm, {one['attitude error']:.2f}°",
                ""
                if drake is None
                else f"{drake['settled']:.1f} %, {drake['settling time']:.1f} s",
            )
        )
    headings = (
        "agent",
        "period, flight",
        "starts",
        "settled",
        "median time",
        "no sooner than",
        "errors",
        "in Drake",
    )
    return Table("craft.md", f"{COMMAND}, agents", headings, rows, "")


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


def main(arguments: list[str] | None = None) -> int:
    """Parse and run."""
    import tyro

    return tyro.cli(Craft, args=arguments).run()


if __name__ == "__main__":
    from campaigns.command import ended

    raise SystemExit(ended("python -m campaigns.craft", main))
