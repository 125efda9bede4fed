"""Source files of the core and of the packages, for tests of what holds in all of them."""

from __future__ import annotations

from pathlib import Path

from tests.support.processes import ROOT

FOLDERS = [ROOT / "rans", *sorted((ROOT / "packages").glob("*/rans_*"))]
"""Folders of modules that users install; each is imported by its name."""


def sources() -> list[tuple[str, Path]]:
    """Every module that users install: name and file."""
    return [
        (module_name(file, folder.parent), file)
        for folder in FOLDERS
        for file in sorted(folder.rglob("*.py"))
    ]


def module_name(file: Path, root: Path) -> str:
    """Name of the module of a file below a folder, as it is imported."""
    parts = file.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
