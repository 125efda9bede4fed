"""Options that are treated alike in all commands: former ones, and those that every command takes."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, get_origin, get_type_hints

from rans.executors import FORMS
from rans.renamed import DEPRECATED


@dataclass(frozen=True)
class Former:
    """Annotation of a command's field that is an option of the previous version.

    It is accepted for one more version, with a warning, and is not in the help.
    """

    advice: str
    """What to do instead, such as "write --set seed=N"."""


@dataclass(frozen=True)
class _Everywhere:
    """Annotation of a command's field whose option every command takes, so that its help is in one place."""


Trust = Annotated[bool, _Everywhere()]
"""Type of the field that is true with --trust."""
ExecutorText = Annotated[str, _Everywhere()]
"""Type of the field with the text of --executor, of a command that hands it to another program."""
EVERYWHERE = {
    "--trust": "Allow code: open and run what files name, which are the module of a task (MODULE:NAME), the "
    "agent.py of an export, and pickles of sb3:. Only if you know their authors.",
    "--executor": f"Run flights, bounds, trajectories and proofs on other machines: {FORMS}. Results are those of "
    "this machine.",
    "--gpus": "Train, sweep or assure in one process a GPU of this machine: all, or a number.",
}
"""Options of every command with their help."""
_WITH_NUMBER = {
    "--guard": "--guard-slack",
    "--front": "--budget",
    "--certify": "--certify-seconds",
}
"""Options after which a number may stand, with the names of the fields for it."""


def former(hint: Any) -> Former | None:
    """The annotation of a field by its type hint; None for a present option."""
    return next(
        (annotation for annotation in _annotations(hint) if isinstance(annotation, Former)), None
    )


def is_in_help(hint: Any) -> bool:
    """Whether the help of a command has the option of a field, by its type hint."""
    return not any(
        isinstance(annotation, (Former, _Everywhere)) for annotation in _annotations(hint)
    )


def warn_of_former(name: str, command: type, arguments: Iterable[str]) -> None:
    """Warn of every former option of a command among its arguments, with what to do instead."""
    hints = get_type_hints(command, include_extras=True)
    options = {option_name(field, hint): former(hint) for field, hint in hints.items()}
    for word in arguments:
        option = word.partition("=")[0].replace("_", "-")
        if (annotation := options.get(option)) is not None:
            warnings.warn(
                f"{option} of rans {name} {DEPRECATED}: {annotation.advice}.",
                DeprecationWarning,
                stacklevel=2,
            )


def with_numbers_named(arguments: Sequence[str]) -> list[str]:
    """Arguments in which numbers after such options have options of their own."""
    result: list[str] = []
    for before, word in zip(["", *arguments], arguments, strict=False):
        option = _WITH_NUMBER.get(before)
        result.append(f"{option}={word}" if option and _is_number(word) else word)
    return result


def _annotations(hint: Any) -> tuple[Any, ...]:
    return hint.__metadata__ if get_origin(hint) is Annotated else ()


def option_name(field: str, hint: Any) -> str:
    """Option of a field, such as --guard-slack of guard_slack, unless its annotation has another name."""
    named = (getattr(annotation, "name", None) for annotation in _annotations(hint))
    return f"--{next(filter(None, named), field).replace('_', '-')}"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
