"""Every operation of traced programs as machine code."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rans_machine_code.cuda.source import CUDA
from rans_machine_code.llvm import LLVM
from rans_machine_code.program import CompiledProgram

from rans.model.operations import Dialect, Kind
from rans.model.trace import Symbol
from tests.support.operations import COUNT, Key, check, compiled

SHIMS = """#include <cmath>
#include <cstring>
#include <algorithm>
using std::abs; using std::max; using std::min; using std::floor; using std::sqrt; using std::tanh;
using std::atan2; using std::log1p;
#define __device__
#define __expf std::exp
#define __logf std::log
static inline int __float_as_int(float x) { int bits; memcpy(&bits, &x, 4); return bits; }
typedef float real;
"""
"""What CUDA C++ has and C++ has not, for the functions of our kernels on a CPU."""


def of_cuda(
    dialect: Dialect, given: Mapping[Key, list[np.ndarray]], folder: Path
) -> dict[Key, Any]:
    functions = files("rans_machine_code.cuda").joinpath("functions.cuh").read_text("utf-8")
    beginning = f'{SHIMS}{functions}\nextern "C" {{ OPERATIONS }}'
    return compiled(["c++"], beginning, dialect, given, folder)


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


@pytest.mark.parametrize(
    ("language", "dialect", "run"), [("CUDA", CUDA, of_cuda), ("LLVM", LLVM, of_llvm)]
)
def test_an_operation_is_the_same_as_machine_code(language, dialect, run, tmp_path):
    check(language, dialect, run, np.float32, tmp_path)


def of_one(name: str, *arrays: np.ndarray) -> np.ndarray:
    return of_llvm(LLVM, {(name, "real"): [*arrays]}, Path())[name, "real"]


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "log", "log1p"])
def test_functions_are_numpys_far_from_zero(name):
    """Phases of long flights, and logarithms of the smallest draws; what is no number stays so."""
    x = {
        "sin": np.linspace(-1e6, 1e6, COUNT),
        "cos": np.linspace(-1e6, 1e6, COUNT),
        "exp": np.linspace(-80, 80, COUNT),
        "log": np.geomspace(1e-30, 1e30, COUNT),
        "log1p": np.linspace(-0.99, 2.0, COUNT),
    }[name].astype(np.float32)
    x[0] = np.nan
    expected = getattr(np, name)(x.astype(np.float64))
    np.testing.assert_allclose(of_one(name, x), expected, rtol=1e-6, atol=2e-7)


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_angles_without_digits_have_some_sine(name):
    """The sine of a large angle, as of a flight that failed long ago, is a number from -1 to 1, as NumPy's is."""
    x = np.geomspace(1e6, 1e38, COUNT, dtype=np.float32)
    assert (np.abs(of_one(name, x)) <= 1.0).all()


def test_an_angle_of_no_number_is_none():
    a, nothing = np.ones(COUNT, np.float32), np.full(COUNT, np.nan, np.float32)
    for y, x in ((a, nothing), (nothing, a)):
        assert np.isnan(of_one("atan2", y, x)).all()


def test_constant_zeros_keep_their_signs():
    a = Symbol.input("a")
    for zero in (0.0, -0.0):
        memory = CompiledProgram([a], [Symbol.apply("atan2", zero, a)]).memory(1)
        memory.give([-1.0])
        np.testing.assert_allclose(memory.run(0)[0], np.arctan2(zero, -1.0), rtol=1e-6)
