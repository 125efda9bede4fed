"""Numbers, tables and names of values as C has them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np


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
