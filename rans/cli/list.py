"""``rans list``: available spacecraft, tasks, agents, controllers and conditions, and their details."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated

from tyro import conf

from rans.cli import overview
from rans.errors import ConfigError, brief
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.files import read_text
from rans.model.foreign import is_foreign
from rans.model.spacecraft_file import load_spacecraft, spacecraft_names
from rans.pretrained import missing_agents, pretrained_names
from rans.randomization.conditions_file import CONDITIONS
from rans.registry import typed
from rans.structure import LARGEST_TOML, kind_of_file, read_toml
from rans.table import Table
from rans.tasks import TASKS
from rans.terminal import Terminal


@dataclass(frozen=True)
class List:
    """List spacecraft, tasks, agents, controllers and conditions, or show one of them in detail."""

    group = "Check"
    guide = "docs/terminal.md"
    examples = (
        "rans list",
        "rans list go-to-pose",
        "rans list mine.toml --picture craft.svg",
    )

    name: Annotated[str | None, conf.Positional, conf.arg(metavar="[NAME]")] = None
    """A spacecraft, task, agent, controller or set of conditions, by name, TOML file or MODULE:NAME.
    SPACECRAFT, TASKS, AGENTS, CONTROLLERS and CONDITIONS list all of a kind; TRAINING lists the settings of a
    training."""
    picture: Annotated[Path | None, conf.arg(metavar="FILE")] = None
    """Save a drawing of the spacecraft's thrusters to this file (.png, .svg or .pdf)."""

    def following(self) -> tuple[str, ...]:
        """Commands to run next with what was listed; none for conditions."""
        kind = self._kind()
        if kind == "conditions":
            return ()
        if kind == "spacecraft":
            from rans.cli.next_commands import with_spacecraft

            return with_spacecraft(load_spacecraft(typed(self._named)), self._named)
        name = shlex.quote(self._named)
        if kind == "agent":
            return (f"rans evaluate {name}",)
        if kind == "task":
            return (f"rans train {name}",)
        return ("rans evaluate go-to-pose-2d-trade-off#0.5", "rans train go-to-pose")

    def run(self) -> int:
        """Print the list or the details.

        Raises:
            ConfigError: the name or the file of the drawing is wrong.
        """
        kind = self._kind()
        if self.picture is not None and kind != "spacecraft":
            raise ConfigError(
                f"--picture {self.picture} draws one spacecraft: name it, for example "
                f"rans list floating-platform --picture {self.picture}."
            )
        if self.picture is not None:
            from rans.show.figures.layout_figure import draw_layout
            from rans.show.figures.picture_file import save_picture

            save_picture(draw_layout(load_spacecraft(typed(self._named))), self.picture)
        console = Terminal()
        parts = (
            overview.PARTS[kind]()
            if kind in overview.PARTS
            else _details().PARTS[kind](self._named)
        )
        for part in parts:
            if isinstance(part, Table):
                console.table(part)
            else:
                console.say(part)
        if self.picture is not None:
            Terminal().say(f"Picture: {self.picture}")
        return 0

    @property
    def _named(self) -> str:
        return (self.name or "").removeprefix("pretrained:")

    def _kind(self) -> str:
        """Kind of the named object, a key of `PARTS` in `overview` or `details`."""
        name = self._named
        if self.name is None:
            return "everything"
        name = {"pretrained": "agents", "crafts": "spacecraft", "missions": "tasks"}.get(name, name)
        if (every := f"all {name.lower()}") in (*overview.PARTS, "all tasks", "all training"):
            return every
        names_of: dict[str, Iterable[str]] = {
            "conditions": CONDITIONS,
            "task": TASKS,
            "agent": [*pretrained_names(), *missing_agents()],
            "controller": CONTROLLERS,
            "spacecraft": spacecraft_names(),
        }
        for kind, names in names_of.items():
            if name in names:
                return kind
        if name.endswith(".toml"):
            return _kind_of_file(Path(name))
        # Their refusal says how to make a file of them.
        if is_foreign(name) or name.lower().endswith(".toml"):
            return "spacecraft"
        if ":" in name:
            return _details().kind_of_object(name)
        near = CONTROLLERS.meant(name, [c for names in names_of.values() for c in names])
        raise ConfigError(
            "there is no spacecraft, task, agent, controller or set of conditions named "
            f"{brief(name)}{near}; `rans list` prints all; your own file of a spacecraft or of conditions "
            "must end in .toml."
        )


def _details() -> ModuleType:
    """What says more about one object, which it loads."""
    from rans.cli import details

    return details


def _kind_of_file(file: Path) -> str:
    """Kind of a TOML file: conditions if its keys are those of conditions, else spacecraft."""
    try:
        table = read_toml(read_text(file, LARGEST_TOML))
    except ConfigError:
        return "spacecraft"
    kind = kind_of_file(table)
    return "conditions" if kind == "conditions" or (not kind and "base" in table) else "spacecraft"
