"""An agent as a straight-line program over arrays, from which ONNX, NumPy and C are printed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rans.base.errors import ConfigError
from rans.effectors.commands import is_identity
from rans.model.spacecraft import CommandRange, Spacecraft
from rans.model.trace import UNTRACEABLE
from rans.policy.activations import ACTIVATIONS
from rans.policy.architecture import Architecture
from rans.policy.network import Network
from rans.policy.program import Program
from rans.policy.traced import parameters, policy_program


class Ports(NamedTuple):
    """How many numbers a program takes and gives."""

    observation: int
    command: int
    memory: int = 0

    @classmethod
    def of(cls, architecture: Architecture) -> Ports:
        """Names of the inputs and outputs of the network of an agent of RANS."""
        return cls(architecture.layout.width, architecture.thrusters, architecture.memory)


_ACTIVATIONS = {"tanh": "Tanh", "elu": "Elu", "relu": "Relu"}
"""Activations by name, and the operations that ONNX has for them."""


def agent_program(network: Network, craft: Spacecraft | None = None) -> Program:
    """What a network answers: "command" (N, commands), and "memory_out" (N, m) if it has one.

    Commands are in the ranges of the craft; without one they are from 0 to 1. The same as
    `rans.policy.network.Network.deterministic_action`, of "observation" (N, width) and "memory" (N, m), with every
    operation one of ONNX's.

    Raises:
        ConfigError: the layout of its observation does more than arithmetic.
    """
    architecture = network.architecture
    ranges = () if craft is None or is_identity(craft) else craft.commands
    try:
        program = policy_program(architecture, "output" if ranges else "command")
    except UNTRACEABLE as error:
        raise ConfigError(f"the agent can only be exported as rans: {error}") from error
    if ranges:
        _commanded(program, "output", ranges)
    outputs = ["command", *(["memory_out"] if architecture.memory else [])]
    program = _opened(program.pruned(outputs))
    tables = parameters(network)
    program.constants |= {name: tables[name] for name in program.parameters}
    for name, table in program.constants.items():
        if table.dtype.kind == "f":
            program.constants[name] = table.astype(np.float32)
    return program


def _opened(program: Program) -> Program:
    """A program with ONNX's own operations: "Dense" becomes "Gemm" and an activation."""
    result = Program([], dict(program.constants), dict(program.parameters))
    names: dict[str, str] = {}
    for step in program.steps:
        operands = [names.get(name, name) for name in step.inputs]
        first = step.outputs[0]
        own = re.fullmatch(r"x\d+", first) is not None
        if step.operation == "Dense":
            row = result.apply("Gemm", *operands, transB=1)
            names[first] = _activated(result, str(step.attributes["activation"]), row)
        elif step.operation == "Identity" and own:
            names[first] = operands[0]
        else:
            if own:
                names[first] = f"x{len(result.steps)}"
            outputs = tuple(names.get(name, name) for name in step.outputs)
            result.steps.append(replace(step, inputs=tuple(operands), outputs=outputs))
    return result


def _activated(program: Program, name: str, x: str) -> str:
    """What the function between layers makes of rows, by ONNX's own operation where it has one."""
    if not name:
        return x
    if name in _ACTIVATIONS:
        return program.apply(_ACTIVATIONS[name], x)
    return program.each(ACTIVATIONS[name].formula, x)


def _commanded(program: Program, output: str, ranges: Sequence[CommandRange]) -> None:
    """Commands in their ranges, from outputs from 0 to 1: what `rans.effectors.commands.of_outputs` does.

    0.5 itself opens, as there.
    """

    def row(values: Iterable[float]) -> str:
        return program.constant(np.array([*values], dtype=np.float32))

    scale = row(span.high - span.low if span.kind != "on-off" else 0.0 for span in ranges)
    low = row(span.low for span in ranges)
    if not any(span.kind == "on-off" for span in ranges):
        program.apply("Add", program.apply("Mul", output, scale), low, name="command")
        return
    between = program.apply("Add", program.apply("Mul", output, scale), low)
    # From 0.5 on: more than the number before it.
    before = np.nextafter(np.float32(0.5), np.float32(0.0))
    opens = program.apply("Cast", program.apply("Greater", output, program.constant(before)), to=1)
    chosen = row(float(span.kind == "on-off") for span in ranges)
    program.apply("Add", between, program.apply("Mul", opens, chosen), name="command")
