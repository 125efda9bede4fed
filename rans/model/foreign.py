"""Spacecraft of other software's files, which packages read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rans.base.registry import Registry
from rans.model.spacecraft import Spacecraft

Importer = Callable[[Path, str, Spacecraft], tuple[Spacecraft, str, tuple[str, ...]]]
"""Reads a file as a spacecraft of a name, which moves as another one and has of it what the file does not say.

It gives the craft, how the file was read for the first line of a new one, and remarks: clauses about what the craft
has not of the file. It refuses (`ConfigError`) a file that is damaged or describes what no spacecraft is.
"""
IMPORTERS: Registry[Importer] = Registry("reader of spacecraft files", "rans.importers")
"""By the suffix of the files, without its point."""


def is_foreign(name: object) -> bool:
    """Whether a name is that of a file that packages read, by its suffix."""
    return Path(str(name)).suffix.lower()[1:] in IMPORTERS
