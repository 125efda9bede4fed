"""Tuned settings of controllers: the files that `rans tune` writes, and the setups that they fit."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypedDict

from rans.base.errors import ConfigError, is_finite
from rans.base.files import distinct, inside, package_version, reading, write_json
from rans.base.structure import Number, structure
from rans.episode.step import Setup
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import spacecraft_label, to_toml
from rans.randomization.conditions_file import conditions_text
from rans.tasks import Task, registered_name

SHIPPED = Path(__file__).parents[2] / "data" / "controllers"
"""Folder of the tuned settings in the package, one JSON file each."""
OWN = Path("runs") / "controllers"
"""Folder into which `rans tune` writes; its files take precedence."""


class Costs(TypedDict):
    """Costs of settings, s; see `rans.evaluation.compare.tuning.cost`."""

    default: float
    tuned: float


@dataclass(frozen=True)
class Tuned:
    """Result of the tuning of one controller for one spacecraft, task and control rate."""

    controller: str
    """Name in `rans.evaluation.fly.controllers.CONTROLLERS`."""
    task: str
    tolerances: dict[str, float]
    """Tolerances of the task, SI units."""
    control_period: float
    """Control period, s."""
    spacecraft: str
    """Spacecraft as TOML."""
    settings: dict[str, Number]
    """Settings by the names of the controller's ``tunable``."""
    candidates: int
    """Number of settings that were flown, the default ones included."""
    starts: int
    """Number of starts of each."""
    seed: int
    """Seed of the starts."""
    price: float
    """Price of thrust, s per N s."""
    costs: Costs
    command: str
    """Command of the search."""
    conditions: str = ""
    """Conditions of the flights as TOML (`rans.randomization.conditions_file.conditions_text`); "": none."""
    seconds: float = field(default=0.0, compare=False)
    """Processor time of the search, s; 0: not known."""
    rans: str = field(default="", compare=False)
    """Version that wrote it."""

    @classmethod
    def read(cls, file: Path) -> Tuned:
        """Read a file of `rans tune`, without following links.

        Raises:
            ConfigError: it is damaged.
        """
        try:
            with reading(inside(file.parent, file.name)) as table:
                return structure(table, cls, "tuned", is_written=True)
        except ConfigError as error:
            raise ConfigError(
                f"{error} Delete it: then the settings in the package are used."
            ) from error

    def write(self, file: Path) -> None:
        """See `rans.base.files.write_json`."""
        write_json(file, asdict(self) | {"rans": package_version("rans")})

    def fits(self, name: str, setup: Setup) -> bool:
        """Whether the settings fit a controller and a setup; starts and length of episodes may differ.

        Settings that were tuned without conditions fit a setup with any; others only one with the same conditions.
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

    def outlasts(self, rival: Tuned) -> bool:
        """Whether the settings are better than others for the same: more starts, or no larger cost with as many."""
        if (self.seed, self.price, self.conditions) != (rival.seed, rival.price, rival.conditions):
            return False
        if self.starts != rival.starts:
            return self.starts > rival.starts
        return self.costs["tuned"] <= rival.costs["tuned"]

    def budget(self) -> str:
        """Budget of the search, for tables."""
        where = " under conditions" if self.conditions else ""
        time = f", {self.seconds:.0f} s of a processor" if self.seconds else ""
        return f"tuned: {self.candidates} settings on {self.starts} starts{where}{time}"


def tuned(name: str, setup: Setup) -> Tuned | None:
    """Tuned settings of a controller for a setup; None: there are none.

    Settings that were tuned under the setup's conditions come before those that were tuned without any, a user's
    own files before those of the package, and of own files the newest: older versions gave them other names.
    """
    own = sorted(OWN.glob("*.json"), key=lambda file: file.lstat().st_mtime, reverse=True)
    shipped = sorted(SHIPPED.glob("*.json"))
    read = {file: Tuned.read(file) for file in (*own, *shipped)}
    fitting = [file for file in read if read[file].fits(name, setup)]
    for file in sorted(fitting, key=lambda file: not read[file].conditions):
        try:
            arguments(CONTROLLERS[name], read[file].settings)
        except ConfigError as error:
            raise ConfigError(f"{file}: {error}") from error
        return read[file]
    return None


def text_of_conditions(setup: Setup) -> str:
    """Conditions of a setup as TOML; "" if there are none."""
    return "" if setup.conditions is None else conditions_text(setup.conditions)


def file_name(name: str, craft: Spacecraft, task: Task, conditions: str = "") -> str:
    """Name of the file of tuned settings; spacecraft of the same name have a file each."""
    parts = *re.split(":+", name), *re.split(":+", task_name(task))
    label = f"-{conditions}" if conditions else ""
    return f"{'-'.join(map(distinct, parts))}-{spacecraft_label(craft)}{label}.json"


def task_name(task: Task) -> str:
    """Name of a task in `TASKS`, or that of its class."""
    return registered_name(task) or type(task).__name__


def defaults(maker: Callable[..., Any], keys: Iterable[str]) -> dict[str, float]:
    """Defaults of settings, by names such as "weights.position", or "gain" for an argument that is a number.

    Raises:
        ConfigError: the controller has no such argument, or it has no default that is, or holds, a number.
    """
    parameters = inspect.signature(maker).parameters
    result: dict[str, Any] = {}
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

    Fields of an argument that are not in the settings have the values of its default.

    Raises:
        ConfigError: the controller has no such argument or field, or the value is out of bounds.
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
