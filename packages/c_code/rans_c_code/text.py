"""Operations, numbers, tables and names of values as C has them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from rans.base.languages import Code
from rans.extend import Dialect


class C(Code):
    """C99, and the preprocessor, which also reads trigraphs."""

    __slots__ = ()
    meaningful = re.compile(r'\*/|/\*|\\|\?\?|"')


DIALECT = Dialect(
    "C",
    "{0} {sign} {1}",
    "{name}f",
    ("real", "bool"),
    ("!=", "real"),
    {
        "neg": "-{0}",
        "==": "{0} >= {1} && {0} <= {1}",  # flight software forbids == of floats (-Wfloat-equal)
        "where": "{0} ? {1} : {2}",
        "maximum": "fmaxf({0}, {1})",
        "minimum": "fminf({0}, {1})",
        "abs": "fabsf({0})",
        "clip": "fminf(fmaxf({0}, {1}), {2})",
        "cast": "(float){0}",
        "identity": "{0}",
        "round": "rintf({0})",
        "relu": "fmaxf({0}, 0.0F)",
        "sigmoid": "0.5F + 0.5F * tanhf(0.5F * {0})",
        "elu": "{0} > 0.0F ? {0} : expm1f(fminf({0}, 0.0F))",
    },
    bools={"&": "{0} && {1}", "|": "{0} || {1}"},
)
"""C99 in single precision, as agent.c has it; a truth value is an int."""


def literal(value: float) -> str:
    """A literal of single precision."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"
    text = f"{np.float32(value):.9g}"
    return f"{text if re.search(r'[.e]', text) else text + '.0'}F"


def rows_of(numbers: Sequence[str]) -> str:
    """Entries of an array, eight a line."""
    lines = [", ".join(numbers[at : at + 8]) for at in range(0, len(numbers), 8)]
    return ",\n    ".join(lines)


def variable(name: str) -> str:
    """Name in C of a value of the program."""
    return "v_" + re.sub(r"\W", "_", name)


def table_name(name: str) -> str:
    """Name in C of a constant table."""
    return "t_" + re.sub(r"\W", "_", name)
