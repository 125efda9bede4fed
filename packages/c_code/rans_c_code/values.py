"""Values of a program as C has them: numbers, literals, arrays, and tables, which may be packed."""

from __future__ import annotations

import math
from typing import NamedTuple

from rans_c_code.compressed import Packed, Stepped

Shape = tuple[int, ...]


class Value(NamedTuple):
    """A value of one spacecraft as C has it: a number, a literal or an array."""

    text: str
    shape: Shape
    kind: str = "float"
    """"float" or "int"."""
    packed: Packed | Stepped | None = None
    """How a table is stored whose entries repeat, or are whole steps."""

    def entry(self, row: str, column: str) -> str:
        """C text of its entry in a row and column; ``row`` is a number or a name, ``column`` any expression."""
        width = math.prod(self.shape[1:])
        if self.packed is not None:
            return self.packed.entry(self.text, row, column, width)
        if width == 1:
            return f"{self.text}[{row}]"
        # Rows of known number are counted here.
        start = str(int(row) * width) if row.isdigit() else f"{row} * {width}"
        return f"{self.text}[{start} + {column}]"

    @property
    def size(self) -> int:
        """Number of its entries."""
        return math.prod(self.shape)

    @property
    def is_array(self) -> bool:
        """Whether it has several entries."""
        return self.size > 1

    def at(self, index: str, shape: Shape) -> str:
        """Its entry for the flat index of a value of a shape that it is broadcast to."""
        if not self.is_array:
            return self.text
        own = (1,) * (len(shape) - len(self.shape)) + self.shape
        if own == shape or math.prod(own) == math.prod(shape):
            return f"{self.text}[{index}]"
        # One term an axis along which it is not repeated.
        terms = []
        inner = 1
        stride = 1
        for axis in range(len(shape) - 1, -1, -1):
            if own[axis] > 1:
                position = index if inner == 1 else f"({index} / {inner})"
                position = f"{position} % {shape[axis]}"
                terms.append(position if stride == 1 else f"{position} * {stride}")
                stride *= own[axis]
            inner *= shape[axis]
        return f"{self.text}[{' + '.join(reversed(terms))}]"
