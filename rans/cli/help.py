"""Help of the command line: an overview in groups, and pages of commands with examples."""

from __future__ import annotations

import inspect
import re
import shutil
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from rans.cli.commands import BUILT_IN, Command
from rans.cli.options import EVERYWHERE, is_in_help, option_name, texts_of

START = {
    "rans init mine.toml": "a file for your spacecraft's numbers",
    "rans compare mine.toml": "agents, controllers, bounds",
    "rans train go-to-pose --spacecraft mine.toml": "an agent of its own",
}
"""First commands, each with its result."""


def overview(about: str, commands: Mapping[str, type[Command]]) -> str:
    """Text of ``rans`` without arguments: usage, summaries of the core's commands, and names of the others."""
    width = shutil.get_terminal_size().columns
    lines = ["usage: rans COMMAND [OPTIONS]", "", *_filled(about, width), "", "Start here:"]
    for command, gives in START.items():
        whole = f"  {command:<45} # {gives}"
        lines.append(whole if len(whole) <= width else f"  {command}")
    for title in dict.fromkeys(commands[name].group for name in BUILT_IN):
        lines += ["", f"{title}:"]
        for name in BUILT_IN:
            if commands[name].group == title:
                first = f"  {name:<11}"
                lines += _filled(f"{first}{_summary(commands[name])}", width, " " * len(first))
    if others := ", ".join(name for name in commands if name not in BUILT_IN):
        lines += ["", "Of packages:", *_filled(f"  {others}.", width, "  ")]
    lines += ["", *_everywhere(width)]
    lines += ["", *_filled("`rans COMMAND --help` has options and examples.", width)]
    return "\n".join(lines)


def _everywhere(width: int) -> list[str]:
    """Lines about the options that every command takes."""
    lines = ["In every command:"]
    for option, text in EVERYWHERE.items():
        lines += _filled(f"  {option}  {text}", width, " " * 11)
    return lines


def _summary(command: type[Command]) -> str:
    """First clause of the docstring of a command."""
    text = " ".join((command.__doc__ or "").split())
    return re.split(r"[;:.]", text, maxsplit=1)[0] + "."


def _filled(text: str, width: int, indent: str = "") -> list[str]:
    """Lines of a text up to a width."""
    return textwrap.wrap(
        text, width, break_long_words=False, break_on_hyphens=False, subsequent_indent=indent
    )


def print_above(command: type[Command]) -> None:
    """Print what stands above the options of a command: its docstring."""
    width = shutil.get_terminal_size().columns
    for part in inspect.cleandoc(command.__doc__ or "").split("\n\n"):
        print("\n".join([*_filled(" ".join(part.split()), width), ""]))


def print_below(command: type[Command]) -> None:
    """Print what stands below the options of a command: options of all commands, its examples and its page."""
    width = shutil.get_terminal_size().columns
    print("\n".join(["", *_everywhere(width)]))
    print("\nExamples:")
    for line in command.examples:
        whole = f"  {line}"
        print(whole if len(whole) <= width else " \\\n".join(_filled(whole, width - 2, "      ")))
    print(f"\nGuide: {command.guide}")


@contextmanager
def explained(commands: Iterable[type], arguments: Sequence[str] = ()) -> Iterator[None]:
    """Give tyro one-line texts of fields, plain names of values, and only meaningful defaults for a while.

    By itself tyro treats the second line of a text as a new paragraph, and writes {None}|STR and (default: None).

    Args:
        commands: classes of commands, whose annotations change.
        arguments: what is parsed. Options of every command among them are known, and otherwise hidden.
    """
    before = {described: described.__annotations__ for described in commands}
    options = {word.partition("=")[0].replace("_", "-") for word in arguments}
    try:
        for described in before:
            _explain(described, options)
        yield
    finally:
        for described, annotations in before.items():
            described.__annotations__ = annotations


def _explain(described: type, options: Collection[str]) -> None:
    """Give the fields of a command texts for tyro, and hide options of every command but these."""
    from typing_extensions import Doc
    from tyro.conf import Suppress

    hints = get_type_hints(described, include_extras=True)
    texts = texts_of(described)
    described.__annotations__ = {
        name: Annotated[hint, Doc(texts[name]), *_tyro_options(name, hint)]
        if name in texts
        else hint
        for name, hint in hints.items()
    }
    for name, hint in hints.items():
        if not is_in_help(hint) and option_name(name, hint) not in options:
            described.__annotations__[name] = Suppress[hint]


def _tyro_options(name: str, hint: Any) -> list[Any]:
    """Options of tyro for the display of a field's value and its default."""
    from tyro.conf import FlagCreatePairsOff, arg

    plain = hint
    annotations = ()
    if get_origin(hint) is Annotated:
        plain, *annotations = get_args(hint)
    has_metavar = any(getattr(annotation, "metavar", None) for annotation in annotations)
    results: list[Any] = [arg(help_behavior_hint=_default)]
    metavar = None if has_metavar else _metavar(name, plain)
    if metavar:
        results.append(arg(metavar=metavar))
    if plain is bool:
        results.append(FlagCreatePairsOff)
    return results


def _default(value: str) -> str:
    """Text of a default value; empty if there is no default."""
    return "" if value in ("", "''", "None", "False", "inf") else f"(default: {value})"


def _metavar(name: str, hint: Any) -> str | None:
    """Placeholder of an option's value in help, such as FILE; None: that of tyro."""
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    kinds = [part for part in parts if part is not NoneType]
    if len(kinds) != 1:
        return None
    (kind,) = kinds
    if get_origin(kind) is Literal:
        return f"{{{','.join(map(str, get_args(kind)))}}}"
    if get_origin(kind) is tuple:
        return f"{_metavar(name, get_args(kind)[0]) or 'NAME'}..."
    if kind is Path:
        return "FOLDER" if name in ("output", "resume") else "FILE"
    return {str: "NAME", int: "INT", float: "NUMBER"}.get(kind)
