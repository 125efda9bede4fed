"""Operations of traced programs in a language, against NumPy's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

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
