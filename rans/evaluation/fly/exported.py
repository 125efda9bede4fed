"""Agents that were exported as ONNX or NumPy, as contestants; their contract names their task."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError, brief
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.controllers import UserPolicy, answered, user_policy
from rans.files import first_line, inside, read_json
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.registry import are_files_trusted
from rans.structure import structure
from rans.tasks import TASKS, Task

CONTRACT = "contract.json"


def is_exported(folder: Path) -> bool:
    """Whether a folder holds an exported agent and no run."""
    return (folder / CONTRACT).is_file() and not (folder / "config.json").exists()


def load_exported(folder: Path) -> LoadedRun:
    """Load the agent of a folder that `rans export` wrote as ONNX or NumPy, with the task of its contract.

    It flies without conditions, which a contract need not name.

    Raises:
        ConfigError: a file is missing or damaged, or the agent is Python code without ``--trust``.
    """
    file = inside(folder, CONTRACT)
    contract = read_json(file)
    try:
        name = contract["task"]
        period = float(contract["control_period"])
        settings = contract["settings"]
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{file} is damaged: it lacks {error}.") from error
    if not isinstance(name, str):
        raise ConfigError(f"{file} is damaged: its task must be a name, got {brief(name)}.")
    task = structure(settings, TASKS[name], f"{file}: settings")
    craft = load_spacecraft(inside(folder, "spacecraft.toml"))
    timing = replace(task.timing, control_period=period)
    return LoadedRun(_controller(folder, craft, task), craft, task, timing)


def _controller(folder: Path, craft: Spacecraft, task: Task) -> Any:
    name = folder.resolve().name
    if (onnx := inside(folder, "agent.onnx")).is_file():
        policy = user_policy(f"onnx:{onnx}", craft, task)
        policy.name = name
        return policy
    if inside(folder, "agent.py").is_file():
        return ExportedPython(folder, craft)
    raise ConfigError(f"{folder} has a contract but neither agent.onnx nor agent.py.")


class ExportedPython:
    """The agent of an exported ``agent.py``, which runs that file's code.

    Raises:
        ConfigError: the code is not trusted (``--trust``), or it cannot be loaded.
    """

    def __init__(self, folder: Path, craft: Spacecraft) -> None:
        file = inside(folder, "agent.py")
        if not are_files_trusted():
            raise ConfigError(
                f"{file} is Python code, which a flight runs. If you know who wrote it, add --trust; "
                "from Python, call rans.trust_files() first."
            )
        self.name = folder.resolve().name
        self._folder = folder
        self._craft = craft
        spec = importlib.util.spec_from_file_location(f"exported_{self.name}", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
            self._agent = module.Agent()
        except Exception as error:  # somebody else's code raises anything
            raise ConfigError(
                f"{file} cannot be loaded: {type(error).__name__}: {first_line(error)}."
            ) from error

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process loads the file anew."""
        return ExportedPython, (self._folder, self._craft)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._agent.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; reads the observation only."""
        return answered(
            self.name, lambda: self._agent.act(observation), self._craft, len(observation)
        )


OBSERVERS = (UserPolicy, ExportedPython)
"""Classes of controllers, besides agents, that read the observation only."""
