"""``rans list``: available spacecraft, tasks, agents, controllers and conditions, and their details."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro import conf

from rans.base.errors import ConfigError, brief
from rans.base.files import read_text
from rans.base.pretrained import missing_agents, pretrained_names
from rans.base.registry import typed
from rans.base.structure import LARGEST_TOML, kind_of_file, read_toml
from rans.base.table import Table
from rans.base.terminal import Terminal
from rans.cli import overview
from rans.evaluation.fly.controllers import CONTROLLERS
from rans.model.foreign import is_foreign
from rans.model.spacecraft_file import SPACECRAFT, load_spacecraft
from rans.randomization.conditions_file import CONDITIONS
from rans.tasks import TASKS


@dataclass(frozen=True)
class List:
    """List spacecraft, tasks, agents, controllers and conditions, or show one of them in detail."""

    group = "Describe"
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
    conditions: Annotated[str | None, conf.arg(metavar="NAME|FILE")] = None
    """Conditions under which flights of a spacecraft choose how the agent for any craft flies it."""

    def following(self) -> tuple[str, ...]:
        """Commands to run next with what was listed; none for conditions."""
        kind = self._kind()
        if kind == "spacecraft":
            from rans.cli.next_commands import with_spacecraft

            under = [] if self.conditions is None else ["--conditions", self.conditions]
            return with_spacecraft(load_spacecraft(typed(self._named)), self._named, *under)
        name = shlex.quote(self._named)
        follows: dict[str, tuple[str, ...]] = {
            "conditions": (),
            "entry": (),
            "agent": (f"rans evaluate {name}",),
            "task": (f"rans train {name}",),
        }
        usual = "rans evaluate any-craft-2d", "rans train go-to-pose"
        return follows.get(kind, usual)

    def run(self) -> int:
        """Print the list or the details.

        Raises:
            ConfigError: the name or the file of the drawing is wrong.
        """
        kind = self._kind()
        if self.picture is not None:
            if kind != "spacecraft":
                raise ConfigError(
                    f"--picture {self.picture} draws one spacecraft: name it, for example "
                    f"rans list floating-platform --picture {self.picture}."
                )
            from rans.show.figures.layout_figure import draw_layout
            from rans.show.figures.picture_file import save_picture

            save_picture(draw_layout(load_spacecraft(typed(self._named))), self.picture)
        console = Terminal()
        for part in self._parts(kind):
            if isinstance(part, Table):
                console.table(part)
            else:
                console.say(part)
        if self.picture is not None:
            console.say(f"Picture: {self.picture}")
        return 0

    @property
    def _named(self) -> str:
        return (self.name or "").removeprefix("pretrained:")

    def _parts(self, kind: str) -> Iterable[str | Table]:
        """Printed parts of a list, or of an object, whose details load it.

        Raises:
            ConfigError: conditions are named with what is no spacecraft.
        """
        if self.conditions is not None:
            if kind != "spacecraft":
                raise ConfigError(
                    f"--conditions {self.conditions} is for a spacecraft: name it, as in "
                    f"rans list mine.toml --conditions {self.conditions}."
                )
            from rans.cli import details

            return details.spacecraft(self._named, self.conditions)
        if kind in _LISTS:
            return _LISTS[kind]()
        if kind == "entry":
            return overview.entry(self._named)
        from rans.cli import details

        if kind in _LOADING_LISTS:
            return getattr(details, _LOADING_LISTS[kind])()
        return getattr(details, kind)(self._named)

    def _kind(self) -> str:
        """Kind of the named object, a function of `details`, or the name of a list."""
        name = self._named
        if self.name is None:
            return ""
        every = {"pretrained": "AGENTS", "crafts": "SPACECRAFT", "missions": "TASKS"}.get(
            name, name
        )
        if (every := every.upper()) in (*_LISTS, *_LOADING_LISTS):
            return every
        names_of: dict[str, Iterable[str]] = {
            "conditions": CONDITIONS,
            "task": TASKS,
            "agent": [*pretrained_names(), *missing_agents()],
            "controller": CONTROLLERS,
            "spacecraft": SPACECRAFT,
        }
        for kind, names in names_of.items():
            if name in names:
                return kind
        if any(name in registry for _, registry in overview.SMALL):
            return "entry"
        if name.endswith(".toml"):
            return _kind_of_file(Path(name))
        # Their refusal says how to make a file of them.
        if is_foreign(name) or name.lower().endswith(".toml"):
            return "spacecraft"
        if ":" in name:
            from rans.cli.details import kind_of_object

            return kind_of_object(name)
        near = CONTROLLERS.meant(name, [c for names in names_of.values() for c in names])
        raise ConfigError(
            "there is no spacecraft, task, agent, controller or set of conditions named "
            f"{brief(name)}{near}; `rans list` prints all; your own file of a spacecraft or of conditions "
            "must end in .toml."
        )


_LISTS: dict[str, Callable[[], Iterable[str | Table]]] = {
    "": overview.everything,
    "SPACECRAFT": overview.all_spacecraft,
    "AGENTS": overview.all_agents,
    "CONTROLLERS": overview.all_controllers,
    "CONDITIONS": overview.all_conditions,
}
"""Lists by the words for them, which load nothing but spacecraft and conditions."""
_LOADING_LISTS = {"TASKS": "all_tasks", "TRAINING": "training"}
"""Lists by the words for them: functions of `details`."""


def _kind_of_file(file: Path) -> str:
    """Kind of a TOML file: conditions if its keys are those of conditions, else spacecraft."""
    try:
        table = read_toml(read_text(file, LARGEST_TOML))
    except ConfigError:
        return "spacecraft"
    kind = kind_of_file(table)
    return "conditions" if kind == "conditions" or (not kind and "base" in table) else "spacecraft"
