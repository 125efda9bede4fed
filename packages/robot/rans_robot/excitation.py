"""Agents with the most informative commands about a spacecraft, as folders of numbers that `rans fly` flies."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import rans
from rans.extend import (
    ConfigError,
    Spacecraft,
    inside,
    positive,
    read_json,
    ready_folder,
    structure,
    to_toml,
    whole,
    write_json,
    write_text,
)
from rans.model.spacecraft_file import read_spacecraft
from rans_robot.identify.excite import Excitation
from rans_robot.identify.motion import check_identifiable

_PAIRS = 32
"""Golden pairs: observations and commands by which a flight checks that the files belong together."""
_OLDEST = 3.0
"""Age of a reading, in control periods, beyond which valves are shut."""
EXCITATION = "excitation.json"
"""File with the numbers of the commands (`Numbers`)."""


@dataclass(frozen=True)
class Numbers:
    """What decides the commands beside the spacecraft and the readings."""

    period: float
    """Control period, s."""
    side: float
    """Side of the box, m."""
    steps: int
    """Control periods after which all valves stay shut."""
    seed: int
    """Seed of the random commands among which the best are chosen."""

    def __post_init__(self) -> None:
        """Reject (`ConfigError`) numbers out of their ranges."""
        positive("box", self.side)
        positive("period", self.period)
        whole("steps", self.steps)
        whole("seed", self.seed, 0)


class Excited:
    """Agent of a folder of `write_excitation`: observations of go-to-pose to the most informative commands.

    The goal is the middle of the box.

    Args:
        folder: with spacecraft.toml and `EXCITATION`.

    Raises:
        ConfigError: a file is missing or damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._craft = read_spacecraft(inside(folder, "spacecraft.toml"))
        check_identifiable(self._craft)
        file = inside(folder, EXCITATION)
        self._numbers = structure(read_json(file), Numbers, str(file))
        self.reset()

    def reset(self) -> None:
        """Begin the commands from the first."""
        numbers = self._numbers
        self._excitation = Excitation(self._craft, numbers.period, numbers.side, numbers.seed)
        self._left = numbers.steps
        self.note = ""

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Commands (thrusters,) to an observation (10,) or (22,), in float32; zeros once the time is up."""
        row = np.asarray(observation, dtype=float)
        if not self._left:
            self.note = "the commands are over."
            return np.zeros(self._craft.command_count, np.float32)
        self._left -= 1
        if self._craft.dimension == 2:
            # Cosine and sine of the heading, velocity, spin, a flag, and the way to the goal.
            parts = -row[6:8], [np.arctan2(row[1], row[0])], row[2:5]
        else:
            axes = np.array([row[:3], row[3:6], np.cross(row[:3], row[3:6])])
            turn = Rotation.from_matrix(axes).as_quat(scalar_first=True)
            parts = -row[13:16], turn, row[6:12]
        return self._excitation.choose(np.concatenate(parts)).astype(np.float32)


def write_excitation(
    craft: Spacecraft, folder: Path, side: float, seconds: float, period: float, seed: int
) -> Path:
    """Write an agent with the most informative commands about a spacecraft, and return its folder.

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
    positive("seconds", seconds)
    positive("period", period)
    numbers = Numbers(period, side, round(seconds / period), seed)
    if folder.exists():
        raise ConfigError(f"{folder} exists already: name another one with --output.")
    ready_folder(folder)
    write_json(folder / EXCITATION, asdict(numbers))
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
        "rans": rans.__version__,
    }
    write_json(folder / "contract.json", about)
    write_text(folder / "golden.json", json.dumps(_golden(folder, craft)) + "\n")
    return folder


def _golden(folder: Path, craft: Spacecraft) -> dict[str, Any]:
    """Golden pairs: commands of the folder's agent to readings around the middle of the box, with a fixed seed."""
    agent = Excited(folder)
    random = np.random.default_rng(0)
    width = 10 if craft.dimension == 2 else 22
    rows = random.normal(0.0, 0.1, (_PAIRS, width))
    rows[:, 0] = 1.0
    if craft.dimension == 3:
        rows[:, :6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    rows = rows.astype(np.float32)
    return {
        "begins": [k == 0 for k in range(_PAIRS)],
        "tolerance": 0.0,
        "observation": rows.tolist(),
        "command": [agent.act(row).tolist() for row in rows],
    }
