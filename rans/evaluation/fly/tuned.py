"""Settings of controllers that `rans tune` found: by which file, and when they fit."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rans.episode import Setup
from rans.errors import ConfigError, is_finite
from rans.files import distinct, read_json, write_json
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import spacecraft_label, to_toml
from rans.randomization.conditions_file import conditions_text
from rans.tasks import Task, registered_name

SHIPPED = Path(__file__).parents[2] / "data" / "controllers"
"""Those that come with RANS, a JSON file each."""
OWN = Path("runs") / "controllers"
"""Where `rans tune` writes; what lies here goes first."""


@dataclass(frozen=True)
class Tuned:
    """What a search found for one controller, spacecraft, task and rate."""

    controller: str
    """Its name in `rans.evaluation.fly.controllers.CONTROLLERS`."""
    task: str
    tolerances: dict[str, float]
    """Of the task."""
    control_period: float
    """s"""
    spacecraft: str
    """As TOML."""
    settings: dict[str, float]
    """By the names of the controller's ``tunable``."""
    candidates: int
    """How many settings were flown, the default ones included."""
    starts: int
    """How many each flew from."""
    seed: int
    """Of these starts."""
    price: float
    """Of thrust, s per N s."""
    costs: dict[str, float]
    """Of "default" and "tuned" settings, s; see `rans.evaluation.compare.tuning.cost`."""
    command: str
    """What found them."""
    conditions: str = ""
    """In which they flew, as TOML (`rans.randomization.conditions_file.conditions_text`); empty: none."""
    seconds: float = field(default=0.0, compare=False)
    """Processor time of the search, s; 0: not known."""

    @classmethod
    def read(cls, file: Path) -> Tuned:
        """What a file holds; `ConfigError` if it is damaged."""
        try:
            return cls(**read_json(file))
        except TypeError as error:
            raise ConfigError(
                f"{file} is damaged: {error}; write it anew with rans tune."
            ) from error
        except ConfigError as error:
            raise ConfigError(f"{error} Delete it: what comes with RANS serves then.") from error

    def write(self, file: Path) -> None:
        """See `rans.files.write_json`."""
        write_json(file, asdict(self))

    def fits(self, name: str, setup: Setup) -> bool:
        """Whether they were found for this; starts and length of episodes may differ.

        Settings found without conditions fit a setup with any; others those conditions alone.
        """
        craft, task, timing, _, _ = setup
        return (
            self.controller == name
            and self.tolerances == task.tolerances()
            and self.task == task_name(task)
            and self.control_period == timing.control_period
            and self.spacecraft == to_toml(craft)
            and self.conditions in ("", text_of_conditions(setup))
        )

    def outlasts(self, other: Tuned) -> bool:
        """Whether these stay: others for the same were found on fewer starts, or cost no less on as many."""
        if (self.seed, self.price, self.conditions) != (other.seed, other.price, other.conditions):
            return False
        if self.starts != other.starts:
            return self.starts > other.starts
        return self.costs["tuned"] <= other.costs["tuned"]

    def budget(self) -> str:
        """What they cost, for tables."""
        where = " under conditions" if self.conditions else ""
        time = f", {self.seconds:.0f} s of a processor" if self.seconds else ""
        return f"tuned: {self.candidates} settings on {self.starts} starts{where}{time}"


def tuned(name: str, setup: Setup) -> Tuned | None:
    """What was tuned for this controller in this setup, own files before those that come with RANS.

    Those tuned under the setup's own conditions before those tuned without any. Of own files the newest that
    fits: older versions wrote them by other names.
    """
    own = sorted(OWN.glob("*.json"), key=lambda file: file.lstat().st_mtime, reverse=True)
    shipped = sorted(SHIPPED.glob("*.json"))
    read = map(Tuned.read, [*own, *shipped])
    fitting = [found for found in read if found.fits(name, setup)]
    own_conditions = text_of_conditions(setup)
    return next((found for found in fitting if found.conditions == own_conditions), None) or next(
        iter(fitting), None
    )


def text_of_conditions(setup: Setup) -> str:
    """The conditions of a setup as TOML; empty where there are none."""
    return "" if setup.conditions is None else conditions_text(setup.conditions)


def file_name(name: str, craft: Spacecraft, task: Task, conditions: str = "") -> str:
    """Of the file for these; spacecraft of the same name have one each. For conditions see `conditions_label`."""
    parts = *re.split(":+", name), *re.split(":+", task_name(task))
    label = f"-{conditions}" if conditions else ""
    return f"{'-'.join(map(distinct, parts))}-{spacecraft_label(craft)}{label}.json"


def task_name(task: Task) -> str:
    """In `TASKS`, or else its class's."""
    return registered_name(task) or type(task).__name__


def defaults(maker: Callable[..., Any], keys: Iterable[str]) -> dict[str, float]:
    """The default of every setting, by names such as "weights.position", or "gain" of an argument itself.

    Raises:
        ConfigError: the controller has no such argument, or it has no default that is, or holds, a number.
    """
    parameters = inspect.signature(maker).parameters
    result = {}
    for key in keys:
        group, _, field = key.partition(".")
        default = getattr(parameters.get(group), "default", None)
        result[key] = getattr(default, field, None) if field else default
        if not is_finite(result[key]):
            raise ConfigError(
                f"`tunable` names {key!r}, which must be an argument of the controller, or a "
                'field of a dataclass that is one (as "weights.position"), with a number as '
                "its default."
            )
    return result


def arguments(maker: Callable[..., Any], settings: Mapping[str, float]) -> dict[str, Any]:
    """Keyword arguments of a controller from settings such as {"weights.position": 0.6} or {"gain": 0.6}.

    The rest of an argument that is a dataclass is as its default.

    Raises:
        ConfigError: it has no such argument or field, or the value is out of bounds.
    """
    parameters = inspect.signature(maker).parameters
    groups: dict[str, dict[str, float]] = {}
    for key, value in settings.items():
        group, _, field = key.partition(".")
        groups.setdefault(group, {})[field] = value
    try:
        return {
            group: values[""] if "" in values else replace(default, **values)
            for group, values in groups.items()
            for default in [parameters[group].default]
        }
    except (KeyError, TypeError) as error:
        raise ConfigError(
            f"settings {', '.join(settings)} are not those of the controller: {error}; tune it "
            "again with rans tune."
        ) from error
