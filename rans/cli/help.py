"""Help of the command line: an overview in groups, and pages of commands with examples."""

from __future__ import annotations

import inspect
import re
import shutil
import textwrap
from collections.abc import Mapping

from rans.cli.commands import Command
from rans.cli.options import EVERYWHERE

START = {
    "rans init mine.toml": "a file for your spacecraft's numbers",
    "rans compare mine.toml": "agents, controllers, bounds",
    "rans train go-to-pose --spacecraft mine.toml": "an agent of its own",
}
"""First commands, each with its result."""


def overview(about: str, commands: Mapping[str, type[Command]]) -> str:
    """Text of ``rans`` without arguments: usage, and a line for every command in its group."""
    width = shutil.get_terminal_size().columns
    lines = ["usage: rans COMMAND [OPTIONS]", "", *_filled(about, width), "", "Start here:"]
    for command, gives in START.items():
        whole = f"  {command:<45} # {gives}"
        lines.append(whole if len(whole) <= width else f"  {command}")
    for title in dict.fromkeys(command.group for command in commands.values()):
        lines += ["", f"{title}:"]
        for name, command in commands.items():
            if command.group == title:
                first = f"  {name:<11}"
                lines += _filled(f"{first}{_summary(command)}", width, " " * len(first))
    lines += ["", *_everywhere(width)]
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
    return re.split(r"[;:]|\.(?!\d)", text, maxsplit=1)[0] + "."


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
