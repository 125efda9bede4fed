"""Values that people write, as the dataclasses they are meant to be, strictly."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import Field, fields, is_dataclass
from functools import partial
from typing import Any, Literal, TypeVar, get_args, get_origin

import cattrs
from cattrs.gen import make_dict_structure_fn

from rans.errors import ConfigError, RansError, brief, meant
from rans.files import check_depth
from rans.renamed import with_present_names

T = TypeVar("T")
Range = float | tuple[float, float]
"""A number, or the least and the largest of a uniform distribution."""


LARGEST_TOML = 2**24
"""Characters of a TOML text, most of them of meshes."""
_LARGEST_BESIDE = 2**20
"""Characters beside strings and comments, which take Python's reader a microsecond each."""
_MOST_PARTS = 16
"""Of a dotted key: the reader takes a time that grows with their square."""
_STRINGS = re.compile(
    r"""
    "{3}(?:[^"\\]++|\\.|"(?!""))*+"{3,5}  # a text may end with two quotes of its own
    |'{3}(?:[^']++|'(?!''))*+'{3,5}
    |"(?:[^"\\\n]++|\\.)*+"
    |'[^'\n]*+'
    |\#[^\n]*+""",
    re.DOTALL | re.VERBOSE,
)
"""Strings of TOML in their four forms, and comments."""
_OF_KEYS = re.compile(r"[\w\- \t]+")


def is_range(setting: Field[Any]) -> bool:
    """Whether a dataclass's field, whose annotation is a text, holds a `Range`, or perhaps none."""
    return str(setting.type) in ("Range", "Range | None")


def read_toml(text: str) -> dict[str, Any]:
    """The table that a TOML text is; `ConfigError` if it is none, or too long or too deep."""
    _check_effort(text)
    try:
        table = tomllib.loads(text)
        check_depth(table)
        repr(table)  # fails on an integer with too many digits to print: refuse it here
        return table
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"this is not valid TOML: {error}.") from error


def _check_effort(text: str) -> None:
    """Refuse what would keep Python's reader of TOML, which bounds nothing, busy for minutes."""
    if len(text) > LARGEST_TOML:
        raise ConfigError(
            f"a TOML text may have at most {LARGEST_TOML:,} characters, got {len(text):,}."
        )
    beside = _STRINGS.sub("", text)
    if len(beside) > _LARGEST_BESIDE:
        raise ConfigError(
            f"a TOML text may have at most {_LARGEST_BESIDE:,} characters beside its "
            f"strings and comments, got {len(beside):,}."
        )
    dots = _OF_KEYS.sub("", beside)  # so n - 1 dots in a row are left of a key of n parts
    if "." * _MOST_PARTS in dots:
        raise ConfigError(f"a dotted key of a TOML text may have at most {_MOST_PARTS} parts.")


def entries(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every entry of a nested table, with its name from the top: ppo.gamma."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from entries(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def merged(table: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """A nested table with the entries of another in the place of its own, or beside them.

    Tables within both are merged as well; any other value, a list too, is replaced as a whole.
    """
    result = {**table, **over}
    for name in table.keys() & over.keys():
        if isinstance(table[name], Mapping) and isinstance(over[name], Mapping):
            result[name] = merged(table[name], over[name])
    return result


def structure(table: Any, cls: type[T], where: str) -> T:
    """A dataclass from plain values, nothing converted, as `dataclasses.asdict` gives them.

    Raises:
        ConfigError: an unknown key, a value of the wrong type or out of its range; it names the place.
    """
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook_func(
        lambda kind: isinstance(kind, type) and inspect.isabstract(kind), lambda value, _: value
    )  # structured by who knows which one it is
    converter.register_structure_hook_factory(
        lambda kind: bool(getattr(kind, "former_names", None)), _accepting_former_names
    )
    for kind in (bool, int, float, str):
        converter.register_structure_hook(kind, _strict)
    ranges = lambda kind: kind in (Range, Range | None)  # noqa: E731
    converter.register_structure_hook_func(ranges, partial(_range, converter))
    try:
        return converter.structure(table, cls)
    except Exception as error:  # cattrs gathers whatever the values raised in groups of its own
        reasons = cattrs.transform_error(error, path=where, format_exception=_say)
        # cattrs ends each with its place; a reader wants that first.
        places = (": ".join(reason.rsplit(" @ ", 1)[::-1]) for reason in reasons)
        raise ConfigError(f"{'; '.join(places)}.") from error


def _accepting_former_names(kind: type, converter: cattrs.Converter) -> Callable[[Any, Any], Any]:
    """Hook for a dataclass some of whose fields had other names (`rans.renamed`)."""
    usual = make_dict_structure_fn(kind, converter, _cattrs_forbid_extra_keys=True)

    def hook(value: Any, _: Any) -> Any:
        return usual(with_present_names(kind, value) if isinstance(value, Mapping) else value, kind)

    return hook


def _range(converter: cattrs.Converter, value: Any, kind: Any) -> Any:
    if value is None and kind != Range:
        return None
    pair = isinstance(value, list | tuple)
    if len(value) != 2 if pair else type(value) not in (int, float):
        raise ConfigError(
            "expected a number, or the least and the largest of two, such as [0.0, 0.1], got "
            f"{brief(value)}"
        )
    return converter.structure(value, tuple[float, float] if pair else float)


def _strict(value: Any, kind: type) -> Any:
    """No silent conversions: "64" is not 64, and True is not 1; but 1 is 1.0."""
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise ConfigError(f"expected {kind.__name__}, got {brief(value)}")
    return value


def _say(error: BaseException, kind: Any) -> str:
    if isinstance(error, RansError):
        return str(error).rstrip(".")
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        known = [one.name for one in fields(error.cl)] if is_dataclass(error.cl) else []
        keys = (brief(key) + meant(key, known) for key in sorted(error.extra_fields))
        return f"unknown key {', '.join(keys)}"
    if isinstance(error, KeyError):
        return f"the key {error} is missing"
    if isinstance(error, AttributeError):  # cattrs asks whatever it is given for its keys
        return 'expected a table, such as {"key": value}'
    if isinstance(error, TypeError):
        return "expected a table or a list of values, such as [0.5, 4.5]"
    if get_origin(kind) is Literal:
        given, _, _ = str(error).partition(" not in ")  # "gelu not in literal ..."
        return f"expected {' or '.join(map(repr, get_args(kind)))}, got {brief(given)}"
    return str(error)
