"""Errors planted into the source of modules, which are compiled anew and leave the true ones alone."""

from __future__ import annotations

import importlib
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

ERRORS: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
"""Errors of sources by what they are planted into; planted.toml says what their entries are."""
Error = tuple[str, str, str]
"""Module, text of its source that is there exactly once, and the text in its place."""


def planted(names: Sequence[str], *errors: Error) -> dict[str, ModuleType]:
    """Modules with errors, by their names.

    Args:
        names: full names of the modules, each after those of them that it imports.
        errors: what is replaced in which of them.
    """
    modules: dict[str, ModuleType] = {}
    true = {name: importlib.import_module(name) for name in names}
    try:
        for name in names:
            file = str(true[name].__file__)
            source = Path(file).read_text()
            for _, old, new in (error for error in errors if error[0] == name):
                assert source.count(old) == 1, (name, old, source.count(old))
                source = source.replace(old, new)
            modules[name] = ModuleType(name)
            modules[name].__file__ = file
            sys.modules[name] = modules[name]
            exec(compile(source, file, "exec"), modules[name].__dict__)
            # Readers of tables look for annotations by the module's name, which is that of the true one later.
            for kind in filter(is_dataclass, vars(modules[name]).values()):
                kind.__annotations__ = get_type_hints(kind)
    finally:
        sys.modules.update(true)
    assert all(error[0] in names for error in errors)
    return modules
