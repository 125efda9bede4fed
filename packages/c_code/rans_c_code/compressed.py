"""Tables of few distinct numbers, and of whole steps: what makes an exported agent's tables small."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Packed(NamedTuple):
    """A table of few distinct numbers: the numbers of each block of rows once, and which of them every entry is.

    Networks that obey the symmetries of a square or a cube have few: every block of their rows has the same numbers
    in another order, and all blocks may have the same order.
    """

    rows: int
    """Number of rows in a block."""
    values: np.ndarray
    """(blocks, P) distinct numbers, in the order in which they come first."""
    indices: np.ndarray
    """(rows, columns) of every block, or of all rows where blocks differ."""

    @classmethod
    def of(cls, table: np.ndarray) -> Packed | None:
        """The smallest way to store a float32 table (rows, columns) without changing a bit; None: as it is."""
        count = len(table)
        best = None
        least = 4 * table.size // 2
        for rows in (n for n in range(1, count + 1) if count % n == 0):
            packed = cls._in_blocks(table, rows)
            if packed is not None and packed.bytes < least:
                best, least = packed, packed.bytes
        return best

    @classmethod
    def _in_blocks(cls, table: np.ndarray, rows: int) -> Packed | None:
        """The table in blocks of so many rows; None: they have more numbers than a byte can count.

        Bit for bit: numbers are compared as whole numbers, since -0.0 equals 0.0 and NaN nothing.
        """
        blocks = []
        # Numbers that differ in a bit are two.
        for block in table.view(np.int32).reshape(len(table) // rows, -1):
            _, first, inverse = np.unique(block, return_index=True, return_inverse=True)
            if len(first) > 256:
                return None
            order = np.argsort(first)
            rank = np.empty(len(order), dtype=np.uint8)
            rank[order] = np.arange(len(order))
            blocks.append((block[first[order]].view(np.float32), rank[inverse.ravel()]))
        longest = max(len(values) for values, _ in blocks)
        values = np.array([np.pad(own, (0, longest - len(own))) for own, _ in blocks])
        indices = np.array([index for _, index in blocks])
        if (indices == indices[0]).all():
            indices = indices[:1]
        return cls(rows, values, indices.reshape(-1, table.shape[1]))

    @property
    def bytes(self) -> int:
        """Size of what is stored."""
        return self.values.nbytes + len(self.stored)

    @property
    def is_bits(self) -> bool:
        """Whether an entry is one bit."""
        return self.values.shape[1] <= 2

    @property
    def stored(self) -> np.ndarray:
        """Bytes of the index; eight entries in a byte, the lowest first, where there are two numbers."""
        flat = self.indices.ravel()
        return np.packbits(flat, bitorder="little") if self.is_bits else flat

    def entry(self, name: str, row: str, column: str, width: int) -> str:
        """Entry of a row and a column, all three as C text; ``width`` columns make a row.

        ``row`` is pasted as it is, so that it must be a number or a name.
        """
        blocks, longest = self.values.shape
        own = row if blocks == 1 or len(self.indices) > self.rows else f"{row} % {self.rows}"
        at = f"{own} * {width} + {column}" if width > 1 else own
        which = f"{name}_index[{at}]"
        if self.is_bits:
            which = f"(({name}_index[({at}) / 8] >> (({at}) % 8)) & 1)"
        start = "" if blocks == 1 else f"{row} / {self.rows} * {longest} + "
        return f"{name}[{start}{which}]"


_STEPS = 127
"""Largest number of steps of a row of weights: what a byte counts with a sign."""


class Stepped(NamedTuple):
    """A table whose rows are whole steps of their own size, as `in_steps` makes them: a byte an entry."""

    values: np.ndarray
    """(rows,) size of a step, float32."""
    indices: np.ndarray
    """(rows, columns) int8."""

    @classmethod
    def of(cls, table: np.ndarray) -> Stepped | None:
        """Rows of a float32 table as whole steps of a size of their own, bit-exact; None: some row is not.

        The product of count and step must be the entry itself, since exported commands equal those of the agent.
        """
        largest = np.abs(table).max(axis=1)
        guess = np.where(largest > 0.0, largest / np.float32(_STEPS), np.float32(1.0))
        size = guess.copy()
        is_found = np.zeros(len(table), dtype=bool)
        # The largest entry is rounded too: a step is the quotient, or a float beside it.
        for direction in (0.0, -np.inf, np.inf):
            tried = guess if direction == 0.0 else np.nextafter(guess, np.float32(direction))
            counts = np.rint(table / tried[:, None])
            fits = (counts * tried[:, None] == table).all(axis=1) & ~is_found
            size[fits] = tried[fits]
            is_found |= fits
        if not is_found.all():
            return None
        return cls(size, np.rint(table / size[:, None]).astype(np.int8))

    @property
    def stored(self) -> np.ndarray:
        """Bytes of the counts."""
        return self.indices.ravel()

    @property
    def bytes(self) -> int:
        """Size of what is stored."""
        return self.values.nbytes + len(self.stored)

    def entry(self, name: str, row: str, column: str, width: int) -> str:
        """Entry of a row and a column, in C."""
        return f"({name}[{row}] * {name}_index[({row}) * {width} + {column}])"


def in_steps(table: np.ndarray) -> np.ndarray:
    """A float32 table (rows, columns) rounded to whole steps, of which the largest entry of a row has all."""
    size = np.abs(table).max(axis=1, keepdims=True) / np.float32(_STEPS)
    size = np.where(size > 0.0, size, np.float32(1.0))
    return np.rint(table / size) * size


def smallest(table: np.ndarray) -> Packed | Stepped | None:
    """The smallest way to store a float32 table (rows, columns) without loss; None: as it is."""
    ways = [way for way in (Packed.of(table), Stepped.of(table)) if way is not None]
    best = min(ways, key=lambda way: way.bytes, default=None)
    return best if best is not None and best.bytes < table.nbytes // 2 else None
