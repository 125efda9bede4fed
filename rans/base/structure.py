"""Strict conversion of TOML and JSON tables to dataclasses.

Every file of a user passes it: unknown keys and wrong kinds are a `ConfigError` with the key's place.
"""

from __future__ import annotations

import inspect
import re
import tomllib
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields, is_dataclass
from functools import cache, partial
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import cattrs
import numpy as np
from cattrs.gen import make_dict_structure_fn

from rans.base.errors import ConfigError, RansError, brief, meant
from rans.base.files import check_depth

T = TypeVar("T")
Range = float | tuple[float, float]
"""A number, or the bounds of a uniform distribution."""
Number = int | float
"""A number of which a whole one stays an integer, which a `float` would not."""


LARGEST_TOML = 2**24
"""Largest number of characters of a TOML text."""
_LARGEST_BESIDE = 2**20
"""Largest number of characters outside strings and comments, each of which takes Python's reader a microsecond."""
_MOST_PARTS = 16
"""Largest number of parts of a dotted key; the time of the reader grows with its square."""
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
    """Whether a dataclass field, with an annotation as text, is a `Range` or an optional `Range`."""
    return str(setting.type) in ("Range", "Range | None")


def read_toml(text: str) -> dict[str, Any]:
    """Table of a TOML text.

    Raises:
        ConfigError: the text is not valid TOML, too long, or nested too deeply.
    """
    _check_effort(text)
    try:
        table = tomllib.loads(text)
        check_depth(table)
        repr(table)  # fails on an integer with too many digits to print
        return table
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"this is not valid TOML: {error}{_slip(text, str(error))}.") from error


def _slip(text: str, error: str) -> str:
    """What is wrong in the line that an error of Python's reader names, as the end of its sentence, or ""."""
    place = re.search(r"at line (\d+)", error)
    line = text.split("\n")[int(place[1]) - 1] if place else ""
    if "Cannot overwrite" in error and (key := re.match(r"\s*([\w-]+)\s*=", line)):
        return f": the key {brief(key[1])} is there twice"
    if declared := re.search(r"Cannot declare \('(\w+)',\) twice", error):
        return f": of several write [[{declared[1]}]] each time"
    if word := re.match(r"\s*([\w-]+)\s*=\s*([A-Za-z][^\[\]{}\"']*?)\s*(#|$)", line):
        return f': texts stand in double quotes, as in {word[1]} = "{word[2]}"'
    if number := re.search(r"=\s*[-+]?(\d{1,15}),(\d{1,15})", line):
        return f": use a point, as in {brief(float(f'{number[1]}.{number[2]}'))}"
    if foreign := re.search("[^\x00-\x7f]", re.sub(_STRINGS, "", line)):
        name = unicodedata.name(foreign[0], "a control character").lower()
        return f": it has a character that looks like another one, {name}; type it anew"
    return ""


_TELLING = {
    "spacecraft": ("dimension", "thruster", "wheel", "actuators"),
    "conditions": ("body", "thrusters", "faults", "disturbances", "sensors", "others"),
    "recipe": ("task", "ppo", "settings", "total_timesteps", "curriculum", "gpu"),
}
"""Keys that only files of one kind have."""


def kind_of_file(table: Mapping[str, Any]) -> str:
    """Kind of a TOML file by its keys, "spacecraft", "conditions" or "recipe"; empty if none or several fit.

    One table [thruster] is that of conditions with a slip, since a spacecraft has [[thruster]] tables.
    """
    keys = set(table)
    if isinstance(table.get("thruster"), Mapping):
        keys = keys - {"thruster"} | {"thrusters"}
    kinds = [kind for kind, telling in _TELLING.items() if not keys.isdisjoint(telling)]
    return kinds[0] if len(kinds) == 1 else ""


def refuse_other_file(table: Mapping[str, Any], expected: str) -> None:
    """Refuse a table of a file of another kind than the expected one; see `kind_of_file`.

    Raises:
        ConfigError: it is of another kind; the message says what each kind of file is for.
    """
    kind = kind_of_file(table)
    if kind not in ("", expected):
        raise ConfigError(
            f"this is a {kind} file by its keys, {', '.join(table)}, and a {expected} file is expected. The usual "
            "cause is that two files are exchanged: --conditions takes conditions, --spacecraft and NAME@FILE take "
            "a spacecraft, and `rans train FILE` takes a recipe."
        )


