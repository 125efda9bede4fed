"""Agents that were exported as ONNX, as contestants; their contract names their task."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from rans.errors import ConfigError, brief, one_line, positive
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.user_policy import user_policy
from rans.files import inside, read_json
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import read_spacecraft
from rans.policy.timing import timing_of_file
from rans.structure import structure
from rans.tasks import TASKS, Task

CONTRACT = "contract.json"


def is_exported(folder: Path) -> bool:
    """Whether a folder holds an exported agent and no run."""
    return (folder / CONTRACT).is_file() and not (folder / "config.json").exists()


def read_contract(folder: Path, for_flight: bool = False) -> dict[str, Any]:
    """Contract of an exported agent; what RANS reads of it is there, and of the right kind.

    Args:
        folder: folder of the export.
        for_flight: whether a flight on a robot needs it, which reads more of it.

    Raises:
        ConfigError: the file is missing or damaged.
    """
    file = inside(folder, CONTRACT)
    table = read_json(file)
    if not isinstance(table, dict):
        raise ConfigError(f"{file} is damaged: it must be a table, got {brief(table)}.")
    kinds = {"task": str, "settings": dict}
    if for_flight:
        kinds |= {"agent": str, "readings": dict}
    for key, kind in kinds.items():
        if not isinstance(table.get(key), kind):
            raise ConfigError(
                f"{file} is damaged: {key} must be a {'name' if kind is str else 'table'}, got "
                f"{brief(table.get(key))}."
            )
    if for_flight:
        one_line(f"agent in {file}", table["agent"])
    positive(f"control_period in {file}", table.get("control_period"))
    if for_flight:
        positive(f"readings.oldest in {file}", table["readings"].get("oldest"))
    return table


def load_exported(folder: Path) -> LoadedRun:
    """Load the agent of a folder that `rans export` wrote as ONNX, with the task of its contract.

    It flies without conditions, which a contract need not name.

    Raises:
        ConfigError: a file is missing or damaged, or the agent is of another format.
    """
    contract = read_contract(folder)
    where = f"{folder / CONTRACT}: settings"
    task = structure(contract["settings"], TASKS[contract["task"]], where)
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
