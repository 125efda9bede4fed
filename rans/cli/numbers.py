"""Numbers on the command line, whose error messages are sentences."""

from __future__ import annotations

from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from rans.errors import brief

_KINDS: dict[type, str] = {int: "a whole number", float: "a number"}


def registry() -> ConstructorRegistry:
    """Constructors of tyro for options of the types int and float, optional or not, and tuples of int."""
    made = ConstructorRegistry()
    made.primitive_rule(_many)
    made.primitive_rule(_one)
    return made


def _one(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    if get_origin(info.type) not in (None, Union, UnionType):
        return None
    types = set(get_args(info.type)) or {info.type}
    kind = next((kind for kind in _KINDS if types - {NoneType} == {kind}), None)
    if kind is None:
        return None
    name = kind.__name__.upper()
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=name,
        instance_from_str=lambda words: (
            None if words == ["None"] and NoneType in types else _read(kind, words[0])
        ),
        is_instance=lambda x: isinstance(x, (int, float, *types)),
        str_from_instance=lambda x: [str(x)],
    )


def _many(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    if info.type != tuple[int, ...]:
        return None
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar="[INT [INT ...]]",
        is_instance=lambda x: isinstance(x, tuple),
        instance_from_str=lambda words: tuple(_read(int, word) for word in words),
        str_from_instance=lambda x: [str(one) for one in x],
    )


def _read(kind: type, word: str) -> Any:
    try:
        return kind(word)
    except ValueError:
        raise ValueError(f"it must be {_KINDS[kind]}, got {brief(word)}.") from None
