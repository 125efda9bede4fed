"""Agents trained on identified spacecraft, beside agents trained on the data sheet, flown on the hidden craft.

``python -m campaigns.identified_agents prepare FOLDER`` draws hidden craft whose forces and moments of inertia
are up to 20 % off the data sheet, flies and identifies each (`campaigns.identification`); ``train FOLDER`` trains
an agent on each identified spacecraft and its conditions, one on the data sheet as it is, and one on it with ranges
that hold every hidden craft. Trainings run side by side, one a process. Then
``python -m campaigns identified-agents FOLDER`` flies all of them on the hidden craft.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rans_robot.identify.fit import fit, parameters_of
from rans_robot.identify.result import Identification
from tyro.conf import Positional

from campaigns.command import ended
from campaigns.identification import hidden_flights
from rans.api.training import train
from rans.evaluation.fly.agent import load_policy
from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.files import environment, read_json, ready_folder, write_json, write_text
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft, to_toml
from rans.processes import Workers, nothing
from rans.randomization.conditions import Conditions, DisturbanceConditions, ThrusterConditions
from rans.randomization.conditions_file import conditions_text, load_conditions
from rans.scenario import EVALUATION_SEED
from rans.terminal import Terminal, progress, stages

_SHEET = "floating-platform"
_RECIPE = "go-to-pose-2d-robust"
_OFF = (0.8, 1.2)
"""Forces and moments of inertia of hidden craft over those of the data sheet."""
_ASKED = 97.0
"""%: part of the flights that an agent is asked to solve."""
_NAMES = {
    "identified": "the identified spacecraft and its conditions, one agent a craft",
    "ranges": "the data sheet, with ranges that hold every hidden craft",
    "sheet": "the data sheet, with the noise of the readings alone",
}


def _ranges() -> Conditions:
    """`lab` with forces and inertia 20 % off, and the mass weighed: what the hidden craft are drawn from."""
    lab = load_conditions("lab")
    return replace(
        lab,
        body=replace(lab.body, mass=1.0, inertia=_OFF),
        thrusters=replace(lab.thrusters, thrust=_OFF),
        description="a data sheet with errors of 20 %, in the laboratory",
    )


def _hidden(sheet: Spacecraft, truth: np.ndarray) -> tuple[Spacecraft, Conditions]:
    """A hidden craft of the plane, and the conditions under which it flies, of its true parameters (P,)."""
    value = dict(zip((one.name for one in parameters_of(sheet)), map(float, truth), strict=True))
    inertia = [list(row) for row in sheet.inertia]
    inertia[2][2] = value["inertia zz"]
    x, y, z = sheet.centre_of_mass
    craft = replace(
        sheet,
        name=f"{sheet.name}-hidden",
        inertia=tuple(map(tuple, inertia)),
        centre_of_mass=(x + value["centre x"], y + value["centre y"], z),
        thrusters=tuple(
            replace(thruster, force=value[f"force of thruster {k}"])
            for k, thruster in enumerate(sheet.thrusters)
        ),
    )
    force = float(np.hypot(value["disturbance x"], value["disturbance y"]))
    torque = abs(value["torque z"])
    conditions = Conditions(
        thrusters=ThrusterConditions(
            latency=(value["latency"], value["latency"]),
            rise=(value["rise"], value["rise"]),
        ),
        disturbances=DisturbanceConditions(force=(force, force), torque=(torque, torque)),
        sensors=load_conditions("lab").sensors,
        description="a hidden craft; its disturbance has a random direction in each flight",
    )
    return craft, conditions


def _prepared(
    _: None, folder: Path, number: int, log: Any, truth: np.ndarray, sheet: Spacecraft
) -> None:
    """Identify one hidden craft, and write what it is and what was identified."""
    own = ready_folder(folder / f"{number:02d}")
    Identification(fit(sheet, [log])).write(own)
    craft, conditions = _hidden(sheet, truth)
    write_text(own / "hidden.toml", to_toml(craft))
    write_text(own / "hidden-conditions.toml", conditions_text(conditions))


def _trained(
    _: None, run: Path, craft: str, conditions: str, steps: int, device: str | None
) -> float:
    """Train one agent, and return its seconds."""
    began = time.monotonic()
    train(
        _RECIPE,
        craft,
        conditions=conditions,
        device=device,
        total_timesteps=steps,
        output=run,
        progress=False,
    )
    return time.monotonic() - began


def _solved(_: None, agent: Path, hidden: Path, episodes: int) -> float:
    """Part of the flights, %, in which an agent takes a hidden craft to its goal and keeps it there."""
    run = load_policy(agent)._replace(craft=load_spacecraft(str(hidden / "hidden.toml")))
    run = run.under(load_conditions(str(hidden / "hidden-conditions.toml")))
    flight = fly_episodes(run.controller, run.judged, EVALUATION_SEED, episodes).flight
    return float(measure(flight)["solved"].value)


def _hidden_folders(folder: Path) -> list[Path]:
    return sorted(path.parent for path in folder.glob("*/hidden.toml"))


@dataclass(frozen=True)
class Prepare:
    """Draw hidden craft, fly them for 60 s and identify them."""

    folder: Positional[Path]
    """Where they are written."""
    count: int = 16
    """Number of hidden craft."""
    seed: int = 64
    """Seed of the hidden craft and of their commands."""

    def run(self) -> int:
        """Write a folder for each craft."""
        sheet = load_spacecraft(_SHEET)
        logs, truth = hidden_flights(sheet, self.count, 60.0, 0.2, self.seed, _ranges())
        jobs = [(self.folder, k, log, truth[k], sheet) for k, log in enumerate(logs)]
        write_text(ready_folder(self.folder) / "ranges.toml", conditions_text(_ranges()))
        as_designed = Conditions(sensors=_ranges().sensors, description="as designed; noise of lab")
        write_text(self.folder / "sheet.toml", conditions_text(as_designed))
        _done(f"{self.count} hidden craft", "identified craft", _prepared, jobs)
        return 0


@dataclass(frozen=True)
class Train:
    """Train an agent on each identified craft, and two on the data sheet, one process each."""

    folder: Positional[Path]
    """Folder that ``prepare`` has written, with the identified craft."""
    steps: int = 200_000_000
    """Environment steps of each training."""
    device: str | None = None
    """Where to train, "cuda" or "cpu"; None: a GPU if there is one."""
    workers: int | None = None
    """Number of processes; None: one per processor."""

    def run(self) -> int:
        """Write the trainings into the folder."""
        trainings = [
            (self.folder / name, _SHEET, str(self.folder / f"{name}.toml"))
            for name in ("ranges", "sheet")
        ]
        for own in _hidden_folders(self.folder):
            identified = str(own / "spacecraft.toml"), str(own / "conditions.toml")
            trainings.append((own / "agent", *identified))
        jobs = [(*one, self.steps, self.device) for one in trainings]
        seconds = _done(f"{len(jobs)} trainings", "trained agents", _trained, jobs, self.workers)
        Terminal().say(f"A training takes {np.median(seconds):.0f} s in the median.")
        found = {
            "steps": self.steps,
            "median seconds of a training": float(np.median(seconds)),
            "environment": environment(),
        }
        write_json(self.folder / "trainings.json", found)
        return 0


@dataclass(frozen=True)
class Fly:
    """Fly all agents on the hidden craft."""

    folder: Positional[Path]
    """Folder of the identified craft and of the agents that were trained for them."""
    episodes: int = 1024
    """Flights of an agent on each craft."""

    def measured(self) -> dict[str, Any]:
        """Flights that are solved, %, by what the agents were trained on."""
        folders = _hidden_folders(self.folder)
        agents = {
            "identified": [own / "agent" for own in folders],
            "ranges": [self.folder / "ranges"] * len(folders),
            "sheet": [self.folder / "sheet"] * len(folders),
        }
        jobs = [
            (agent, own, self.episodes)
            for row in agents.values()
            for agent, own in zip(row, folders, strict=True)
        ]
        solved = np.reshape(
            _done(f"{len(jobs)} agents and craft", "flown agents", _solved, jobs),
            (len(agents), -1),
        )
        return {
            "craft": len(folders),
            "flights": self.episodes,
            "solved": {name: list(row) for name, row in zip(agents, solved, strict=True)},
            "trainings": read_json(self.folder / "trainings.json"),
        }


def _done(
    title: str,
    work: str,
    function: Callable[..., Any],
    jobs: Sequence[tuple[Any, ...]],
    workers: int | None = None,
) -> list[Any]:
    """Answers of a function to all jobs in other processes, with progress."""
    answers = []
    with progress() as bars:
        stage = stages(bars)(title, len(jobs))
        for answer in Workers(nothing, count=workers, work=work).ordered(function, jobs):
            answers.append(answer)
            stage(1)
    return answers


def cells(evidence: Any) -> Iterator[dict[str, Any]]:
    """Rows of the table."""
    for name, solved in evidence["solved"].items():
        yield {
            "trained": _NAMES[name],
            "mean": np.mean(solved),
            "least": min(solved),
            "enough": sum(x >= _ASKED for x in solved),
            "craft": len(solved),
        }


if __name__ == "__main__":
    commands = tyro.extras.subcommand_cli_from_dict
    raise SystemExit(
        ended(
            "identified_agents",
            lambda: commands({"prepare": Prepare, "train": Train}).run(),
        )
    )
