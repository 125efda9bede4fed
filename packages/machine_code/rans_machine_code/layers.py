"""A policy's dense layers on a CPU, as machine code: sixteen spacecraft to a vector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rans.extend import Architecture, Capabilities
from rans.policy.allocated import choice
from rans.policy.scalars import Stage
from rans_machine_code.llvm import FLOAT, LONG, POINTER, Code, MachineModule, Value
from rans_machine_code.matmul import WIDTH, dense_layer

_SUBSETS = 128
"""Ways to open thrusters up to which machine code compares them faster than a product of matrices does."""


_SUPPORTED = Capabilities(backbones=("dense", "allocated"))


def lacking(architecture: Architecture) -> str:
    """What these layers lack for flights of a policy, in words; "": nothing."""
    if missing := _SUPPORTED.missing(architecture):
        return missing
    chosen = None
    if architecture.backbone == "allocated":
        chosen = choice(architecture.tokens, architecture.adapts, architecture.frugality.price)
    is_large = chosen is not None and len(chosen.offset) > _SUBSETS
    return f"more than {_SUBSETS} ways to open thrusters" if is_large else ""


class LayersMemory(NamedTuple):
    """Arrays that the code of dense layers reads and writes."""

    rows: np.ndarray
    """(inputs, N), each row of a multiple of `WIDTH` numbers in memory."""
    out: np.ndarray
    """(outputs, N), the same."""
    scratch: np.ndarray


class CpuLayers:
    """Layers one after the other, in float32.

    Args:
        stage: which they are.
        tables: the policy's parameters (`rans.policy.traced.parameters`).
    """

    def __init__(self, stage: Stage, tables: Mapping[str, np.ndarray]) -> None:
        # Weights are copied here: what an optimizer changes later does not reach them.
        self._layers = stage.layers
        self._sizes = [len(stage.inputs), *(layer.units for layer in stage.layers)]
        parts = list[np.ndarray]()
        self._starts = list[tuple[int, int]]()
        start = 0
        for layer in stage.layers:
            weight = tables[layer.weight]
            bias = tables[layer.bias]
            self._starts.append((start, start + weight.size))
            parts += [weight.ravel(), bias]
            start += weight.size + bias.size
        self._weights = np.concatenate(parts).astype(np.float32)
        self._program = MachineModule()
        self._program.function(
            "layers", (POINTER, LONG, LONG, POINTER, POINTER, POINTER), self._write
        )
        self._run = self._program.compiled("layers")

    def memory(self, count: int) -> LayersMemory:
        """Buffers for the layers of N spacecraft; two threads need one each."""
        padded = -(-count // WIDTH) * WIDTH
        return LayersMemory(
            np.zeros((self._sizes[0], padded), np.float32)[:, :count],
            np.zeros((self._sizes[-1], padded), np.float32)[:, :count],
            np.empty(2 * max(self._sizes) * WIDTH, np.float32),
        )

    def __call__(self, columns: Sequence[np.ndarray], memory: LayersMemory) -> np.ndarray:
        """Outputs (outputs, N) of what the first layer is given, one array (N,) or number a column.

        The next call with the same memory overwrites them.
        """
        rows, out, scratch = memory
        for row, column in zip(rows, columns, strict=True):
            row[:] = column
        stride = rows.strides[0] // rows.itemsize
        self._run(
            rows.ctypes.data,
            stride,
            stride // WIDTH,
            self._weights.ctypes.data,
            scratch.ctypes.data,
            out.ctypes.data,
        )
        return out

    def _write(
        self,
        code: Code,
        rows: Value,
        stride: Value,
        tiles: Value,
        weights: Value,
        scratch: Value,
        out: Value,
    ) -> None:
        """Print all layers for one tile of `WIDTH` spacecraft after another.

        Arrays are float32 of as many columns as tiles have. Sums are torch's to rounding, not to the bit.
        """

        def tile(number: Value, _: list[Value]) -> list[Value]:
            """Print all layers for one tile: `WIDTH` columns of ``rows`` become those of ``out``."""
            first = code.mul(number, LONG(WIDTH))
            source = code.at(rows, first, FLOAT)
            step = stride
            # Outputs of layers go to two halves of the scratch memory in turn, those of the last to the result.
            for at, (weight, bias) in enumerate(self._starts):
                last = at == len(self._starts) - 1
                to = (
                    code.at(out, first, FLOAT)
                    if last
                    else code.at(scratch, at % 2 * max(self._sizes) * WIDTH, FLOAT)
                )
                dense_layer(
                    code,
                    (self._sizes[at + 1], self._sizes[at]),
                    code.at(weights, weight, FLOAT),
                    code.at(weights, bias, FLOAT),
                    source,
                    step,
                    to,
                    stride if last else LONG(WIDTH),
                    self._layers[at].activation,
                )
                source = to
                step = LONG(WIDTH)
            return []

        # Rows are read once a tile; between layers they are in the scratch memory.
        code.repeat(tiles, [], tile)
