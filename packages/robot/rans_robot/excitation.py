"""Folders that `rans fly` flies as agents, with the most informative commands about a spacecraft."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import (
    ConfigError,
    Spacecraft,
    positive,
    ready_folder,
    to_toml,
    write_json,
    write_text,
)
from rans.files import package_version, replace_file
from rans_robot.identify import excite
from rans_robot.identify.motion import check_identifiable

_PAIRS = 32
"""Golden pairs: observations and commands by which a flight checks that the files belong together."""
_OLDEST = 3.0
"""Age of a reading, in control periods, beyond which valves are shut."""

_AGENT = '''

FOLDER = Path(__file__).parent


class Agent:
    """Observations of RANS's task go-to-pose, whose goal is the middle of the box, to commands."""

    def __init__(self, tables=FOLDER / "agent.npz"):
        with np.load(tables, allow_pickle=False) as file:
            self.tables = dict(file)
        self.reset()

    def reset(self, count=1):
        """Begin the commands from the first."""
        t = self.tables
        self.excitation = Excitation(
            *(t[name] for name in ("wrenches", "mass", "inertia", "low", "period", "side")), int(t["seed"])
        )
        self.steps = 0
        self.note = ""

    def act(self, observation):
        """Commands (thrusters,) to an observation, in float32; zeros once the time is up."""
        row = np.asarray(observation, dtype=float)
        if self.steps >= int(self.tables["steps"]):
            self.note = "the commands are over."
            return np.zeros(len(self.tables["low"]), np.float32)
        self.steps += 1
        if self.excitation.d == 2:  # cosine and sine of the heading, velocity, spin, a flag, the way to the goal
            c, s = row[:2]
            parts = -row[6:8], np.array([[c, -s], [s, c]]), row[2:4], row[4:5]
        else:
            x, y = row[:3], row[3:6]
            parts = -row[13:16], np.array([x, y, np.cross(x, y)]), row[6:9], row[9:12]
        return self.excitation.choose(*parts).astype(np.float32)


def check(file=FOLDER / "golden.json"):
    """How many of the golden pairs come out as they should, and how many there are."""
    pairs, agent = json.loads(Path(file).read_text("utf-8")), Agent()
    rows = zip(pairs["observation"], pairs["command"])
    return sum(bool(np.array_equal(agent.act(row), command)) for row, command in rows), len(pairs["command"])
'''
"""What agent.py has beside the text of `rans_robot.identify.excite`."""


def write_excitation(
    craft: Spacecraft, folder: Path, side: float, seconds: float, period: float, seed: int
) -> Path:
    """Write an agent with the most informative commands about a spacecraft, and return its folder.

    Names of tables are those that the text of `_AGENT` reads; `excite.py` is copied into agent.py as it stands.

    Args:
        craft: spacecraft as designed.
        folder: new folder.
        side: side of the box in which it stays, m, round the goal of the flight.
        seconds: s, after which all valves stay shut.
        period: control period, s.
        seed: of the random commands among which it chooses.

    Raises:
        ConfigError: the spacecraft cannot be identified (`check_identifiable`), a number is not above 0, the folder
            exists, or the disk refuses.
    """
    check_identifiable(craft)
    if craft.wheels:
        raise ConfigError(f"{craft.name!r} has reaction wheels, for which no commands are chosen.")
    for name, value in (("box", side), ("seconds", seconds), ("period", period)):
        positive(name, value)
    if folder.exists():
        raise ConfigError(f"{folder} exists already: name another one with --output.")
    ready_folder(folder)
    # agent.npz and agent.py: the craft's numbers, and the source of the law that reads them.
    turns = 1 if craft.dimension == 2 else 3
    tables: dict[str, Any] = {
        "wrenches": craft.wrenches,
        "mass": craft.mass,
        "inertia": np.array(craft.inertia)[3 - turns :, 3 - turns :],
        "low": np.array([command.low for command in craft.commands]),
        "period": period,
        "side": side,
        "seed": seed,
        "steps": round(seconds / period),
    }
    replace_file(folder / "agent.npz", lambda draft: _save(draft, tables))
    title = f'"""The most informative commands about {craft.name} in {seconds:g} s, in a box of {side:g} m.\n\n'
    source = inspect.getsource(excite).removeprefix('"""')
    source = source.replace(
        "import annotations\n", "import annotations\n\nimport json\nfrom pathlib import Path\n", 1
    )
    write_text(folder / "agent.py", title + source + _AGENT)
    write_text(folder / "spacecraft.toml", to_toml(craft))
    # The files that every exported agent has.
    about = {
        "format": 3,
        "agent": folder.name,
        "task": "go-to-pose",
        "settings": {},
        "spacecraft": {"name": craft.name, "file": "spacecraft.toml"},
        "control_period": period,
        "readings": {"oldest": _OLDEST * period},
        "rans": package_version("rans"),
    }
    write_json(folder / "contract.json", about)
    write_text(folder / "golden.json", json.dumps(_golden(folder, craft)) + "\n")
    return folder


def _save(file: Path, tables: dict[str, Any]) -> None:
    with file.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **tables)


def _golden(folder: Path, craft: Spacecraft) -> dict[str, Any]:
    """Golden pairs.

    Commands of the folder's own code to readings around the middle of the box, with a fixed seed.
    """
    from rans.evaluation.fly.exported import code_of

    agent = code_of(folder / "agent.py").Agent()
    random = np.random.default_rng(0)
    width = 10 if craft.dimension == 2 else 22
    rows = random.normal(0.0, 0.1, (_PAIRS, width))
    rows[:, 0] = 1.0
    if craft.dimension == 3:
        rows[:, :6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    rows = rows.astype(np.float32)
    return {
        "observation": rows.tolist(),
        "command": [agent.act(row).tolist() for row in rows],
    }
