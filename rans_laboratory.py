"""Entry points of `rans validate` and `rans benchmark`, by which the core finds them without knowing them."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

_HERE = Path(__file__).parent
_HOMES = {
    "Validate": "validation.commands.validate",
    "Benchmark": "validation.commands.benchmark",
    "validate": "validation.functions",
    "benchmark": "validation.functions",
}
"""Module of each entry point."""


def __getattr__(name: str) -> Any:
    """An entry point, from the ``validation`` that is ours, whatever has this name where the user stands.

    In a wheel it lies in ``rans/laboratory``, so that the name is not installed; in a working copy
    beside ``rans`` (docs/decisions/software.md).
    """
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    folders = (_HERE / "rans" / "laboratory", _HERE)
    home = str(next(folder for folder in folders if (folder / "validation").is_dir()))
    if sys.path[:1] != [home]:
        sys.path.insert(0, home)
    return getattr(importlib.import_module(_HOMES[name]), name)
