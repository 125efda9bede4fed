"""Commands of packages beside the core, which a core alone lacks."""

from __future__ import annotations

import pytest

from rans.abilities import EXTRA_OF
from rans.cli.commands import COMMANDS


def needs_command(line: str) -> None:
    """Skip the test if the first word of a command line is a command whose package is not installed."""
    name = line.partition(" ")[0]
    if name in EXTRA_OF and name not in COMMANDS:
        pytest.skip(f"needs the package of rans {name}")
