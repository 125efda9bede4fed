"""Graphs of ONNX of two states and two commands, ordinary and forged, for readers of networks."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

WEIGHT = np.array([[-0.5, 0.25], [1.5, -2.0]], dtype=np.float32)
"""Not symmetric, so that its transpose is another network."""
SHIFT = np.array([0.3, -0.7], dtype=np.float32)

Node = tuple[str, list[str], list[str], dict[str, Any]]
"""Operation, inputs, outputs and attributes."""


def step(kind: str, inputs: str, output: str, **attributes: Any) -> Node:
    """A node, whose inputs and outputs are separated by blanks; a dash stands for one that is left out."""
    taken, given = (
        ["" if name == "-" else name for name in names.split()] for names in (inputs, output)
    )
    return kind, taken, given, attributes


def steps(text: str) -> list[Node]:
    """Nodes of assignments in Python's form, such as "m = MatMul(x, W); y = Gemm(m, W, None, beta=2.0)"."""
    nodes = []
    for line in ast.parse(text).body:
        assert isinstance(line, ast.Assign)
        call = line.value
        assert isinstance(call, ast.Call)
        taken = " ".join("-" if ast.unparse(x) == "None" else ast.unparse(x) for x in call.args)
        settings = {one.arg or "": ast.literal_eval(one.value) for one in call.keywords}
        given = ast.unparse(line.targets[0])
        nodes.append(step(ast.unparse(call.func), taken, given, **settings))
    return nodes


def model_of(
    nodes: str | Sequence[Node],
    inputs: Mapping[str, Sequence[Any] | None],
    outputs: Mapping[str, Sequence[Any] | None],
    opset: int = 17,
    precision: Any = np.float32,
    change: Callable[[Any], None] = lambda model: None,
    **tables: Any,
) -> bytes:
    """Content of a file with these nodes, shapes of inputs and outputs by name, and of tables those that are used.

    Nodes may be a text for `steps`.

    Args:
        change: of the model at the end.
    """
    from onnx import helper, numpy_helper

    nodes = steps(nodes) if isinstance(nodes, str) else nodes
    used = {name for _, names, _, _ in nodes for name in names}
    kind = helper.np_dtype_to_tensor_dtype(np.dtype(precision))
    arrays = {name: np.asarray(table) for name, table in tables.items() if name in used}
    inwards, outwards = (
        [helper.make_tensor_value_info(name, kind, shape) for name, shape in ports.items()]
        for ports in (inputs, outputs)
    )
    model = helper.make_model(
        helper.make_graph(
            [
                helper.make_node(name, taken, given, **settings)
                for name, taken, given, settings in nodes
            ],
            "graph",
            inwards,
            outwards,
            [
                numpy_helper.from_array(x.astype(precision) if x.dtype.kind == "f" else x, name)
                for name, x in arrays.items()
            ],
        ),
        ir_version=8 if opset < 20 else 9,
        opset_imports=[helper.make_opsetid("", opset)],
    )
    change(model)
    return model.SerializeToString()


def graph(
    nodes: str | Sequence[Node],
    shape: Sequence[Any] = ("N", 2),
    outputs: Sequence[str] = ("y",),
    **settings: Any,
) -> bytes:
    """See `model_of`; of one input "x", with weights "W" and "b" beside others."""
    given: dict[str, Any] = {"W": WEIGHT, "b": SHIFT} | settings
    return model_of(nodes, {"x": shape}, dict.fromkeys(outputs), **given)


def overridable(model: Any) -> None:
    """List weights as inputs, too, as older exporters do: their values are defaults then."""
    from onnx import helper

    model.graph.input.extend(
        helper.make_tensor_value_info(entry.name, entry.data_type, list(entry.dims))
        for entry in model.graph.initializer
    )


@cache
def ordinary() -> dict[str, bytes]:
    """Graphs of which each form is read."""
    gemm = "y = Gemm(x, W, b)"
    reshape = np.array([0, -1], dtype=np.int64)
    return {
        "product and sum": graph("m = MatMul(x, W); y = Add(m, b)"),
        "sum, turned": graph("m = MatMul(x, W); y = Add(b, m)"),
        "less a constant": graph("m = Sub(x, b); y = MatMul(m, W)"),
        "constant less it": graph("m = Sub(b, x); y = MatMul(m, W)"),
        "scaled": graph("m = Mul(x, b); y = MatMul(m, W)"),
        "scaled by a number": graph("m = Mul(s, x); y = MatMul(m, W)", s=np.float32(-3.0)),
        "divided": graph("m = Div(x, b); y = MatMul(m, W)"),
        "general product": graph(gemm),
        "transposed": graph("y = Gemm(x, W, b, transB=1)"),
        "alpha": graph("y = Gemm(x, W, b, alpha=-4.0, transB=1)"),
        "beta": graph("y = Gemm(x, W, b, beta=100.0)"),
        "one bias for all": graph("y = Gemm(x, W, c, beta=2.0)", c=np.array([[0.4]])),
        "without a bias": graph("y = Gemm(x, W)"),
        "bias left out": graph("y = Gemm(x, W, None)"),
        "sum after an activation": graph("m = MatMul(x, W); t = Tanh(m); y = Add(t, b)"),
        "activations": graph(
            "m = MatMul(x, W); r = Relu(m); g = Gemm(r, W, b); s = Sigmoid(g); t = Mul(s, b); y = Tanh(t)"
        ),
        "flattened": graph("f = Flatten(x, axis=1); y = MatMul(f, W)", shape=["N", 1, 1, 2]),
        "reshaped": graph(
            "f = Reshape(x, r); y = Gemm(f, W, b)",
            shape=["N", 1, 1, 2],
            r=reshape,
        ),
        "convolution": graph(
            "c = Conv(x, k, b, kernel_shape=[1, 2], pads=[0, 0, 0, 0]); "
            "d = Conv(c, l, strides=[1, 1], dilations=[1, 1], group=1); "
            "y = Flatten(d)",
            shape=["N", 1, 1, 2],
            k=WEIGHT.reshape(2, 1, 1, 2),
            l=WEIGHT.reshape(2, 2, 1, 1),
        ),
        "default weights": graph(gemm, change=overridable),
        "batch of one": graph(gemm, shape=[1, 2]),
        "double precision": graph(
            gemm,
            precision=np.float64,
        ),
        "oldest operations": graph(gemm, opset=7),
    }


