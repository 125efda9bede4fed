"""Options that are treated alike in all commands: former ones, and those that every command takes."""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, get_origin, get_type_hints

from rans.errors import ConfigError, RansDeprecationWarning
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
class NumberOf:
    """Annotation of a command's field whose number stands after another option, as in `--guard 0.01`."""

    option: str
    """The option before the number."""


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


def former(hint: Any) -> Former | None:
    """The annotation of a field by its type hint; None for a present option."""
    return next(
        (annotation for annotation in _annotations(hint) if isinstance(annotation, Former)), None
    )


def is_in_help(hint: Any) -> bool:
    """Whether the help of a command has the option of a field, by its type hint."""
    return not any(
        isinstance(annotation, (Former, NumberOf, _Everywhere)) for annotation in _annotations(hint)
    )


def warn_of_former(name: str, command: type, arguments: Sequence[str]) -> None:
    """Warn of every former option of a command among its arguments, with what to do instead.

    Raises:
        ConfigError: a former option and its present one are both among them.
    """
    hints = get_type_hints(command, include_extras=True)
    options = {option_name(field, hint): former(hint) for field, hint in hints.items()}
    for word in arguments:
        option = word.partition("=")[0].replace("_", "-")
        if (annotation := options.get(option)) is not None:
            _warn(name, option, annotation.advice, arguments)


def _warn(name: str, option: str, advice: str, arguments: Sequence[str]) -> None:
    """Warn of a former option, or refuse it beside its present one."""
    if both := _present_too(advice, arguments):
        raise ConfigError(
            f"{option} is the former word of {both}, and both are given: leave {option} out."
        )
    warnings.warn(
        f"{option} of rans {name} {DEPRECATED}: {advice}.", RansDeprecationWarning, stacklevel=3
    )


def _present_too(advice: str, arguments: Sequence[str]) -> str:
    """The option that an advice names, with its value or entry, where it is among the arguments; else ""."""
    match = re.search(r"write (--[a-z-]+)(?: ([A-Za-z_.]+)(=)?)?", advice)
    if match is None:
        return ""
    option, value, is_entry = match.groups()
    for at, word in enumerate(arguments):
        name, equals, own = word.partition("=")
        if name.replace("_", "-") != option:
            continue
        values = [own] if equals else itertools.takewhile(_is_value, arguments[at + 1 :])
        if is_entry:
            # One entry of several, such as --set mass=VALUE.
            if any(text.partition("=")[0] == value for text in values):
                return f"{option} {value}="
        else:
            return option
    return ""


def _is_value(word: str) -> bool:
    return not word.startswith("--")


def number_of(hint: Any) -> str:
    """Option after which the number of a field stands, by its type hint; "" for a field with an option."""
    options = (a.option for a in _annotations(hint) if isinstance(a, NumberOf))
    return next(options, "")


def with_numbers_named(command: type, arguments: Sequence[str]) -> list[str]:
    """Arguments of a command in which numbers after other options (`NumberOf`) have options of their own."""
    hints = get_type_hints(command, include_extras=True)
    names = {number_of(hint): option_name(field, hint) for field, hint in hints.items()}
    result: list[str] = []
    for before, word in zip(["", *arguments], arguments, strict=False):
        option = names.get(before) if before else None
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
