"""Display of the package's values as a line of text and in notebooks."""

from __future__ import annotations

import ast
import inspect
import itertools
from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from typing import Any

html_renderer: Callable[[Any], str] = repr
"""Function that returns the HTML of a value. The import of `rans` sets it, as the renderer is in a higher layer."""


figure_maker: Callable[[Any, int], Any] | None = None
"""Function that draws an episode of a flight as a figure of matplotlib; set as `html_renderer`."""


def figure_of(flight: Any, episode: int) -> Any:
    """Figure of an episode of a flight."""
    assert figure_maker is not None
    return figure_maker(flight, episode)


class NotebookRepr:
    """Base class of values that notebooks display as a table, with a drawing if there is one."""

    def _repr_html_(self) -> str:
        """HTML of the value for Jupyter."""
        return html_renderer(self)


class Settings(NotebookRepr):
    """Base class of dataclasses whose `repr` lists only the fields that differ from their defaults."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__repr__ = (
            Settings.__repr__
        )  # the dataclass decorator adds one to every class without its own

    def __repr__(self) -> str:
        settings: Any = self
        texts = {field.name: repr(getattr(self, field.name)) for field in fields(settings)}
        changed = (
            f"{field.name}={texts[field.name]}"
            for field in fields(settings)
            if texts[field.name] != repr(default(field))
        )
        return f"{type(self).__name__}({', '.join(changed)})"


def meanings(described: type) -> dict[str, str]:
    """Docstrings of the fields of a dataclass by name, read from its source and those of its bases.

    They are empty without a source. A field without a docstring of its own has the one of a base.
    """
    texts = {}
    for part in reversed(described.__mro__):
        try:
            written: Any = ast.parse(inspect.cleandoc("\n" + inspect.getsource(part))).body[0]
        except (OSError, SyntaxError, TypeError):  # the last of what Python has built in
            continue
        for field, text in itertools.pairwise(written.body):
            match field, text:
                case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str(meaning))):
                    texts[name] = " ".join(meaning.split())
    return texts


def default(field_of_class: Field[Any]) -> Any:
    """Default of a dataclass field; `MISSING` if it has none."""
    return (
        field_of_class.default
        if field_of_class.default_factory is MISSING
        else field_of_class.default_factory()
    )
