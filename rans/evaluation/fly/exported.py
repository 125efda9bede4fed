"""Agents that were exported as ONNX, as contestants; their contract names their task."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rans.base.errors import ConfigError, brief, one_line, positive
from rans.base.files import inside, read_text, reading
from rans.base.structure import LARGEST_TOML, structure
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.user_policy import user_policy
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import read_spacecraft
from rans.model.timing import Timing
from rans.policy.timing import timing_of_file
from rans.tasks import TASKS, Task

CONTRACT = "contract.json"
FORMAT = 3
"""Number of the form of contracts, which another meaning of a key makes another one."""
OLDEST = (2.0, 3.0)
"""s, or so many control periods if they are longer: no contract lets a reading be older. It is twice as long as the
longest outage of the conditions of RANS."""
LONGEST_PERIOD = 100.0
"""s: largest control period, that of the slowest orbits of RANS's missions."""
LARGEST = {"m": 1e5, "m/s": 100.0, "rad/s": 100.0}
"""No reading is larger, beyond all that a thruster-driven craft near its goal does."""
_LARGEST_OTHER = 1e6
"""Largest reading of a column in any other unit."""


def longest_age(period: float) -> float:
    """Largest age, s, that a reading may have at a control period, s."""
    seconds, periods = OLDEST
    return max(seconds, periods * period)


@dataclass(frozen=True)
class _Contract:
    """What RANS reads of a contract; its other entries are for people and firmware."""

    agent: str
    task: str
    settings: dict[str, Any]
    spacecraft: dict[str, Any]
    readings: dict[str, Any]
    observation: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class _Column:
    """What RANS reads of a column of a contract's observation."""

    column: int
    unit: str
    refused: tuple[float, float]


def is_exported(folder: Path) -> bool:
    """Whether a folder holds an exported agent and no run."""
    return (folder / CONTRACT).is_file() and not (folder / "config.json").exists()


def read_contract(folder: Path) -> dict[str, Any]:
    """Contract of an exported agent; what RANS reads of it is there, and of the right kind.

    Args:
        folder: folder of the export.

    Raises:
        ConfigError: the file is missing, damaged or of another format, or the spacecraft beside it is not the one
            that it names.
    """
    file = inside(folder, CONTRACT)
    with reading(file) as table:
        if (form := table.get("format")) != FORMAT:
            raise ConfigError(
                f"{file} is of format {brief(form)}, and this version of RANS reads format {FORMAT}: export the "
                "agent again."
            )
        keys = table.keys() & _Contract.__annotations__.keys()
        read = structure({key: table[key] for key in keys}, _Contract, str(file))
        columns = [
            structure({key: column[key] for key in _Column.__annotations__}, _Column, str(file))
            for column in read.observation
        ]
        oldest = read.readings["oldest"]
        timing = {"control_period": table["control_period"]}
        if "episode_steps" in table:  # which earlier exports lack
            timing["episode_steps"] = table["episode_steps"]
    # The spacecraft is that of the file beside it.
    craft = read.spacecraft
    beside = inside(folder, "spacecraft.toml")
    own = hashlib.sha256(read_text(beside, LARGEST_TOML).encode()).hexdigest()
    named = [craft.get(key) for key in ("file", "sha256")]
    if named != [beside.name, own]:
        raise ConfigError(
            f"the spacecraft of {file} is {brief(named[0])} of the SHA-256 {brief(str(named[1])[:8])}, but "
            f"{beside} has {own[:8]}: one of them was probably edited after the export, and the agent was made for "
            "what was there before. Export it again."
        )
    numbers = [column.column for column in columns]
    if not columns or numbers != [*range(len(columns))]:
        raise ConfigError(
            f"the columns of the observation in {file} must be numbered from 0, one after the other, got "
            f"{brief(numbers)}."
        )
    one_line(f"agent in {file}", read.agent)
    # A file makes limits of a flight tighter, and none wider than RANS allows.
    positive(f"readings.oldest in {file}", oldest)
    period = structure(timing, Timing, str(file)).control_period
    if not period <= LONGEST_PERIOD:
        raise ConfigError(
            f"control_period in {file} is {period:g} s, but a command is held for at most {LONGEST_PERIOD:g} s."
        )
    longest = longest_age(period)
    if not oldest <= longest:
        raise ConfigError(
            f"readings.oldest in {file} is {oldest:g} s, but a reading may be at most {longest:g} s old: the "
            f"longer of {OLDEST[0]:g} s and {OLDEST[1]:g} control periods."
        )
    for column in columns:
        largest = LARGEST.get(column.unit, _LARGEST_OTHER)
        low, high = column.refused
        if not -largest <= low < high <= largest:
            raise ConfigError(
                f"refused of column {column.column} in {file} must ascend, and be within {largest:g} "
                f"{column.unit} of 0, got {low:g} and {high:g}."
            )
    return table


def load_exported(folder: Path) -> LoadedRun:
    """Load the agent of a folder that `rans export` wrote as ONNX, with the task of its contract.

    It flies without conditions, which a contract need not name.

    Raises:
        ConfigError: a file is missing or damaged, or the agent is of another format.
    """
    contract = read_contract(folder)
    with reading(folder / CONTRACT):  # such as a task that is not installed
        task = structure(contract["settings"], TASKS[contract["task"]], "settings", True)
    craft = read_spacecraft(inside(folder, "spacecraft.toml"))
    timing = timing_of_file(craft, task, "spacecraft.toml", float(contract["control_period"]))
    if (steps := contract.get("episode_steps")) is not None:  # earlier exports have none
        timing = replace(timing, episode_steps=steps)
    return LoadedRun(_controller(folder, craft, task), craft, task, timing)


def _controller(folder: Path, craft: Spacecraft, task: Task) -> Any:
    """The controller of an exported folder, by the file of the agent that it has."""
    name = folder.resolve().name
    if (onnx := inside(folder, "agent.onnx")).is_file():
        policy = user_policy(f"onnx:{onnx}", craft, task)
        policy.name = name
        return policy
    raise ConfigError(
        f"{folder} has a contract and no agent.onnx, which flies: export it as onnx too. `python agent.py` checks "
        "what was exported as numpy."
    )
