"""Former names of settings, which are accepted with a warning for one more version."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")


def renamed(**former: str) -> Callable[[type[T]], type[T]]:
    """Decorator of a dataclass whose fields had other names in the previous version.

    Each keyword is a former name and its value the present one. A former name is still accepted as a keyword
    argument, as a key of a table (`rans.structure.structure`) and as an attribute to read; each use gives a
    `DeprecationWarning` with the present name.
    """

    def decorate(cls: type[T]) -> type[T]:
        inherited: Mapping[str, str] = getattr(cls, "former_names", {})
        initialise = cls.__init__

        @functools.wraps(initialise)
        def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
            for old in former.keys() & kwargs.keys():
                _warn(cls, old, former[old])
                kwargs[former[old]] = kwargs.pop(old)
            initialise(self, *args, **kwargs)

        cls.__init__ = __init__
        cls.former_names = {**inherited, **former}  # type: ignore[attr-defined]
        for old, new in former.items():
            setattr(cls, old, property(functools.partial(_read, old, new)))
        return cls

    return decorate


def present_name(cls: type, name: str) -> str:
    """Present name of a setting; a former name gives a warning."""
    new = getattr(cls, "former_names", {}).get(name)
    if new is None:
        return name
    _warn(cls, name, new)
    return new


def with_present_names(cls: type, table: Mapping[str, Any]) -> dict[str, Any]:
    """Table of settings under their present names; former names give a warning."""
    result = dict(table)
    for old, new in getattr(cls, "former_names", {}).items():
        if old in result:
            _warn(cls, old, new)
            result[new] = result.pop(old)
    return result


def _read(old: str, new: str, owner: Any) -> Any:
    _warn(type(owner), old, new)
    return getattr(owner, new)


def _warn(cls: type, old: str, new: str) -> None:
    warnings.warn(
        f"{cls.__name__}.{old} is deprecated and will be removed in the next version: name it {new}.",
        DeprecationWarning,
        stacklevel=3,
    )
