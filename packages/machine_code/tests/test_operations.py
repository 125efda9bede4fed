"""Every operation of traced programs as machine code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_machine_code.llvm import LLVM
from rans_machine_code.program import CompiledProgram

from rans.model.operations import Dialect, Kind
from rans.model.trace import Symbol
from tests.support.operations import COUNT, Key, check

KINDS: dict[str, Kind] = {"float32": "real", "int32": "int", "bool": "bool"}


def of_llvm(
    dialect: Dialect, given: Mapping[Key, list[np.ndarray]], folder: Path
) -> dict[Key, Any]:
    found = {}
    for key, arrays in given.items():
        inputs = [Symbol.input(f"operand_{k}", KINDS[str(x.dtype)]) for k, x in enumerate(arrays)]
        memory = CompiledProgram(inputs, [Symbol.apply(key[0], *inputs)]).memory(COUNT)
        memory.give(arrays)
        found[key] = memory.run(0)[0]
    return found


def test_an_operation_is_the_same_as_machine_code(tmp_path: Path) -> None:
    check("LLVM", LLVM, of_llvm, np.float32, tmp_path)


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "log"])
def test_functions_are_numpys_far_from_zero(name: str) -> None:
    """Headings of craft that turn, and logarithms of the smallest draws; what is no number stays so."""
    x = {
        "sin": np.linspace(-1e3, 1e3, COUNT),
        "cos": np.linspace(-1e3, 1e3, COUNT),
        "exp": np.linspace(-80, 80, COUNT),
        "log": np.geomspace(1e-30, 1e30, COUNT),
    }[name].astype(np.float32)
    x[0] = np.nan
    a = Symbol.input("a")
    memory = CompiledProgram([a], [Symbol.apply(name, a)]).memory(COUNT)
    memory.give([x])
    expected = getattr(np, name)(x.astype(np.float64))
    np.testing.assert_allclose(memory.run(0)[0], expected, rtol=1e-6, atol=2e-7)
