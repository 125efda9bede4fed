"""Memory of an exported agent's intermediate arrays, which share one array on the stack."""

from __future__ import annotations

from collections.abc import Set

from rans.extend import Program
from rans_c_code.text import variable

_VIEWS = {"Split", "Reshape"}
"""Operations whose results may be parts of their first operand's memory."""


class Scratch:
    """Places of arrays of floats in a single one, which others take when an array is not used any more."""

    def __init__(self) -> None:
        self.size = 0
        self._taken: dict[str, tuple[int, int]] = {}

    def taken(self, name: str, size: int) -> int:
        """First index of a new array of ``size`` numbers, the lowest with room; remembers it and the total.

        The caller frees an array when its last reader is printed: sooner, and a later array overwrites it.
        """
        start = 0
        for first, end in sorted(self._taken.values()):
            if start + size <= first:
                break
            start = max(start, end)
        self._taken[name] = start, start + size
        self.size = max(self.size, start + size)
        return start

    def free(self, names: Set[str]) -> None:
        """Give back the places of arrays."""
        for name in names & self._taken.keys():
            del self._taken[name]


def last_uses(program: Program, delayed: frozenset[str]) -> dict[str, int]:
    """Number of the last step that uses each variable, also as a part or in another shape.

    Values of ``delayed`` names are computed where they are used, from their first operand.
    """
    own: dict[str, str] = {}
    last = {}
    for number, step in enumerate(program.steps):
        used = [own.get(name, name) for name in step.inputs]
        last |= dict.fromkeys(used, number)
        is_view = step.operation in _VIEWS or step.outputs[0] in delayed
        own |= {name: used[0] if is_view else name for name in step.outputs}
    # What the function returns.
    last |= {own.get(name, name): len(program.steps) for name in ("command", "memory_out")}
    return {variable(name): number for name, number in last.items()}
