"""Exit codes of commands."""

from __future__ import annotations

from rans.cli import main


def code_of(arguments: list[str]) -> int:
    """The exit code a shell would see."""
    try:
        return main(arguments)
    except SystemExit as end:  # tyro's way of ending after help and after a wrong option
        return end.code if isinstance(end.code, int) else 1
