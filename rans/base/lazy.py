"""Names of a module that are imported on first use.

The module declares them once, for type checkers and for Python: as imports below ``if TYPE_CHECKING:``, such as
``from rans.episode.flight import Flight as Flight``.
"""

from __future__ import annotations

import ast
from pathlib import Path


def homes(file: str) -> dict[str, str]:
    """The module that defines each name which a module imports for type checkers under the same name, by name.

    Args:
        file: the module's ``__file__``.
    """
    return {
        alias.name: statement.module
        for block in ast.parse(Path(file).read_text("utf-8")).body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for statement in block.body
        if isinstance(statement, ast.ImportFrom) and statement.module
        for alias in statement.names
        if alias.asname == alias.name
    }
