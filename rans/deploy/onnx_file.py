"""An agent's program as an ONNX file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rans.base.errors import require
from rans.base.files import replace_file
from rans.deploy.program import Ports
from rans.policy.program import Program

OPSET = 17
FORMAT = 8
"""Versions of operators and of the file, those of ONNX 1.12 of 2022: runtimes on robots are old."""


def write_onnx(
    folder: Path,
    program: Program,
    ports: Ports,
    title: str,
    contract: str,
    pairs: Mapping[str, Any] | None = None,
) -> None:
    """Write agent.onnx with inputs and outputs of any number of rows, and title and contract as metadata.

    MissingPackage where the package onnx is missing, ConfigError where the disk refuses.
    """
    onnx = require("onnx")
    from onnx import helper, numpy_helper

    def rows(name: str, width: int) -> Any:
        return helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["N", width])

    # Operations and tables of the program.
    nodes = [helper.make_node(step.operation, step.inputs, step.outputs) for step in program.steps]
    for node, step in zip(nodes, program.steps, strict=True):
        node.attribute.extend(helper.make_attribute(*each) for each in step.attributes.items())
    tables = [
        numpy_helper.from_array(np.asarray(value), name)
        for name, value in program.constants.items()
    ]
    # Inputs and outputs; a memory goes in and comes out.
    takes = [rows("observation", ports.observation)]
    gives = [rows("command", ports.command)]
    if ports.memory:
        takes.append(rows("memory", ports.memory))
        gives.append(rows("memory_out", ports.memory))
    graph = helper.make_graph(nodes, "agent", takes, gives, tables, doc_string=title)
    model = helper.make_model(
        graph,
        producer_name="rans",
        ir_version=FORMAT,
        opset_imports=[helper.make_opsetid("", OPSET)],
    )
    helper.set_model_props(model, {"what": title, "contract": contract})
    onnx.checker.check_model(model, full_check=True)
    replace_file(folder / "agent.onnx", lambda draft: draft.write_bytes(model.SerializeToString()))
