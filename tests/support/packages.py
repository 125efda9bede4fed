"""Tests of the core that a package of this repository takes part in; the core's own suite runs without it.

A test has the mark `needs`, a parameter `of`; a file that imports a package is passed over as where any other
library is absent (`conftest.py`).
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import pytest

from rans.abilities import EXTRA_OF
from rans.cli.commands import COMMANDS

ROOT = Path(__file__).parents[2]
MODULES = [f"rans_{file.parent.name}" for file in (ROOT / "packages").glob("*/pyproject.toml")]
"""Modules of the packages of this repository."""


def hide_absent() -> None:
    """Take packages that are not installed off the path, where pytest puts those of a checkout."""
    for module in MODULES:
        try:
            distribution(module)
        except PackageNotFoundError:
            folder = str(ROOT / "packages" / module.removeprefix("rans_"))
            sys.path[:] = [place for place in sys.path if place != folder]


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
