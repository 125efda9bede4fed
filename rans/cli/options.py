"""Options that are treated alike in all commands."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, get_origin

from tyro.conf import Suppress, arg

from rans.base.display import meanings
from rans.base.executors import FORMS


@dataclass(frozen=True)
class _Everywhere:
    """Annotation of a command's field whose option every command takes, so that its help is in one place."""


Trust = Suppress[Annotated[bool, _Everywhere()]]
"""Type of the field that is true with --trust."""
HINT = arg(
    help_behavior_hint=lambda value: (
        "" if value in ("", "''", "None", "False", "inf") else f"(default: {value})"
    )
)
"""Help names a default only where it says more than the text."""
EVERYWHERE = {
    "--trust": "Allow code: open and run what files name, which are the module of a task (MODULE:NAME), the "
    "agent.py of a flight, and pickles of sb3:. Only if you know their authors.",
    "--executor": f"Run flights, bounds, trajectories and proofs on other machines: {FORMS}. Results are those of "
    "this machine.",
}
"""Options of every command with their help."""


def is_in_help(hint: Any) -> bool:
    """Whether the help of a command has the option of a field, by its type hint."""
    return not any(isinstance(annotation, _Everywhere) for annotation in _annotations(hint))


def _annotations(hint: Any) -> tuple[Any, ...]:
    return hint.__metadata__ if get_origin(hint) is Annotated else ()


def option_name(field: str, hint: Any) -> str:
    """Option of a field, such as --failure-below of failure_below, unless its annotation has another name."""
    named = (getattr(annotation, "name", None) for annotation in _annotations(hint))
    return f"--{next(filter(None, named), field).replace('_', '-')}"


def texts_of(described: type) -> dict[str, str]:
    """Texts of the options of a command by name: those of its function, and those of its own fields."""
    own = {field.name for field in fields(described)}
    texts = {name: text for name, text in meanings(described).items() if name in own}
    return texts | getattr(described, "texts", {})
