"""Numbers on the command line, whose error messages are sentences."""

from __future__ import annotations

import contextlib
import decimal
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from rans.base.errors import brief

_KINDS: dict[type, str] = {int: "a whole number", float: "a number"}


def registry() -> ConstructorRegistry:
    """Constructors of tyro for options of the types int and float, optional or not."""
    constructors = ConstructorRegistry()
    constructors.primitive_rule(_number)
    return constructors


def _number(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    """How tyro reads a number, an int or a float that may be None; None for other types."""
    if get_origin(info.type) not in (None, Union, UnionType):
        return None
    types = set(get_args(info.type)) or {info.type}
    kind = next((kind for kind in _KINDS if types - {NoneType} == {kind}), None)
    if kind is None:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=kind.__name__.upper(),
        instance_from_str=lambda words: (
            None if words == ["None"] and NoneType in types else _read(kind, words[0])
        ),
        is_instance=lambda x: isinstance(x, (int, float, *types)),
        str_from_instance=lambda x: [str(x)],
    )


_COUNTS = " A count is written as 1000000, 1e6 or 1M."
_MULTIPLES = {"k": 10**3, "K": 10**3, "M": 10**6, "G": 10**9, "B": 10**9}
"""Letters behind a whole number, as in 200k or 1.5M."""


def whole_number(word: str) -> int:
    """A whole number as people write it: 1000000, 1_000_000, 1e6 or 1M.

    Raises:
        ValueError: it is none.
    """
    with contextlib.suppress(ValueError):
        return int(word)
    factor = _MULTIPLES.get(word[-1:], 1)
    # Decimal, because 0.3e1 is not whole as a binary fraction; no number of counts has more than 18 digits.
    value = decimal.Decimal(word if factor == 1 else word[:-1]) * factor
    if not value.is_finite() or value.adjusted() > 18 or value != value.to_integral_value():
        raise ValueError
    return int(value)


def _read(kind: type, word: str) -> Any:
    """A number of a word; the error is a sentence with what was probably meant."""
    if kind is int:
        with contextlib.suppress(ValueError, decimal.InvalidOperation):
            return whole_number(word)
    try:
        return kind(word)
    except ValueError:
        advice = _COUNTS if kind is int else ""
        if kind is float and word.endswith("%"):
            with contextlib.suppress(ValueError):
                advice = f" Did you mean {float(word[:-1]) / 100.0:g}?"
        raise ValueError(f"it must be {_KINDS[kind]}, got {brief(word)}.{advice}") from None
