"""Every operation of traced programs computes the same in every language that programs are printed in."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rans.model import operations
from rans.model.operations import NUMBERS, OPERATIONS, ROWS, Dialect, of_row
from rans.policy.program import RowStep
from tests.support.operations import COUNT, Key, Run, check, columns


def of_javascript(
    dialect: Dialect, given: Mapping[Key, list[np.ndarray]], folder: Path
) -> dict[Key, Any]:
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs Node.js")
    lines = []
    for key, arrays in given.items():
        names = [f"x{k}" for k in range(len(arrays))]
        rows = json.dumps([list(row) for row in zip(*(x.tolist() for x in arrays), strict=True)])
        lines.append(f"{rows}.map(([{', '.join(names)}]) => {dialect.text(*key, *names)})")
    # JSON has no numbers that are not finite.
    script = f"console.log(JSON.stringify([{', '.join(lines)}], (_, x) => typeof x === 'number' ? String(x) : x))"
    file = folder / "operations.js"
    file.write_text(script, "utf-8")
    done = subprocess.run([node, str(file)], check=True, capture_output=True, text=True)
    answers = json.loads(done.stdout)
    return {
        key: [float(x) if isinstance(x, str) else x for x in row]
        for key, row in zip(given, answers, strict=True)
    }


def of_numpy(
    dialect: Dialect, given: Mapping[Key, list[np.ndarray]], folder: Path
) -> dict[Key, Any]:
    return {
        key: eval(
            dialect.text(*key, *(f"x{k}" for k in range(len(arrays)))),
            {"np": np, **{f"x{k}": x for k, x in enumerate(arrays)}},
        )
        for key, arrays in given.items()
    }


def of_python(
    dialect: Dialect, given: Mapping[Key, list[np.ndarray]], folder: Path
) -> dict[Key, Any]:
    found = {}
    for key, arrays in given.items():
        names = [f"x{k}" for k in range(len(arrays))]
        scope = {**NUMBERS, "over": NUMBERS["/"]}
        function = eval(f"lambda {', '.join(names)}: {dialect.text(*key, *names)}", scope)
        found[key] = [function(*row) for row in zip(*(x.tolist() for x in arrays), strict=True)]
    return found


LANGUAGES: dict[str, tuple[Dialect, Run, type]] = {
    "JavaScript": (operations.JAVASCRIPT, of_javascript, np.float64),
    "NumPy": (operations.NUMPY, of_numpy, np.float64),
    "Python": (operations.PYTHON, of_python, np.float64),
}


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_operation_is_the_same_in_every_language(language, tmp_path):
    check(language, *LANGUAGES[language], tmp_path)


def test_rows_mean_what_onnx_says():
    """The meaning of every operation of rows, by ONNX's own reference."""
    onnx = pytest.importorskip("onnx")
    from onnx.reference import ReferenceEvaluator

    types = {"float32": onnx.TensorProto.FLOAT, "bool": onnx.TensorProto.BOOL}
    for name in ROWS:
        key = of_row(name)
        arrays = columns(key, np.float32)
        if name == "Clip":  # of ONNX, bounds are single numbers
            arrays = [arrays[0], np.float32(-1.0).reshape(()), np.float32(2.0).reshape(())]
        names = [f"x{k}" for k in range(len(arrays))]
        to = {"to": onnx.TensorProto.FLOAT} if name == "Cast" else {}
        node = onnx.helper.make_node(name, names, ["y"], **to)
        inputs = [
            onnx.helper.make_tensor_value_info(given, types[str(x.dtype)], list(x.shape))
            for given, x in zip(names, arrays, strict=True)
        ]
        out = onnx.helper.make_tensor_value_info(
            "y", types["bool" if RowStep(name, (), ()).is_truth else "float32"], [COUNT]
        )
        graph = onnx.helper.make_graph([node], "one", inputs, [out])
        with np.errstate(all="ignore"):
            evaluator: Any = ReferenceEvaluator(onnx.helper.make_model(graph))
            (answer,) = evaluator.run(None, dict(zip(names, arrays, strict=True)))
            meant = OPERATIONS[key[0]].meaning(*arrays)
        np.testing.assert_allclose(answer, meant, rtol=2e-6, atol=1e-6, err_msg=name)
        assert (answer.dtype == np.bool_) == RowStep(name, (), ()).is_truth


def test_exports_have_every_operation_of_rows():
    assert not [name for name in ROWS if of_row(name) not in operations.NUMPY]


OWN_TABLES = {
    "rans/model/operations.py",
    "rans/model/trace.py",  # Python's methods of operators
    "packages/c_code/rans_c_code/text.py",
    "packages/machine_code/rans_machine_code/cuda/source.py",
    "packages/machine_code/rans_machine_code/llvm.py",
    "packages/machine_code/rans_machine_code/loss_gradient.py",  # derivatives
    "rans/policy/scalars.py",  # functions of fields of any library, with gradients
}
ROOT = Path(__file__).parents[2]


def tables(text: str) -> list[int]:
    """Lines with a dictionary or a set that lists many operations."""
    names = {*OPERATIONS, *ROWS}
    # Reading syntax takes ten times as long.
    if sum(f'"{name}"' in text or f"'{name}'" in text for name in names) < 8:
        return []
    return [
        node.lineno
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Dict | ast.Set)
        and sum(
            isinstance(key, ast.Constant) and key.value in names
            for key in (node.keys if isinstance(node, ast.Dict) else node.elts)
        )
        >= 8
    ]


def test_operations_have_one_table():
    found = [
        f"{file.relative_to(ROOT)}:{line}"
        for room in ("rans", "packages")
        for file in sorted((ROOT / room).rglob("*.py"))
        if "tests" not in file.relative_to(ROOT).parts
        if str(file.relative_to(ROOT)) not in OWN_TABLES
        for line in tables(file.read_text("utf-8"))
    ]
    assert not found, f"these list operations that rans/model/operations.py knows: {found}"
