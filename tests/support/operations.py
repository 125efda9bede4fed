"""Operations of traced programs in a language, against NumPy's."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rans.model.operations import OPERATIONS, Dialect, Kind

Key = tuple[str, Kind]
Run = Callable[[Dialect, Mapping[Key, list[np.ndarray]], Path], dict[Key, Any]]
"""Runs the operations of a dialect on columns of operands."""
COUNT = 64
DOMAINS = {"log": (0.01, 4.0), "sqrt": (0.0, 4.0), "log1p": (0.0, 40.0)}
"""Numbers that have a real result."""
KEYS: list[Key] = [
    (name, kind) for name, operation in OPERATIONS.items() for kind in operation.kinds
]


def columns(key: Key, real: type) -> list[np.ndarray]:
    """Operands of every kind of size: reals with zeros of both signs, all bits of whole numbers, truth values."""
    name, kind = key
    arity = OPERATIONS[name].arity
    random = np.random.default_rng(sum(map(ord, name)))
    low, high = DOMAINS.get(name, (-4.0, 4.0))
    result: list[np.ndarray] = []
    for _ in range(arity):
        if kind == "bool":
            result.append(random.random(COUNT) < 0.5)
        elif kind == "int":
            wild = random.integers(-(2**31) + 1, 2**31 - 1, COUNT)
            result.append(np.where(random.random(COUNT) < 0.5, wild, wild % 7 - 3).astype(np.int32))
        else:
            x = random.uniform(low, high, COUNT)
            if low < 0.0:
                x[:8] = 0.0, -0.0, 0.5, -0.5, 1.5, -2.5, 0.0, -0.0
            result.append(random.permutation(x).astype(np.float32).astype(real))
    if name == "where":
        result[0] = random.random(COUNT) < 0.5
    if name == ">>":
        result[1] = random.integers(0, 32, COUNT).astype(np.int32)
    if name == "clip":
        result[1:] = np.sort(result[1:], axis=0)
    return result


def result_kind(key: Key) -> Kind:
    name, kind = key
    return OPERATIONS[name].result or kind


def check(language: str, dialect: Dialect, run: Run, real: type, folder: Path) -> None:
    """Compare every operation that a language has with NumPy's function of it, on the same operands."""
    given = {key: columns(key, real) for key in KEYS if key in dialect}
    with np.errstate(all="ignore"):
        found = run(dialect, given, folder)
        for key, arrays in given.items():
            operation = OPERATIONS[key[0]]
            expected = np.asarray(operation.meaning(*arrays))
            if result_kind(key) == "real":
                expected = expected.astype(real)
            ours = np.asarray(found[key], dtype=expected.dtype)
            # Exact operations have one result in a precision. Functions have a few units in its last place, and
            # those of CUDA, which are for speed, a few more.
            tolerance = 0.0 if operation.is_exact else (2e-6 if real is np.float32 else 1e-14)
            np.testing.assert_allclose(
                ours, expected, rtol=tolerance, atol=tolerance, err_msg=f"{key} in {language}"
            )


def compiled(
    compiler: list[str],
    beginning: str,
    dialect: Dialect,
    given: Mapping[Key, list[np.ndarray]],
    folder: Path,
) -> dict[Key, Any]:
    """One function an operation, by the machine's compiler."""
    if shutil.which(compiler[0]) is None:
        pytest.skip(f"needs {compiler[0]}")
    types = {"float32": "real", "float64": "real", "int32": "int", "bool": "int"}
    text, _, ending = beginning.partition("OPERATIONS")
    for number, (key, arrays) in enumerate(given.items()):
        arguments = [f"{types[str(x.dtype)]} x{k}" for k, x in enumerate(arrays)]
        body = dialect.text(*key, *(f"x{k}" for k in range(len(arrays))))
        out = "int" if result_kind(key) != "real" else "real"
        text += f"{out} f{number}({', '.join(arguments)}) {{ return {body}; }}\n"
    source = folder / "operations.c"
    source.write_text(f"{text}{ending}", "utf-8")
    built = folder / "operations.so"
    # Without contraction, as every operation stands alone.
    flags = ["-O1", "-shared", "-fPIC", "-ffp-contract=off"]
    subprocess.run([*compiler, *flags, str(source), "-o", str(built), "-lm"], check=True)
    library = ctypes.CDLL(str(built))
    found = {}
    for number, (key, arrays) in enumerate(given.items()):
        function = library[f"f{number}"]
        function.argtypes = [
            ctypes.c_float if x.dtype.kind == "f" else ctypes.c_int for x in arrays
        ]
        function.restype = ctypes.c_float if result_kind(key) == "real" else ctypes.c_int
        rows = zip(*(x.tolist() for x in arrays), strict=True)
        found[key] = [function(*row) for row in rows]
    return found
