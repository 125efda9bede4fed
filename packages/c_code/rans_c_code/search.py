"""Searches for the largest of linear functions in a program, which C computes without an array of their values."""

from __future__ import annotations

from typing import NamedTuple

from rans.extend import Program, RowStep


class Searches(NamedTuple):
    """Searches for the largest of linear functions, which need no memory for all of their values."""

    whole: dict[str, tuple[RowStep, str]]
    """By the name of the largest one's number: product of the row and the slopes, and name of the offsets."""
    parts: frozenset[str]
    """Names of the values that are computed one by one."""


def searches(program: Program) -> Searches:
    """Searches of a program: the largest of a row times a table plus a table.

    Only where nothing else reads the products, since these are then never stored.
    """
    made = {name: step for step in program.steps for name in step.outputs}
    uses = [name for step in program.steps for name in step.inputs]
    whole = {}
    parts = set()
    for step in program.steps:
        total = made.get(step.inputs[0]) if step.operation == "ArgMax" else None
        if total is None or total.operation != "Add":
            continue
        product = made.get(total.inputs[0])
        offset = total.inputs[1]
        if product is None or product.operation != "MatMul" or offset not in program.constants:
            continue
        inner = [product.outputs[0], total.outputs[0]]
        tables = program.constants.get(product.inputs[1]), program.constants[offset]
        is_plain = tables[0] is not None and tables[0].shape[1:] == tables[1].shape
        if is_plain and all(uses.count(name) == 1 for name in inner):
            whole[step.outputs[0]] = product, offset
            parts.update(inner)
    return Searches(whole, frozenset(parts))
