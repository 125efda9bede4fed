"""One declaration of each argument: a command has those of its Python function, with their defaults and texts.

The function of `rans` declares an argument once, in its signature and in the "Args:" of its docstring.
`command_of` makes the options of a command from these. The class of the command declares only what Python has not.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import Field, dataclass, fields
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from typing_extensions import Doc
from tyro.conf import Positional, arg

from rans.base.files import command_line
from rans.cli.options import Trust, option_name
from rans.model.dynamics import State
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions

Described = TypeVar("Described", bound=type)

POSE = "X Y HEADING ..."
"""Placeholder of a pose in help."""
OwnState = Annotated[tuple[str, ...], arg(metavar=POSE)]
"""Type of an option that takes a state."""

_FORMS = {
    OwnState: "Write x, y (m) and heading, such as 3 1 40deg, in space x, y, z and perhaps roll, pitch, yaw; "
    "angles are in degrees, or with a unit, such as 0.7rad. Velocities follow by name: v.x=0.1 (m/s), w=0.1 "
    "(rad/s). With a start alone the goal is the origin.",
}
"""How a terminal has values for which Python has objects; printed with the first option of its type."""


class Options:
    """Base class of a command whose options `command_of` makes: type checkers cannot see them."""

    if TYPE_CHECKING:
        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

        def __init__(self, *arguments: Any, **options: Any) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

    command_line = staticmethod(command_line)
    texts: ClassVar[dict[str, str]] = {}
    """Texts of the options that are arguments of the function."""
    function: ClassVar[Callable[..., Any]]
    """Python function with the same arguments."""

    def call(self, **others: Any) -> Any:
        """Call the function with the options that are its arguments, but for those that are others."""
        call = inspect.signature(self.function).bind_partial()
        call.arguments = {name: getattr(self, name) for name in self.texts} | others
        return self.function(*call.args, **call.kwargs)

    def changed(self, *names: str) -> list[str]:
        """Words of a command that repeat these options where they are not left at their defaults."""
        hints = get_type_hints(type(self), include_extras=True)
        defaults = {field.name: field.default for field in fields(self)}
        words: list[str] = []
        for name in names:
            value = getattr(self, name)
            if value == defaults[name]:
                continue
            words.append(option_name(name, hints[name]))
            if isinstance(value, tuple):
                words += map(str, value)
            elif value is not True:
                short = f"{value:g}" if isinstance(value, float) else str(value)
                # Six digits are not all of some numbers.
                words.append(
                    short if not isinstance(value, float) or float(short) == value else repr(value)
                )
        return words


def word(metavar: str, kind: Any = str) -> Any:
    """Type of an argument that is a word without an option, or of several words with ``tuple[str, ...]``."""
    return Annotated[kind, Positional, arg(metavar=metavar)]


def command_of(
    function: Callable[..., Any],
    *,
    without: Collection[str] = (),
    defaults: dict[str, Any] | None = None,
    **kinds: Any,
) -> Callable[[Described], Described]:
    """Decorator of a command: a frozen dataclass with the arguments of a function as options, before its own.

    Args:
        function: function of `rans` whose signature and docstring declare the arguments.
        without: arguments that only Python has, such as objects.
        defaults: defaults that differ, where the terminal tells later what Python's default says.
        **kinds: types that the terminal reads, where they do not follow from those of the function.

    Raises:
        TypeError: the class declares an argument of the function again, or an argument has no text.
    """

    def decorate(described: Described) -> Described:
        """Make the command's class: its fields are the arguments in the function's order, then its own.

        The class is changed in place, and then made a dataclass; help, pages and completion read ``texts``.
        """
        declared = inspect.unwrap(function)
        parameters = inspect.signature(declared).parameters
        own = inspect.get_annotations(described)
        if twice := sorted(own.keys() & parameters.keys()):
            raise TypeError(
                f"{described.__name__} declares {', '.join(twice)} of its function again"
            )
        texts = argument_texts(declared)
        made: dict[str, Any] = {}
        for name, parameter in parameters.items():
            if name in without or parameter.kind is parameter.VAR_KEYWORD:
                continue
            if declared.__doc__ and name not in texts:
                raise TypeError(f"the docstring of {declared.__name__} has no text for {name}")
            made[name] = kinds.get(name) or _kind(name, parameter, declared)
            value = (defaults or {}).get(name, parameter.default)
            if parameter.kind is not parameter.VAR_POSITIONAL and value is not parameter.empty:
                setattr(described, name, _written(value, made[name]))
        shown = _terminal_texts(made, texts)
        described.texts = shown  # pyrefly: ignore[missing-attribute]
        made = {name: Annotated[kind, Doc(shown[name])] for name, kind in made.items()}
        described.function = staticmethod(function)  # pyrefly: ignore[missing-attribute]
        # A dataclass takes fields without a default first.
        order = sorted((made | own).items(), key=lambda entry: hasattr(described, entry[0]))
        described.__annotations__ = dict(order)
        return dataclass(frozen=True)(described)  # pyrefly: ignore[bad-return]

    return decorate


def argument_texts(function: Callable[..., Any]) -> dict[str, str]:
    """Texts of the arguments of a function, from the section "Args:" of its docstring.

    "See `evaluate`" stands for the text of the argument of that name of this function.
    """
    section = re.search(r"^Args:\n((?: +.*\n)+)", f"{inspect.getdoc(function)}\n", re.MULTILINE)
    entries = re.split(r"^ {4}(?=\S)", section[1], flags=re.MULTILINE)[1:] if section else []
    texts = {}
    for entry in entries:
        name, _, text = entry.partition(":")
        name = name.strip().lstrip("*")
        texts[name] = " ".join(text.split())
        if same := re.match(r"see `(?:([\w.]+)\.)?(\w+)`(?:; (.+))?\.?$", texts[name]):
            module, other, more = same.groups()
            described = getattr(import_module(module or function.__module__), other)
            other_text = argument_texts(inspect.unwrap(described))[name]
            texts[name] = f"{other_text} {_sentence(more or '')}".rstrip()
    return texts


def _terminal_texts(kinds: dict[str, Any], texts: dict[str, str]) -> dict[str, str]:
    """The texts as help has them: a sentence that begins with a capital, and the form of values that are words."""
    results = {}
    explained = []
    for name, kind in kinds.items():
        text = texts.get(name, "").replace("``", "`").removeprefix("whether to ")
        form = _FORMS.get(kind, "") if kind not in explained else ""
        explained.append(kind)
        results[name] = f"{_sentence(text)} {form}".rstrip()
    return results


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _kind(name: str, parameter: inspect.Parameter, function: Callable[..., Any]) -> Any:
    """Type that the terminal reads for a parameter of a function, from its annotation, as tyro takes it."""
    if name == "trust":
        return Trust
    kind = parameter.annotation
    if isinstance(
        kind, str
    ):  # of the function's own source, as `from __future__ import annotations` leaves it
        kind = eval(kind, function.__globals__)
    parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    parts = tuple(part for part in parts if part is not NoneType)
    if State in parts:
        return OwnState
    if get_origin(parts[0]) is Sequence:
        (each,) = get_args(parts[0])
        several = tuple[each, ...] | None if _is_optional(kind) else tuple[each, ...]
        return Annotated[several, arg(metavar="NAME...")]
    if {Spacecraft, Conditions} & {*parts}:  # a name or a file
        return kind if len(parts) == 1 else str | None if _is_optional(kind) else str
    if {*parts} == {str, Path}:
        return Path | None if _is_optional(kind) else Path
    return kind


def _is_optional(kind: Any) -> bool:
    return NoneType in get_args(kind)


def _written(value: Any, kind: Any) -> Any:
    """A default of the function as the terminal has it: nothing is written where Python has None."""
    plain = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    return () if value is None and get_origin(plain) is tuple else value
