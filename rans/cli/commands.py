"""Commands by name: those of the core, and those that installed packages add (entry points ``rans.commands``)."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, ClassVar, Protocol

from rans.base.errors import ConfigError
from rans.base.registry import Registry


class Command(Protocol):
    """A dataclass whose fields are the options of a command, and whose docstring explains it.

    Attributes:
        group: title of its group in the overview of ``rans``.
        guide: page of the documentation, as a path in the repository.
        examples: command lines for its help.
        following: commands to suggest after success where `run` has suggested none, with options in braces, as in
            "rans view {agent}", or a method that returns them; none after output for programs.
    """

    group: ClassVar[str]
    guide: ClassVar[str]
    examples: ClassVar[tuple[str, ...]]
    following: Any

    def run(self) -> int:
        """Run the command, and return the exit code: 0 for success, 1 if a check or a run failed."""
        ...


def divides_work(command: object) -> bool:
    """Whether a command divides its work among processes, so that ``--executor`` is for it."""
    return bool(getattr(command, "divides_work", False))


def _checked(command: Any) -> type[Command]:
    """Refuse (`ConfigError`) a package's command that lacks what every command has."""
    needed = ("run", "following", "group", "guide", "examples")
    lacking = [name for name in needed if not hasattr(command, name)]
    if lacking or not isinstance(command, type):
        raise ConfigError(f"the class of a command must have {', '.join(needed)}, got {command!r}.")
    from rans.cli.options import HINT  # libraries of the terminal are loaded with a command

    own = command.__annotations__
    own |= {x.name: Annotated[own[x.name], HINT] for x in fields(command) if x.name in own}
    return command


BUILT_IN = (
    "train",
    "evaluate",
    "view",
    "compare",
    "report",
    "export",
    "init",
    "tune",
    "list",
)
"""Names of the commands of the core."""
COMMANDS: Registry[type[Command]] = Registry(
    kind="command",
    group="rans.commands",
    built_in={name: f"rans.cli.{name}:{name.capitalize()}" for name in BUILT_IN},
    checked=_checked,
)
"""Every command that is installed; each is imported when it is used."""
