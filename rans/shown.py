"""How the package's values show themselves: in a line of text, and in a notebook."""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any


class Shown:
    """A value that notebooks show as a table, and with a picture where there is one to draw."""

    def _repr_html_(self) -> str:
        """HTML, which Jupyter asks for; found by name, as what draws lies in a higher layer."""
        return importlib.import_module("rans.show.notebook").html(self)


class Settings(Shown):
    """A dataclass of which a text tells only what is not the default."""

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
    """The texts under a dataclass's fields, which Python itself does not keep; none without its source."""
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
