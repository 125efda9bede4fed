"""The command line: ``rans COMMAND``; each command is a dataclass whose fields are its options."""

from __future__ import annotations

import importlib
import sys
import time
from typing import Any, Protocol

from rans.errors import RansError

STARTED = time.monotonic()
"""When this process began to work, s: commands state their wall time from here."""

COMMANDS = ("train", "evaluate", "compare", "validate", "benchmark", "list")


class Command(Protocol):
    """A parsed command line."""

    def run(self) -> int:
        """Do it; 0 when all went well, 1 when a check or a run failed."""
        ...


def main(arguments: list[str] | None = None) -> int:
    """Run one command; a user's mistake ends in one sentence and exit code 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        return _parse(arguments).run()
    except RansError as error:
        print(f"rans: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nrans: interrupted; what was finished is kept.", file=sys.stderr)
        return 130


def _parse(arguments: list[str]) -> Any:
    """Import only the command that was asked for, so that ``rans train`` loads no Drake."""
    import tyro

    wanted = [c for c in COMMANDS if c in arguments[:1]] or list(COMMANDS)
    modules = {name: importlib.import_module(f"rans.cli.{name}") for name in wanted}
    commands = {name: module.COMMAND for name, module in modules.items()}
    return tyro.extras.subcommand_cli_from_dict(commands, args=arguments, prog="rans")