def _check_effort(text: str) -> None:
    """Reject texts that would keep Python's TOML reader, which has no limits, busy for minutes."""
    if len(text) > LARGEST_TOML:
        raise ConfigError(
            f"a TOML text may have at most {LARGEST_TOML:,} characters, got {len(text):,}."
        )
    rest = _STRINGS.sub("", text)
    if len(rest) > _LARGEST_BESIDE:
        raise ConfigError(
            f"a TOML text may have at most {_LARGEST_BESIDE:,} characters beside its "
            f"strings and comments, got {len(rest):,}."
        )
    dots = _OF_KEYS.sub("", rest)  # a key of n parts leaves n - 1 dots in a row
    if "." * _MOST_PARTS in dots:
        raise ConfigError(f"a dotted key of a TOML text may have at most {_MOST_PARTS} parts.")


def merged(table: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Nested table updated with the entries of another.

    Tables within both are merged; other values, including lists, are replaced.
    """
    result = {**table, **over}
    for name in table.keys() & over.keys():
        if isinstance(table[name], Mapping) and isinstance(over[name], Mapping):
            result[name] = merged(table[name], over[name])
    return result


def structure(table: Any, cls: type[T], where: str, is_written: bool = False) -> T:
    """Dataclass from plain values as `dataclasses.asdict` returns them, without conversions.

    Args:
        table: values.
        cls: class of the result.
        where: name of the table in messages.
        is_written: whether RANS wrote the table, perhaps an earlier version: unknown keys without a value, as of an
            effect that was not used, are left out.

    Raises:
        ConfigError: a key is unknown, or a value is of the wrong type or out of range; the message names its
            position.
    """
    try:
        return _converter(is_written).structure(table, cls)
    except Exception as error:  # cattrs collects the exceptions of all values in groups
        reasons = cattrs.transform_error(error, path=where, format_exception=_say)
        # cattrs appends the position to each reason; put it first, as the subject of what must be.
        sentences = (": ".join(reason.rsplit(" @ ", 1)[::-1]) for reason in reasons)
        raise ConfigError(f"{'; '.join(sentences).replace(': must ', ' must ')}.") from error


@cache
def _converter(is_written: bool) -> cattrs.Converter:
    """The one of every table: it writes a function for each class, which takes longer than any call of it.

    A kind of value that files may have needs its hook here, and its sentence in `_say`.
    """
    converter = cattrs.Converter(forbid_extra_keys=True)
    if is_written:
        converter.register_structure_hook_factory(is_dataclass, _leaving_out)
    converter.register_structure_hook_func(
        lambda kind: isinstance(kind, type) and inspect.isabstract(kind), lambda value, _: value
    )  # converted by the caller, which knows the class
    for kind in (bool, int, float, str):
        converter.register_structure_hook(kind, _strict)
    converter.register_structure_hook_func(
        lambda kind: kind == Number,
        lambda value, _: _strict(value, int if type(value) is int else float),
    )
    converter.register_structure_hook_factory(
        lambda kind: get_origin(kind) is tuple and len({*get_args(kind)} - {...}) == 1,
        _refusing_texts,
    )
    ranges = lambda kind: kind in (Range, Range | None)  # noqa: E731
    converter.register_structure_hook_func(ranges, partial(_range, converter))
    return converter


def _leaving_out(kind: Any, converter: cattrs.Converter) -> Callable[[Any, Any], Any]:
    """Hook of cattrs for a dataclass, whose tables may have unknown keys without a value."""
    usual = make_dict_structure_fn(kind, converter)
    known = {field.name for field in fields(kind)}

    def hook(value: Any, _: Any) -> Any:
        if isinstance(value, Mapping):
            value = {key: x for key, x in value.items() if key in known or x not in _NOTHING}
        return usual(value, kind)

    return hook


_NOTHING: tuple[Any, ...] = (None, "", [], {})
"""Values of keys that say nothing."""


def _refusing_texts(kind: Any, converter: cattrs.Converter) -> Callable[[Any, Any], Any]:
    """Hook of cattrs for a tuple of values of one type, which would take a text for the list of its characters."""
    of = list[get_args(kind)[0]]  # pyrefly: ignore[invalid-annotation]
    size = None if ... in get_args(kind) else len(get_args(kind))
    usual = converter.get_structure_hook(of)
    wanted = "a list, such as [0.5, 4.5]"
    if get_args(kind) == (float,) * 3:
        wanted = "a vector of three numbers, such as [1.0, 0.0, 0.0]"

    def hook(value: Any, _: Any) -> Any:
        """A list of a file as a tuple of ``size`` values of the type, or a `ConfigError`."""
        if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
            quoted = ", with texts and keys in double quotes" * isinstance(value, str)
            raise ConfigError(f"must be {wanted}{quoted}, got {brief(value)}")
        result = tuple(usual(value, of))
        if size not in (None, len(result)):
            raise ConfigError(f"must be a list of {size} values, got {brief(value)}")
        return result

    return hook


def _range(converter: cattrs.Converter, value: Any, kind: Any) -> Any:
    """A number or a pair of numbers of a file; None where the type allows it."""
    if value is None and kind != Range:
        return None
    pair = isinstance(value, list | tuple)
    if len(value) != 2 if pair else type(value) not in (int, float):
        raise ConfigError(
            "must be a number, or the least and the largest of two, such as [0.0, 0.1], got "
            f"{brief(value)}"
        )
    return converter.structure(value, tuple[float, float] if pair else float)


def _strict(value: Any, kind: type) -> Any:
    """Value of exactly this type, without conversion ("64" is not 64, True is not 1), except between 1 and 1.0.

    JSON and TOML write 1 and 1.0 for one number, hence the exception.
    """
    if isinstance(value, np.generic):  # as in a loop over a range of NumPy
        value = value.item()
    if kind is float and type(value) is int:
        return float(value)
    if kind is int and type(value) is float and value.is_integer():
        return int(value)  # 1e6
    if type(value) is not kind:
        raise ConfigError(f"must be {_IN_WORDS[kind]}, got {brief(value)}")
    return value


_IN_WORDS: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text in quotes",
}
"""What users write for a value of a type."""


_OTHERS = {"delay": "latency", "lag": "latency", "dead_time": "latency", "thrust": "force"}
"""Keys of tables by their names elsewhere."""


def _deeper(kind: Any, key: str) -> str:
    """Suggestion of the table of this class in which there is such a key; else an empty text."""
    key = _OTHERS.get(key, key)
    hints = get_type_hints(kind) if is_dataclass(kind) else {}
    for table, inner in hints.items():
        if is_dataclass(inner) and key in {field.name for field in fields(inner)}:
            return f" (did you mean {key} in [{table}]?)"
    return ""


def _say(error: BaseException, kind: Any) -> str:
    """Sentence for one error that cattrs found, without the path of its key."""
    if isinstance(error, RansError):
        return str(error).rstrip(".")
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        names = [field.name for field in fields(error.cl)] if is_dataclass(error.cl) else []
        keys = (
            brief(key) + (meant(key, names) or _deeper(error.cl, key))
            for key in sorted(error.extra_fields)
        )
        return f"unknown key {', '.join(keys)}" + (f"; keys are {', '.join(names)}" * bool(names))
    if isinstance(error, KeyError):
        return f"the key {error} is missing"
    if isinstance(error, AttributeError):  # cattrs reads the keys of any value
        return 'must be a table, such as {"key": value}'
    if isinstance(error, TypeError):
        return f"must be {'a table' if is_dataclass(kind) else 'a list, such as [0.5, 4.5]'}"
    if get_origin(kind) is Literal:
        value, _, _ = str(error).partition(" not in ")  # "gelu not in literal ..."
        return f"must be {' or '.join(map(repr, get_args(kind)))}, got {brief(value)}"
    return str(error)