def _own_tanh(model: Any) -> None:
    """Define an operation of another domain, -3 times its argument."""
    from onnx import helper, numpy_helper

    table = numpy_helper.from_array(np.array(-3.0, np.float32), "")
    model.functions.append(
        helper.make_function(
            "own",
            "Tanh",
            ["a"],
            ["b"],
            [
                helper.make_node("Constant", [], ["c"], value=table),
                helper.make_node("Mul", ["a", "c"], ["b"]),
            ],
            [helper.make_opsetid("", 17)],
        )
    )
    model.opset_import.append(helper.make_opsetid("own", 1))
    model.graph.node[-1].domain = "own"


def _outside(model: Any) -> None:
    """Keep the first weight in another file."""
    from onnx.external_data_helper import set_external_data

    tensor = model.graph.initializer[0]
    set_external_data(tensor, "weights.bin", length=len(tensor.raw_data))
    tensor.ClearField("raw_data")


def _sparse(model: Any) -> None:
    from onnx import helper

    tensor = model.graph.initializer[0]
    values = helper.make_tensor("W", tensor.data_type, [1], [3.0])
    places = helper.make_tensor("places", 7, [1], [1])
    model.graph.sparse_initializer.append(helper.make_sparse_tensor(values, places, [2, 2]))
    del model.graph.initializer[0]


def _twice(model: Any) -> None:
    model.graph.initializer.append(model.graph.initializer[0])


def _attribute(name: str, value: Any) -> Callable[[Any], None]:
    def change(model: Any) -> None:
        from onnx import helper

        model.graph.node[0].attribute.append(helper.make_attribute(name, value))

    return change


def _another_precision(model: Any) -> None:
    """The last weight in double precision."""
    from onnx import numpy_helper

    tensor = model.graph.initializer[-1]
    table = numpy_helper.to_array(tensor).astype(np.float64)
    tensor.CopyFrom(numpy_helper.from_array(table, tensor.name))


def _whole_numbers(model: Any) -> None:
    model.graph.input[0].type.tensor_type.elem_type = 7  # int64


def _another_tanh(model: Any) -> None:
    """A function in the place of ONNX's own operation."""
    _own_tanh(model)
    model.functions[0].domain = ""
    model.graph.node[-1].domain = ""


def _another_output(model: Any) -> None:
    """An output that is declared as double, of single precision."""
    model.graph.output[0].type.tensor_type.elem_type = 11


def _two_inputs(model: Any) -> None:
    """Another input, which changes nothing."""
    model.graph.input.append(model.graph.input[0])
    model.graph.input[1].name = "z"


def _two_versions(model: Any) -> None:
    model.opset_import.append(model.opset_import[0])
    model.opset_import[1].version = 6


