"""Every operation of traced programs as machine code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rans_machine_code.dialect import LLVM
from rans_machine_code.llvm import LANES, MachineModule
from rans_machine_code.program_code import write_function

from rans.model.operations import Dialect, Kind
from rans.model.trace import Symbol
from tests.support.operations import COUNT, Key, check

KINDS: dict[str, Kind] = {"float32": "real", "int32": "int", "bool": "bool"}


def of_llvm(
    dialect: Dialect, given: Mapping[Key, list[np.ndarray]], folder: Path
) -> dict[Key, Any]:
    """By machine code, in the memory that a program has: a row of 32 bits a number, bytes for truth values."""
    program = MachineModule()
    memories = {}
    for number, (key, arrays) in enumerate(given.items()):
        inputs = [Symbol.input(f"operand_{k}", KINDS[str(x.dtype)]) for k, x in enumerate(arrays)]
        symbol = Symbol.apply(key[0], *inputs)
        # An operation that commutes may have its operands in another order.
        rows = {operand: row for row, operand in enumerate(inputs)} | {symbol: len(inputs)}
        memory = np.zeros((len(rows), COUNT), np.int32)
        for row, x in zip(memory, arrays, strict=False):
            row.view(x.dtype)[:COUNT] = x
        write_function(program, f"f{number}", [symbol], rows, {symbol})
        memories[key] = memory, {"real": np.float32, "int": np.int32, "bool": np.bool_}[symbol.kind]
    found = {}
    for number, (key, (memory, dtype)) in enumerate(memories.items()):
        program.compiled(f"f{number}")(memory.ctypes.data, COUNT, COUNT // LANES)
        found[key] = memory[-1].view(dtype)[:COUNT]
    return found


def test_an_operation_is_the_same_as_machine_code(tmp_path: Path) -> None:
    check("LLVM", LLVM, of_llvm, np.float32, tmp_path)
