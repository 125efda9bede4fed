"""A network's likeliest commands on a CPU, as machine code: sixteen spacecraft to a vector."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import ClassVar

import numpy as np

from rans.compile.cpu.actor_critic import placed
from rans.compile.cpu.history import CpuHistory
from rans.compile.cpu.llvm import (
    FLOAT,
    INTS,
    LANES,
    LONG,
    POINTER,
    Code,
    Program,
    Value,
)
from rans.compile.cpu.matmul import WIDTH, dense
from rans.model.trace import Symbol
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.capabilities import Capabilities
from rans.policy.network import Network


class CpuPolicy:
    """The deterministic commands of a network of one member without a recurrent core, in float32.

    Args:
        network: on the CPU, in float32.
    """

    capabilities: ClassVar[Capabilities] = Capabilities()

    def __init__(self, network: Network) -> None:
        given = network.architecture
        tensors = network.tensors
        mean, variance = (tensors[EXTRACTOR + name].numpy() for name in ("mean", "variance"))
        self._given = given
        self._mean = mean
        self._scale = (1.0 / np.sqrt(variance + np.float32(1e-6))).astype(np.float32)
        layers = _layers(network)
        self._program = Program()
        self._layers = _Layers(self._program, "layers", layers, given.activation)
        self._program.function(
            "commands",
            (POINTER, LONG, POINTER, LONG, POINTER),
            lambda code, *args: _commands(code, given, *args),
        )
        self._command = self._program.compiled("commands")
        self._run = self._program.compiled("layers")

    def __call__(
        self, seen: Sequence[np.ndarray], view: np.ndarray, history: CpuHistory
    ) -> np.ndarray:
        """Commands (thrusters, N) to columns (N,) as they are seen from one side of the craft, (N,) int32."""
        count = len(seen[0])
        views = np.zeros(-(-count // WIDTH) * WIDTH, np.int32)
        views[:count] = view
        out = self._outputs(self._shown(seen, history.shown(views[:count])))
        commands = np.empty((self._given.thrusters, out.shape[1]), np.float32)
        self._command(
            out.ctypes.data,
            out.shape[1],
            views.ctypes.data,
            out.shape[1] // LANES,
            commands.ctypes.data,
        )
        return commands[:, :count]

    def _outputs(self, rows: np.ndarray) -> np.ndarray:
        """Outputs of the last layer, (outputs, N), of what the first layer is given."""
        layers = self._layers
        count = rows.shape[1]
        out = np.empty((layers.outputs, count), np.float32)
        scratch = np.empty(layers.scratch, np.float32)
        if count:
            self._run(
                rows.ctypes.data,
                count,
                count // WIDTH,
                layers.weights.ctypes.data,
                scratch.ctypes.data,
                out.ctypes.data,
            )
        return out

    def _shown(self, seen: Sequence[np.ndarray], recalled: np.ndarray) -> np.ndarray:
        """What the first layer is given, as `Network.inputs`: rows of a multiple of `WIDTH` spacecraft."""
        given = self._given
        count = len(seen[0])
        rows = np.zeros((given.inputs, -(-count // WIDTH) * WIDTH), np.float32)
        left = iter(rows[:, :count])
        read = iter(seen)
        # Columns as they are read, then as each filter has them, twice each; what filters tell besides.
        for told in given.told:
            columns = list(islice(read, given.seen))
            for i, column in enumerate(columns):
                self._normalise(column, i, next(left))
            for i, column in enumerate(columns if given.zoom else ()):
                row = np.multiply(column, self._scale[i] * np.float32(given.zoom), next(left))
                np.tanh(row, row)
            for column in islice(read, told):
                np.clip(column, -given.clip, given.clip, next(left))
        # Columns and commands of before.
        for then in recalled:
            for i, column in enumerate(then):
                if i < given.answered:
                    self._normalise(column, i, next(left))
                else:
                    next(left)[...] = column
        return rows

    def _normalise(self, column: np.ndarray, i: int, to: np.ndarray) -> None:
        clip = self._given.clip
        np.clip(
            np.multiply(np.subtract(column, self._mean[i], to), self._scale[i], to), -clip, clip, to
        )


def _layers(network: Network) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights (o, i) and biases (o,) of all layers; of on/off thrusters those of the log-odds."""
    given = network.architecture
    tensors = network.tensors
    names = [f"{EXTRACTOR}trunk.{2 * i}" for i in range(len(given.layers))]
    *hidden, (weight, bias) = [
        (tensors[f"{name}.weight"].numpy(), tensors[f"{name}.bias"].numpy())
        for name in (*names, "action_net")
    ]
    return [*hidden, given.last.folded(weight, bias)]


class _Layers:
    """A network's dense layers as a function of a program."""

    def __init__(
        self,
        program: Program,
        name: str,
        layers: Sequence[tuple[np.ndarray, np.ndarray]],
        activation: str,
    ) -> None:
        self._activation = activation
        self._sizes = [layers[0][0].shape[1], *(len(bias) for _, bias in layers)]
        parts = list[np.ndarray]()
        self._starts = list[tuple[int, int]]()
        start = 0
        for weight, bias in layers:
            self._starts.append((start, start + weight.size))
            parts += [weight.ravel(), bias]
            start += weight.size + bias.size
        self.weights = np.concatenate(parts).astype(np.float32)
        self.outputs = self._sizes[-1]
        self.scratch = 2 * max(self._sizes) * WIDTH
        program.function(name, (POINTER, LONG, LONG, POINTER, POINTER, POINTER), self._write)

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
        """Tile by tile, one layer after the other."""

        def tile(number: Value, _: list[Value]) -> list[Value]:
            first = code.mul(number, LONG(WIDTH))
            source = code.at(rows, first, FLOAT)
            step = stride
            for at, (weight, bias) in enumerate(self._starts):
                last = at == len(self._starts) - 1
                to = (
                    code.at(out, first, FLOAT)
                    if last
                    else code.at(scratch, at % 2 * max(self._sizes) * WIDTH, FLOAT)
                )
                dense(
                    code,
                    (self._sizes[at + 1], self._sizes[at]),
                    code.at(weights, weight, FLOAT),
                    code.at(weights, bias, FLOAT),
                    source,
                    step,
                    to,
                    stride if last else LONG(WIDTH),
                    "" if last else self._activation,
                )
                source = to
                step = LONG(WIDTH)
            return []

        code.repeat(tiles, [], tile)


def _commands(
    code: Code,
    given: Architecture,
    outputs: Value,
    stride: Value,
    views: Value,
    vectors: Value,
    out: Value,
) -> None:
    """Commands from the last layer's outputs, of thrusters where they are in the view that was taken."""
    symbols = [Symbol.input(f"output {k}") for k in range(given.last.outputs)]
    command = Symbol.constant(given.last.command(*symbols))

    def vector(number: Value, _: list[Value]) -> list[Value]:
        first = code.mul(number, LONG(LANES))
        view = code.read(views, first, INTS)
        rows = [code.add(code.mul(LONG(i), stride), first) for i in range(given.outputs)]
        read = [code.read(outputs, row) for row in rows]
        commands = []
        for i in range(given.thrusters):
            known = dict(zip(symbols, read[i :: given.thrusters], strict=True))
            commands += code.evaluated([command], known)
        for row, value in zip(rows, placed(code, given, commands, view), strict=False):
            code.write(value, out, row)
        return []

    code.repeat(vectors, [], vector)