@cache
def forged() -> dict[str, bytes]:
    """Graphs that an incautious reader takes for other networks, or that no reader knows."""
    gemm = "y = Gemm(x, W, b)"
    image = {"shape": ["N", 1, 1, 2], "k": WEIGHT.reshape(2, 1, 1, 2)}
    long = {"shape": ["N", 1, 1, 4], "k": WEIGHT.reshape(2, 1, 1, 2)}
    flat = "y = Flatten(c)"
    chain = "y = MatMul(x, W); z = Tanh(y)"
    return {
        "matrix before a batch": graph("y = MatMul(W, x)", shape=[2, 1]),
        "activation after the output": graph(chain),
        "two outputs": graph(chain, outputs=["y", "z"]),
        "a dead branch": graph(f"d = MatMul(x, W); {gemm}"),
        "a branch that joins": graph("m = MatMul(x, W); y = Add(m, x)"),
        "the input twice": graph("m = Mul(x, x); y = MatMul(m, W)"),
        "data as the bias": graph("y = Gemm(b, W, x)", b=np.ones((1, 2))),
        "transposed data": graph("y = Gemm(x, W, b, transA=1)", shape=[1, 2]),
        "divided by the state": graph("m = Div(b, x); y = MatMul(m, W)"),
        "divided by zero": graph("m = Div(x, b); y = MatMul(m, W)", b=np.zeros(2)),
        "activations in a row": graph("m = MatMul(x, W); r = Relu(m); y = Tanh(r)"),
        "an activation first": graph("t = Tanh(x); y = MatMul(t, W)"),
        "an operation of its own": graph("m = MatMul(x, W); y = Tanh(m)", change=_own_tanh),
        "weights in another file": graph(gemm, change=_outside),
        "a sparse weight": graph("y = MatMul(x, W)", change=_sparse),
        "a weight twice": graph(gemm, change=_twice),
        "padded": graph(f"c = Conv(x, k, pads=[0, 1, 0, 0]); {flat}", **image),
        "padded by itself": graph(f'c = Conv(x, k, auto_pad="SAME_UPPER"); {flat}', **image),
        "a stride": graph(f"c = Conv(x, k, strides=[1, 2]); {flat}", **long),
        "dilated": graph(f"c = Conv(x, k, dilations=[1, 3]); {flat}", **long),
        "groups": graph(
            f"c = Conv(x, k, group=2); {flat}",
            shape=["N", 2, 1, 1],
            k=np.ones((2, 1, 1, 1)),
        ),
        "a kernel that moves": graph(f"c = Conv(x, k); {flat}", **long),
        "another axis": graph("f = Flatten(x, axis=0); y = MatMul(f, W)"),
        "kept zeros": graph(
            "f = Reshape(x, r, allowzero=1); y = MatMul(f, W)",
            r=np.array([1, 2]),
        ),
        "a state in two rows": graph(
            "f = Reshape(x, r); y = MatMul(f, w)",
            r=np.array([2, 1]),
            w=np.ones((1, 2)),
        ),
        "a bias for a batch": graph("m = MatMul(x, W); y = Add(m, c)", c=np.eye(2)),
        "a larger bias": graph("m = MatMul(x, w); y = Add(m, b)", w=np.ones((2, 1))),
        "three axes of weights": graph("y = MatMul(x, T)", T=WEIGHT[None]),
        "an attribute that it has not": graph(gemm, change=_attribute("broadcast", 1)),
        "an attribute twice": graph(
            "y = Gemm(x, W, b, alpha=1.0)", change=_attribute("alpha", -4.0)
        ),
        "an attribute of another type": graph(gemm, change=_attribute("alpha", 2)),
        "an operation before its time": graph(gemm, opset=6),
        "operations of tomorrow": graph(gemm, opset=28),
        "an output of another precision": graph(gemm, change=_another_output),
        "an axis of minus two": graph("f = Reshape(x, r); y = MatMul(f, W)", r=np.array([1, -2])),
        "two versions": graph(gemm, change=_two_versions),
        "two inputs": graph(gemm, change=_two_inputs),
        "an axis that is not there": graph(
            "f = Reshape(x, r); g = Flatten(f); y = MatMul(g, W)",
            r=np.array([0, -1, 0]),
        ),
        "a bias of one for two": graph("d = Conv(x, k, c); y = Flatten(d)", c=np.ones(1), **image),
        "an operation in another's place": graph(
            "m = MatMul(x, W); y = Tanh(m)", change=_another_tanh
        ),
        "a hundred and one nodes": graph(
            "m0 = MatMul(x, W); "
            + "".join(f"m{k + 1} = Add(m{k}, b); " for k in range(99))
            + "y = Add(m99, b)"
        ),
        "whole numbers": graph(gemm, change=_whole_numbers),
        "a batch of two": graph(gemm, shape=[2, 2]),
        "a column": graph("y = MatMul(W, x)", shape=["N", 2, 1]),
        "an output in between": graph("m = MatMul(x, W); y = MatMul(m, W)", outputs=["m"]),
        "a name of two": graph("y = MatMul(x, W); z = Tanh(y); y = MatMul(z, W)"),
        "a name of a weight": graph("b = MatMul(x, W); y = Add(b, b)"),
        "an operand left out": graph("y = Gemm(x, None, b)"),
        "two weights": graph("y = MatMul(x, W, W)"),
        "another precision": graph(gemm, change=_another_precision),
        "an activation's attribute": graph(
            "t = Tanh(x); y = MatMul(t, W)", change=_attribute("alpha", 2.0)
        ),
        "an activation of two": graph("m = MatMul(x, W); y = Relu(m, b)"),
        "too wide": graph(
            "m = MatMul(x, w); t = Tanh(m); y = MatMul(t, v)",
            w=np.ones((2, 1025)),
            v=np.ones((1025, 2)),
        ),
        "an unknown operation": graph("m = MatMul(x, W); y = Softmax(m)"),
        "no layer": graph("y = Flatten(x)"),
        "no node": graph("", outputs=["x"]),
        "not finite": graph(gemm, b=np.array([np.inf, 0.0])),
        "shapes that do not fit": graph("y = Gemm(x, w, b)", w=np.ones((3, 2))),
    }
