"""Former settings, which are accepted with a warning for one more version: renamed, moved or now constant."""

from __future__ import annotations

import functools
import warnings
from abc import ABCMeta
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeVar

from rans.errors import ConfigError, RansDeprecationWarning, brief

T = TypeVar("T")

DEPRECATED = "is deprecated and will be removed in the next version"
"""Words of every warning of a former name."""


def renamed(**former: str) -> Callable[[type[T]], type[T]]:
    """Decorator of a dataclass whose fields had other names in the previous version.

    Each keyword is a former name and its value the present one, which may lie within a field that is a dataclass
    ("arrived.weight"); a field whose value has become a dataclass may keep its name (memory="memory.kind"). A
    former name is still accepted as a keyword argument, as a key of a table (`rans.structure.structure`) and as an
    attribute to read; each use gives a `DeprecationWarning` with the present name.
    """

    def decorate(cls: type[T]) -> type[T]:
        inherited: Mapping[str, str] = getattr(cls, "former_names", {})
        cls.former_names = {**inherited, **former}  # type: ignore[attr-defined]
        for old, new in former.items():
            if new != f"{old}.{new.rpartition('.')[2]}":
                setattr(cls, old, property(functools.partial(_read, old, new)))
        return _accepting(cls)

    return decorate


def now_constant(**constants: Any) -> Callable[[type[T]], type[T]]:
    """Decorator of a dataclass that had fields which are constants now.

    Each keyword is a former field and its constant. The constant itself is still accepted as a keyword argument and
    in tables, with a `DeprecationWarning`; any other value is a `ConfigError`.
    """

    def decorate(cls: type[T]) -> type[T]:
        inherited: Mapping[str, Any] = getattr(cls, "former_constants", {})
        cls.former_constants = {**inherited, **constants}  # type: ignore[attr-defined]
        return _accepting(cls)

    return decorate


class AcceptsFormerNames(ABCMeta):
    """Metaclass whose classes, and those derived from them, accept former names as keyword arguments."""

    if not TYPE_CHECKING:

        def __call__(cls, *args: Any, **kwargs: Any) -> Any:
            """Object of the class, whose former settings have been given their present names."""
            return super().__call__(*args, **with_present_names(cls, kwargs, in_call=True))


def _accepting(cls: type[T]) -> type[T]:
    """The class, which accepts former names as keyword arguments."""
    if isinstance(cls, AcceptsFormerNames) or hasattr(cls.__init__, "accepts_former_names"):
        return cls
    initialise = cls.__init__

    @functools.wraps(initialise)
    def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
        initialise(self, *args, **with_present_names(cls, kwargs, in_call=True))

    __init__.accepts_former_names = True  # type: ignore[attr-defined]
    cls.__init__ = __init__
    return cls


def present_name(cls: type, name: str) -> str:
    """Present name of a setting; a former name gives a warning."""
    new = getattr(cls, "former_names", {}).get(name)
    if new is None:
        return name
    _warn(cls, name, f"name it {new}")
    return new


def with_present_names(
    cls: type, table: Mapping[str, Any], in_call: bool = False
) -> dict[str, Any]:
    """Table of settings under their present names; former names give a warning.

    Args:
        cls: dataclass of the settings.
        table: settings, of which those within others are tables too.
        in_call: whether the settings are keyword arguments, of which those within others are dataclasses.

    Raises:
        ConfigError: a former setting that is a constant now has another value, or two former names of one setting
            have different values.
    """
    result = dict(table)
    # a derived class may have such a setting again
    own = {field.name for field in fields(cls)} if is_dataclass(cls) else set[str]()
    for name in (getattr(cls, "former_constants", {}).keys() & result.keys()) - own:
        drop_constant(cls, name, result.pop(name))
    present = dict[str, Any]()
    for old, new in getattr(cls, "former_names", {}).items():
        if old not in result or (old in own and not is_former_value(result[old], old, new)):
            continue
        value = result.pop(old)
        if present.setdefault(new, value) != value:
            raise ConfigError(
                f"{cls.__name__}.{new} takes the place of {old} and of another setting, so that they must be "
                f"equal, got {brief(value)} and {brief(present[new])}."
            )
        _warn(cls, old, f"name it {new}")
    for new, value in present.items():
        owner, _, inner = new.partition(".")
        if inner:
            value = _with(result.get(owner, getattr(cls, owner) if in_call else {}), inner, value)
        result[owner] = value
    return result


def is_former_value(value: Any, old: str, new: str) -> bool:
    """Whether a field that has become a dataclass under its own name is given its former value."""
    return new.startswith(f"{old}.") and not (isinstance(value, Mapping) or is_dataclass(value))


def drop_constant(cls: type, name: str, value: Any) -> None:
    """Warn of a former setting that is a constant now.

    Raises:
        ConfigError: the value is not the constant.
    """
    constant = cls.former_constants[name]  # type: ignore[attr-defined]
    same = value == constant or (isinstance(value, list) and tuple(value) == constant)
    if not same:
        raise ConfigError(
            f"{cls.__name__}.{name} is no longer a setting: it is always {constant!r}, got {brief(value)}. "
            "For another value derive a class of your own that overrides it (docs/own_task.md)."
        )
    _warn(cls, name, f"leave it out, as it is always {constant!r}")


def _with(owner: Any, name: str, value: Any) -> Any:
    """A table or dataclass with another value of an entry."""
    return {**owner, name: value} if isinstance(owner, Mapping) else replace(owner, **{name: value})


def _read(old: str, new: str, owner: Any) -> Any:
    _warn(type(owner), old, f"name it {new}")
    return attrgetter(new)(owner)


def _warn(cls: type, old: str, advice: str) -> None:
    warnings.warn(
        f"{cls.__name__}.{old} {DEPRECATED}: {advice}.",
        RansDeprecationWarning,
        stacklevel=3,
    )
