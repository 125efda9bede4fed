"""Graphs of ONNX of two states and two commands, ordinary and forged, for readers of networks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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


def model_of(
    nodes: Sequence[Node],
    inputs: Mapping[str, Sequence[Any] | None],
    outputs: Mapping[str, Sequence[Any] | None],
    opset: int = 17,
    precision: Any = np.float32,
    change: Callable[[Any], None] = lambda model: None,
    **tables: Any,
) -> bytes:
    """Content of a file with these nodes, shapes of inputs and outputs by name, and of tables those that are used.

    Args:
        change: of the model at the end.
    """
    from onnx import helper, numpy_helper

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
    nodes: Sequence[Node],
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


def ordinary() -> dict[str, bytes]:
    """Graphs of which each form is read."""
    gemm = step("Gemm", "x W b", "y")
    reshape = np.array([0, -1], dtype=np.int64)
    return {
        "product and sum": graph([step("MatMul", "x W", "m"), step("Add", "m b", "y")]),
        "sum, turned": graph([step("MatMul", "x W", "m"), step("Add", "b m", "y")]),
        "less a constant": graph([step("Sub", "x b", "m"), step("MatMul", "m W", "y")]),
        "constant less it": graph([step("Sub", "b x", "m"), step("MatMul", "m W", "y")]),
        "scaled": graph([step("Mul", "x b", "m"), step("MatMul", "m W", "y")]),
        "scaled by a number": graph(
            [step("Mul", "s x", "m"), step("MatMul", "m W", "y")], s=np.float32(-3.0)
        ),
        "divided": graph([step("Div", "x b", "m"), step("MatMul", "m W", "y")]),
        "general product": graph([gemm]),
        "transposed": graph([step("Gemm", "x W b", "y", transB=1)]),
        "alpha": graph([step("Gemm", "x W b", "y", alpha=-4.0, transB=1)]),
        "beta": graph([step("Gemm", "x W b", "y", beta=100.0)]),
        "one bias for all": graph([step("Gemm", "x W c", "y", beta=2.0)], c=np.array([[0.4]])),
        "without a bias": graph([step("Gemm", "x W", "y")]),
        "bias left out": graph([step("Gemm", "x W -", "y")]),
        "sum after an activation": graph(
            [step("MatMul", "x W", "m"), step("Tanh", "m", "t"), step("Add", "t b", "y")]
        ),
        "activations": graph(
            [
                *(step("MatMul", "x W", "m"), step("Relu", "m", "r"), step("Gemm", "r W b", "g")),
                *(step("Sigmoid", "g", "s"), step("Mul", "s b", "t"), step("Tanh", "t", "y")),
            ]
        ),
        "flattened": graph(
            [step("Flatten", "x", "f", axis=1), step("MatMul", "f W", "y")], shape=["N", 1, 1, 2]
        ),
        "reshaped": graph(
            [step("Reshape", "x r", "f"), step("Gemm", "f W b", "y")],
            shape=["N", 1, 1, 2],
            r=reshape,
        ),
        "convolution": graph(
            [
                step("Conv", "x k b", "c", kernel_shape=[1, 2], pads=[0, 0, 0, 0]),
                step("Conv", "c l", "d", strides=[1, 1], dilations=[1, 1], group=1),
                step("Flatten", "d", "y"),
            ],
            shape=["N", 1, 1, 2],
            k=WEIGHT.reshape(2, 1, 1, 2),
            l=WEIGHT.reshape(2, 2, 1, 1),
        ),
        "default weights": graph([gemm], change=overridable),
        "batch of one": graph([gemm], shape=[1, 2]),
        "double precision": graph(
            [
                gemm,
            ],
            precision=np.float64,
        ),
        "oldest operations": graph([gemm], opset=7),
    }


def _functions(kind: str) -> Callable[[Any], None]:
    """Define an operation of another domain, -3 times its argument."""

    def change(model: Any) -> None:
        from onnx import helper, numpy_helper

        table = numpy_helper.from_array(np.array(-3.0, np.float32), "")
        model.functions.append(
            helper.make_function(
                "own",
                kind,
                ["a", "r"] if kind == "Reshape" else ["a"],
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

    return change


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
    _functions("Tanh")(model)
    model.functions[0].domain = ""
    model.graph.node[-1].domain = ""


def _two_inputs(model: Any) -> None:
    """Another input, which changes nothing."""
    model.graph.input.append(model.graph.input[0])
    model.graph.input[1].name = "z"


def _two_versions(model: Any) -> None:
    model.opset_import.append(model.opset_import[0])
    model.opset_import[1].version = 6


def forged() -> dict[str, bytes]:
    """Graphs that an incautious reader takes for other networks, or that no reader knows."""
    gemm = step("Gemm", "x W b", "y")
    image = {"shape": ["N", 1, 1, 2], "k": WEIGHT.reshape(2, 1, 1, 2)}
    long = {"shape": ["N", 1, 1, 4], "k": WEIGHT.reshape(2, 1, 1, 2)}
    flat = step("Flatten", "c", "y")
    chain = [step("MatMul", "x W", "y"), step("Tanh", "y", "z")]
    return {
        "matrix before a vector": graph([step("MatMul", "W x", "y")], shape=[2]),
        "matrix before a batch": graph([step("MatMul", "W x", "y")], shape=[2, 1]),
        "product after the output": graph([gemm, step("MatMul", "y W", "z")]),
        "activation after the output": graph(chain),
        "two outputs": graph(chain, outputs=["y", "z"]),
        "two outputs, turned": graph(chain, outputs=["z", "y"]),
        "a dead branch": graph([step("MatMul", "x W", "d"), gemm]),
        "a branch that joins": graph([step("MatMul", "x W", "m"), step("Add", "m x", "y")]),
        "the input twice": graph([step("Mul", "x x", "m"), step("MatMul", "m W", "y")]),
        "operands exchanged": graph([step("Gemm", "W c x", "y")], shape=[2, 2], c=np.eye(2)),
        "data as the bias": graph([step("Gemm", "b W x", "y")], b=np.ones((1, 2))),
        "transposed data": graph([step("Gemm", "x W b", "y", transA=1)], shape=[1, 2]),
        "divided by the state": graph([step("Div", "b x", "m"), step("MatMul", "m W", "y")]),
        "divided by zero": graph(
            [step("Div", "x b", "m"), step("MatMul", "m W", "y")], b=np.zeros(2)
        ),
        "activations in a row": graph(
            [step("MatMul", "x W", "m"), step("Relu", "m", "r"), step("Tanh", "r", "y")]
        ),
        "three in a row": graph(
            [
                *(step("MatMul", "x W", "m"), step("Tanh", "m", "r")),
                *(step("Sigmoid", "r", "s"), step("Tanh", "s", "y")),
            ]
        ),
        "an activation first": graph([step("Tanh", "x", "t"), step("MatMul", "t W", "y")]),
        "an operation of its own": graph(
            [step("MatMul", "x W", "m"), step("Tanh", "m", "y")], change=_functions("Tanh")
        ),
        "a reshape of its own": graph(
            [step("MatMul", "x W", "m"), step("Reshape", "m r", "y")],
            r=np.array([0, -1]),
            change=_functions("Reshape"),
        ),
        "weights in another file": graph([gemm], change=_outside),
        "a sparse weight": graph([step("MatMul", "x W", "y")], change=_sparse),
        "a weight twice": graph([gemm], change=_twice),
        "padded": graph([step("Conv", "x k", "c", pads=[0, 1, 0, 0]), flat], **image),
        "padded by itself": graph([step("Conv", "x k", "c", auto_pad="SAME_UPPER"), flat], **image),
        "a stride": graph([step("Conv", "x k", "c", strides=[1, 2]), flat], **long),
        "dilated": graph([step("Conv", "x k", "c", dilations=[1, 3]), flat], **long),
        "groups": graph(
            [step("Conv", "x k", "c", group=2), flat],
            shape=["N", 2, 1, 1],
            k=np.ones((2, 1, 1, 1)),
        ),
        "a kernel that moves": graph([step("Conv", "x k", "c"), flat], **long),
        "another axis": graph([step("Flatten", "x", "f", axis=0), step("MatMul", "f W", "y")]),
        "kept zeros": graph(
            [step("Reshape", "x r", "f", allowzero=1), step("MatMul", "f W", "y")],
            r=np.array([1, 2]),
        ),
        "a state in two rows": graph(
            [step("Reshape", "x r", "f"), step("MatMul", "f w", "y")],
            r=np.array([2, 1]),
            w=np.ones((1, 2)),
        ),
        "a bias for a batch": graph(
            [step("MatMul", "x W", "m"), step("Add", "m c", "y")], c=np.eye(2)
        ),
        "a larger bias": graph(
            [step("MatMul", "x w", "m"), step("Add", "m b", "y")], w=np.ones((2, 1))
        ),
        "three axes of weights": graph([step("MatMul", "x T", "y")], T=WEIGHT[None]),
        "an attribute that it has not": graph([gemm], change=_attribute("broadcast", 1)),
        "an attribute twice": graph(
            [step("Gemm", "x W b", "y", alpha=1.0)], change=_attribute("alpha", -4.0)
        ),
        "an attribute of another type": graph([gemm], change=_attribute("alpha", 2)),
        "an operation before its time": graph([gemm], opset=6),
        "an operation of the future": graph([gemm], opset=99),
        "two versions": graph([gemm], change=_two_versions),
        "two inputs": graph([gemm], change=_two_inputs),
        "an axis that is not there": graph(
            [step("Reshape", "x r", "f"), step("Flatten", "f", "g"), step("MatMul", "g W", "y")],
            r=np.array([0, -1, 0]),
        ),
        "a bias of one for two": graph(
            [step("Conv", "x k c", "d"), step("Flatten", "d", "y")], c=np.ones(1), **image
        ),
        "an operation in another's place": graph(
            [step("MatMul", "x W", "m"), step("Tanh", "m", "y")], change=_another_tanh
        ),
        "a hundred and one nodes": graph(
            [
                step("MatMul", "x W", "m0"),
                *(step("Add", f"m{k} b", f"m{k + 1}") for k in range(99)),
                step("Add", "m99 b", "y"),
            ]
        ),
        "whole numbers": graph([gemm], change=_whole_numbers),
        "a batch of two": graph([gemm], shape=[2, 2]),
        "any number of states": graph([gemm], shape=["N", "M"]),
        "a column": graph([step("MatMul", "W x", "y")], shape=["N", 2, 1]),
        "columns": graph(
            [step("MatMul", "x v", "m"), step("Flatten", "m", "f"), step("MatMul", "f W", "y")],
            shape=["N", 2, 1],
            v=np.full((1, 1), 3.0),
        ),
        "an output of a weight": graph([gemm], outputs=["W"]),
        "an output of nothing": graph([gemm], outputs=["q"]),
        "an output in between": graph(
            [step("MatMul", "x W", "m"), step("MatMul", "m W", "y")], outputs=["m"]
        ),
        "the input as the output": graph([gemm], outputs=["x"]),
        "a name of two": graph(
            [step("MatMul", "x W", "y"), step("Tanh", "y", "z"), step("MatMul", "z W", "y")]
        ),
        "a name of a weight": graph([step("MatMul", "x W", "b"), step("Add", "b b", "y")]),
        "an operand left out": graph([step("Gemm", "x - b", "y")]),
        "no weight": graph([step("Gemm", "x", "y")]),
        "two weights": graph([step("MatMul", "x W W", "y")]),
        "another precision": graph([gemm], change=_another_precision),
        "an activation's attribute": graph(
            [step("Tanh", "x", "t"), step("MatMul", "t W", "y")], change=_attribute("alpha", 2.0)
        ),
        "an activation of two": graph([step("MatMul", "x W", "m"), step("Relu", "m b", "y")]),
        "too wide": graph(
            [step("MatMul", "x w", "m"), step("Tanh", "m", "t"), step("MatMul", "t v", "y")],
            w=np.ones((2, 1025)),
            v=np.ones((1025, 2)),
        ),
        "an unknown operation": graph([step("MatMul", "x W", "m"), step("Softmax", "m", "y")]),
        "no layer": graph([step("Flatten", "x", "y")]),
        "no node": graph([], outputs=["x"]),
        "not finite": graph([gemm], b=np.array([np.inf, 0.0])),
        "shapes that do not fit": graph([step("Gemm", "x w b", "y")], w=np.ones((3, 2))),
    }
