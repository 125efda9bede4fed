"""Agents that were exported as ONNX or NumPy, as contestants; their contract names their task."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from rans.errors import ConfigError, RansError, brief, one_line, positive
from rans.evaluation.fly.agent import LoadedRun
from rans.evaluation.fly.user_policy import UserPolicy, answered, user_policy
from rans.files import first_line, inside, read_json, read_text
from rans.flight import begin_flight
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import read_spacecraft
from rans.policy.timing import timing_of_file
from rans.registry import are_files_trusted
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


def code_of(file: Path) -> ModuleType:
    """Module of an exported agent.py, from the text of this file.

    Python's own import would run a ``__pycache__`` beside it in its place, which a user who has read agent.py and
    trusts it has not seen.

    Raises:
        ConfigError: the file cannot be read, or its code fails.
    """
    text = read_text(file)
    module = ModuleType(file.stem)
    module.__file__ = str(file)
    with failing_as_config_error(file):
        exec(compile(text, str(file), "exec", dont_inherit=True), module.__dict__)
    return module


@contextmanager
def failing_as_config_error(file: Path) -> Iterator[None]:
    """Context that converts whatever the code of an exported agent.py raises to a `ConfigError`."""
    try:
        yield
    except RansError:
        raise
    except (Exception, SystemExit) as error:  # somebody else's code raises anything
        raise ConfigError(
            f"{file} cannot be loaded: {type(error).__name__}: {first_line(error)}."
        ) from error


def load_exported(folder: Path) -> LoadedRun:
    """Load the agent of a folder that `rans export` wrote as ONNX or NumPy, with the task of its contract.

    It flies without conditions, which a contract need not name.

    Raises:
        ConfigError: a file is missing or damaged, or the agent is Python code without ``--trust``.
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
    if inside(folder, "agent.py").is_file():
        return ExportedPython(folder, craft)
    raise ConfigError(f"{folder} has a contract but neither agent.onnx nor agent.py.")


_KEPT = ("memory", "last", "held")
"""What an exported agent.py keeps from one control period to the next, each (N, ...)."""


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
        module = code_of(file)
        with failing_as_config_error(file):
            self._agent = module.Agent()

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

    def decide(
        self, observation: np.ndarray, memory: Any, episode_start: np.ndarray | None = None
    ) -> tuple[np.ndarray, Any]:
        """Commands (N, commands) and what agent.py keeps after them; see `UserPolicy.decide`.

        `_KEPT` names the arrays that files of earlier exports have too.
        """
        count = len(observation)
        with failing_as_config_error(self._folder / "agent.py"):
            begun: Any = begin_flight(self, count)
            if memory is not None:
                begins = np.zeros(count, bool) if episode_start is None else episode_start
                for name, before in zip(_KEPT, memory, strict=True):
                    rows = begins.reshape(-1, *[1] * (before.ndim - 1))
                    setattr(begun._agent, name, np.where(rows, getattr(begun._agent, name), before))
        commands = begun.act(None, None, observation)
        return commands, tuple(getattr(begun._agent, name) for name in _KEPT)


OBSERVERS = (UserPolicy, ExportedPython)
"""Classes of controllers, besides agents, that read the observation only."""
