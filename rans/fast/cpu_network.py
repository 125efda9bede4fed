"""A network's likeliest commands on a CPU, as machine code: sixteen spacecraft to a vector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice, pairwise

import numpy as np

from rans.fast.cpu_history import CpuHistory
from rans.fast.cpu_look import placed
from rans.fast.learn.architecture import EXTRACTOR, Architecture
from rans.fast.learn.network import Network
from rans.fast.products import WIDTH, product
from rans.fast.vectors import (
    FEATURES,
    FLOAT,
    FLOATS,
    INTS,
    LANES,
    LONG,
    POINTER,
    Code,
    Program,
    Value,
    constant,
)

_MARGIN = 2.0
"""Of the greatest error of the first 10^5 logits or so: of 10^8 later ones none was beyond it."""


class CpuNetwork:
    """The commands of a network of one member without a recurrent core, as float32 finds them.

    On a processor that multiplies bytes (AVX512-VNNI), hyperbolic tangents but the last layer's are rounded
    to one, and so are the weights that they meet. Where that leaves a command in doubt, float32 decides.

    Args:
        network: on the CPU, in float32.
        quick: whether bytes are multiplied, where the processor can.
    """

    def __init__(self, network: Network, quick: bool = True) -> None:
        given = network.architecture
        tensors = network.tensors
        mean, variance = (tensors[EXTRACTOR + name].numpy() for name in ("mean", "variance"))
        self._given = given
        self._mean = mean
        self._scale = (1.0 / np.sqrt(variance + np.float32(1e-6))).astype(np.float32)
        layers = _layers(network)
        self._program = Program()
        # A duty is nowhere in doubt: all its digits count.
        self._quick = (
            quick
            and "+avx512vnni" in FEATURES
            and given.activation == "tanh"
            and len(layers) > 2
            and not given.continuous
        )
        self._made = {
            name: _Products(self._program, name, layers, given.activation, name == "quick")
            for name in (("exact", "quick") if self._quick else ("exact",))
        }
        self._program.function(
            "commands",
            (POINTER, LONG, POINTER, LONG, POINTER),
            lambda code, *args: _commands(code, given, *args),
        )
        self._command = self._program.compiled("commands")
        self._run = {name: self._program.compiled(name) for name in self._made}
        self._doubtful = math.inf
        self._worst = 0.0

    def settle(self) -> None:
        """Doubt logits below a bound from now on, by the greatest error so far."""
        self._doubtful = _MARGIN * self._worst

    def __call__(
        self, seen: Sequence[np.ndarray], view: np.ndarray, history: CpuHistory
    ) -> np.ndarray:
        """Commands (thrusters, N) to columns (N,) as they are seen from one side of the craft, (N,) int32."""
        count = len(seen[0])
        views = np.zeros(-(-count // WIDTH) * WIDTH, np.int32)
        views[:count] = view
        out = self._logits(self._shown(seen, history.shown(views[:count])), count)
        commands = np.empty_like(out)
        self._command(
            out.ctypes.data,
            out.shape[1],
            views.ctypes.data,
            out.shape[1] // LANES,
            commands.ctypes.data,
        )
        return commands[:, :count]

    def _logits(self, rows: np.ndarray, count: int) -> np.ndarray:
        """Log-odds or duties, a row for each thruster."""
        if not self._quick:
            return self._through("exact", rows)
        out = self._through("quick", rows)
        logits = out[:, :count]
        doubtful = np.flatnonzero(np.abs(logits).min(axis=0) < self._doubtful)
        exact = self._through("exact", _padded(rows.take(doubtful, axis=1)))[:, : len(doubtful)]
        if self._doubtful == math.inf:
            self._worst = max(self._worst, float(np.abs(logits - exact).max()))
        logits[:, doubtful] = exact
        return out

    def _through(self, name: str, rows: np.ndarray) -> np.ndarray:
        products = self._made[name]
        count = rows.shape[1]
        out = np.empty((products.outputs, count), np.float32)
        scratch = np.empty(products.scratch, np.float32)
        if count:
            self._run[name](
                rows.ctypes.data,
                count,
                count // WIDTH,
                products.weights.ctypes.data,
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
    if not given.continuous:
        weight = weight[1::2] - weight[0::2]
        bias = bias[1::2] - bias[0::2]
    return [*hidden, (weight, bias)]


def _padded(rows: np.ndarray) -> np.ndarray:
    """Of a multiple of `WIDTH` spacecraft."""
    return np.pad(rows, ((0, 0), (0, -rows.shape[1] % WIDTH)))


class _Products:
    """A network's layers, of which some multiply bytes, as a function of a program."""

    def __init__(
        self,
        program: Program,
        name: str,
        layers: Sequence[tuple[np.ndarray, np.ndarray]],
        activation: str,
        quick: bool,
    ) -> None:
        self._activation = activation
        self._parts = list[np.ndarray]()
        self._bytes = [quick and 0 < at < len(layers) - 1 for at in range(len(layers))]
        # Bytes come by four.
        self._sizes = [
            layers[0][0].shape[1],
            *(-(-len(bias) // 4) * 4 if quick else len(bias) for _, bias in layers[:-1]),
            len(layers[-1][1]),
        ]
        self._starts = [
            self._pack(*pair, *sizes, whole)
            for pair, sizes, whole in zip(layers, pairwise(self._sizes), self._bytes, strict=True)
        ]
        self.weights = np.concatenate(self._parts)
        self.outputs, self.scratch = self._sizes[-1], 2 * max(self._sizes) * WIDTH
        program.function(name, (POINTER, LONG, LONG, POINTER, POINTER, POINTER), self._write)

    def _pack(
        self, weight: np.ndarray, bias: np.ndarray, inputs: int, units: int, whole: bool
    ) -> int:
        """Where among the weights this layer's begin; bytes are followed by scales, both by biases."""
        start = sum(map(len, self._parts))
        full = np.pad(weight, ((0, units - len(weight)), (0, inputs - weight.shape[1])))
        ends = [np.pad(bias, (0, units - len(bias)))]
        if whole:
            scale = np.maximum(np.abs(full).max(axis=1), np.float32(1e-30)) / np.float32(127)
            rounded = np.round(full / scale[:, None])
            # Tangents of -1 to 1 are bytes of 0 to 255.
            ends = [scale / np.float32(127.5), ends[0] - scale * rounded.sum(axis=1)]
            full = rounded.astype(np.int8).view(np.float32)
        self._parts += [full.ravel(), *(end.astype(np.float32) for end in ends)]
        return start

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
            for at in range(len(self._bytes)):
                last = at == len(self._bytes) - 1
                to = (
                    code.at(out, first, FLOAT)
                    if last
                    else code.at(scratch, at % 2 * max(self._sizes) * WIDTH, FLOAT)
                )
                self._layer(
                    code,
                    at,
                    code.at(weights, self._starts[at], FLOAT),
                    source,
                    step,
                    to,
                    stride if last else LONG(WIDTH),
                )
                source = to
                step = LONG(WIDTH)
            return []

        code.repeat(tiles, [], tile)

    def _layer(
        self,
        code: Code,
        at: int,
        weights: Value,
        source: Value,
        stride: Value,
        to: Value,
        step: Value,
    ) -> None:
        inputs = self._sizes[at]
        units = self._sizes[at + 1]
        whole = self._bytes[at]
        length = inputs // 4 if whole else inputs
        last = at == len(self._bytes) - 1
        rounds = not last and self._bytes[at + 1]
        ends = code.at(weights, units * length, FLOAT)

        def finish(first: Value, sums: list[Sequence[Value]]) -> None:
            rows = [
                [
                    self._ended(
                        code, value, ends, code.add(first, LONG(u)), units if whole else 0, last
                    )
                    for value in row
                ]
                for u, row in enumerate(sums)
            ]
            if rounds:
                first = code.udiv(first, LONG(4))
                rows = [
                    [_four(code, column) for column in zip(*rows[begin : begin + 4], strict=True)]
                    for begin in range(0, len(rows), 4)
                ]
            for u, row in enumerate(rows):
                for v, value in enumerate(row):
                    place = code.mul(code.add(first, LONG(u)), step)
                    code.write(value, to, code.add(place, LONG(v * LANES)))

        product(code, (units, length), weights, (length, 1), source, stride, finish, whole)

    def _ended(
        self, code: Code, value: Value, ends: Value, unit: Value, scaled: int, last: bool
    ) -> Value:
        """A unit's sum with its bias, where scaled so many numbers behind its scale, and activation."""
        if scaled:
            scale = code.everywhere(code.read(ends, unit, FLOAT))
            unit = code.add(unit, LONG(scaled))
            value = code.fmul(code.sitofp(value, FLOATS), scale)
        value = code.fadd(value, code.everywhere(code.read(ends, unit, FLOAT)))
        return value if last else code.activation(self._activation, value)


def _four(code: Code, values: Sequence[Value]) -> Value:
    """Four numbers from -1 to 1 as the bytes of one."""
    half = code.everywhere(127.5)
    found = [code.fptosi(code.times_plus(x, half, code.everywhere(128.0)), INTS) for x in values]
    result = found[0]
    for i, value in enumerate(found[1:], 1):
        result = code.or_(result, code.shl(value, constant(8 * i)))
    return result


def _commands(
    code: Code,
    given: Architecture,
    logits: Value,
    stride: Value,
    views: Value,
    vectors: Value,
    out: Value,
) -> None:
    """What each thruster is told, from where it is in the view that it was seen in."""

    def vector(number: Value, _: list[Value]) -> list[Value]:
        first = code.mul(number, LONG(LANES))
        zero = code.everywhere(0.0)
        one = code.everywhere(1.0)
        view = code.read(views, first, INTS)
        rows = [code.add(code.mul(LONG(i), stride), first) for i in range(given.thrusters)]
        told = [code.read(logits, row) for row in rows]
        told = [
            code.within(x, 0.0, 1.0)
            if given.continuous
            else code.select(code.fcmp_ordered(">", x, zero), one, zero)
            for x in told
        ]
        for row, value in zip(rows, placed(code, given, told, view), strict=True):
            code.write(value, out, row)
        return []

    code.repeat(vectors, [], vector)
