"""Tests of the core that a package of this repository takes part in; the core's own suite runs without it."""

from __future__ import annotations

import importlib.util
from typing import Any

import pytest

from rans.abilities import EXTRA_OF
from rans.cli.commands import COMMANDS


def is_installed(package: str) -> bool:
    """Whether a package of this repository is installed."""
    return importlib.util.find_spec(f"rans_{package}") is not None


def needs(package: str) -> pytest.MarkDecorator:
    """Mark of a test that a package takes part in; it is skipped where the package is not installed."""
    return pytest.mark.skipif(not is_installed(package), reason=f"needs packages/{package}")


def of(package: str, *values: Any) -> Any:
    """Parameters of a test with the mark of `needs`."""
    return pytest.param(*values, marks=needs(package))


def needs_command(line: str) -> None:
    """Skip the test if the first word of a command line is a command whose package is not installed."""
    name = line.partition(" ")[0]
    if name in EXTRA_OF and name not in COMMANDS:
        pytest.skip(f"needs the package of rans {name}")
