"""How the package's values are displayed: as a line of text, and in a notebook."""

from __future__ import annotations

import ast
import inspect
import itertools
from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

html_renderer: Callable[[Any], str] = repr
"""Writes a value as HTML. `rans` sets it when it is imported, as the renderer lies in a higher layer."""


class NotebookRepr:
    """A value that notebooks display as a table, with a drawing if there is one."""

    def _repr_html_(self) -> str:
        """HTML for Jupyter, which calls this method by name."""
        return html_renderer(self)


class Settings(NotebookRepr):
    """A dataclass whose `repr` lists only the fields that differ from their defaults."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__repr__ = (
            Settings.__repr__
        )  # dataclasses write one for every class that has none of its own

    def __repr__(self) -> str:
        given: Any = self
        own = {one.name: repr(getattr(self, one.name)) for one in fields(given)}
        told = (
            f"{one.name}={own[one.name]}"
            for one in fields(given)
            if own[one.name] != repr(default(one))
        )
        return f"{type(self).__name__}({', '.join(told)})"


def meanings(described: type) -> dict[str, str]:
    """Docstrings of a dataclass's fields, read from its source; empty if the source is missing."""
    found = {}
    for part in reversed(described.__mro__):
        if not is_dataclass(part):
            continue
        try:
            written: Any = ast.parse(inspect.cleandoc("\n" + inspect.getsource(part))).body[0]
        except (OSError, SyntaxError):
            continue
        for field, text in itertools.pairwise(written.body):
            match field, text:
                case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str(meaning))):
                    found[name] = " ".join(meaning.split())
    return found


def default(one: Field[Any]) -> Any:
    """The default of a dataclass's field; `MISSING` where there is none."""
    return one.default if one.default_factory is MISSING else one.default_factory()
