"""A network's likeliest commands on a CPU, as machine code: sixteen spacecraft to a vector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from llvmlite import ir

from rans.fast.learn.architecture import EXTRACTOR, Architecture
from rans.fast.learn.network import Network
from rans.fast.vectors import (
    FEATURES,
    FLOAT,
    FLOATS,
    INT,
    INTS,
    LANES,
    LONG,
    POINTER,
    ROWS,
    TILE,
    Code,
    Program,
    Value,
)

WIDTH = LANES * TILE
"""Spacecraft that go through the network together."""
_MARGIN = 2.0
"""Of the greatest error of the first 10^5 logits or so: of 10^8 later ones none was beyond it."""
_DOT = "llvm.x86.avx512.vpdpbusd.512"
"""Adds products of four unsigned and four signed bytes to each of sixteen sums."""


class CpuNetwork:
    """The commands of a network of one member that remembers nothing, as float32 finds them.

    On a processor that multiplies bytes (AVX512-VNNI), hyperbolic tangents but the last layer's are rounded
    to one, and so are the weights that they meet. Where that leaves a command in doubt, float32 decides.

    Args:
        network: on the CPU, in float32.
        quick: whether bytes are multiplied, where the processor can.
    """

    def __init__(self, network: Network, quick: bool = True) -> None:
        given, tensors = network.architecture, network.tensors
        mean, variance = (tensors[EXTRACTOR + name].numpy() for name in ("mean", "variance"))
        self._given, self._mean = given, mean
        self._scale = (1.0 / np.sqrt(variance + np.float32(1e-6))).astype(np.float32)
        layers = _layers(network)
        self._program, self._views = Program(), given.symmetries
        # A duty is nowhere in doubt: all its digits count.
        self._quick = (quick and "+avx512vnni" in FEATURES and given.activation == "tanh"
                       and len(layers) > 2 and not given.continuous)
        self._made = {name: _Products(self._program, name, layers, given.activation, name == "quick")
                      for name in (("exact", "quick") if self._quick else ("exact",))}
        self._program.function("commands", (POINTER, LONG, POINTER, LONG, POINTER),
                               lambda code, *args: _commands(code, given, *args))
        self._command = self._program.compiled("commands")
        self._run = {name: self._program.compiled(name) for name in self._made}
        self._doubtful, self._worst = math.inf, 0.0

    def settle(self) -> None:
        """Doubt logits below a bound from now on, by the greatest error so far."""
        self._doubtful = _MARGIN * self._worst

    def __call__(self, seen: Sequence[np.ndarray], view: np.ndarray) -> np.ndarray:
        """Commands (thrusters, N) to columns (N,) as they are seen from one side of the craft, (N,) int32."""
        count = len(seen[0])
        out = self._logits(self._shown(seen), count)
        views, commands = np.zeros(out.shape[1], np.int32), np.empty_like(out)
        views[:count] = view
        self._command(out.ctypes.data, out.shape[1], views.ctypes.data, out.shape[1] // LANES,
                      commands.ctypes.data)
        return commands[:self._given.thrusters, :count]

    def _logits(self, rows: np.ndarray, count: int) -> np.ndarray:
        """Log-odds or duties, a row for each thruster and maybe more."""
        if not self._quick:
            return self._through("exact", rows)
        out = self._through("quick", rows)
        logits = out[:self._given.thrusters, :count]
        doubtful = np.flatnonzero(np.abs(logits).min(axis=0) < self._doubtful)
        exact = self._through("exact", _padded(rows.take(doubtful, axis=1)))[:len(logits), :len(doubtful)]
        if self._doubtful == math.inf:
            self._worst = max(self._worst, float(np.abs(logits - exact).max()))
        logits[:, doubtful] = exact
        return out

    def _through(self, name: str, rows: np.ndarray) -> np.ndarray:
        products, count = self._made[name], rows.shape[1]
        out = np.empty((products.outputs, count), np.float32)
        scratch = np.empty(products.scratch, np.float32)
        if count:
            self._run[name](rows.ctypes.data, count, count // WIDTH, products.weights.ctypes.data,
                            scratch.ctypes.data, out.ctypes.data)
        return out

    def _shown(self, seen: Sequence[np.ndarray]) -> np.ndarray:
        """What the first layer is given, as `Network._looks`: rows of a multiple of `WIDTH` spacecraft."""
        given, width, count = self._given, len(seen), len(seen[0])
        rows = np.zeros((width * (2 if given.zoom else 1), -(-count // WIDTH) * WIDTH), np.float32)
        for i, column in enumerate(seen):
            row = np.subtract(column, self._mean[i], rows[i, :count])
            np.clip(np.multiply(row, self._scale[i], row), -given.clip, given.clip, row)
            if given.zoom:
                row = np.multiply(column, self._scale[i] * np.float32(given.zoom), rows[width + i, :count])
                np.tanh(row, row)
        return rows


def _layers(network: Network) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights (o, i) and biases (o,) of all layers; of on/off thrusters those of the log-odds."""
    given, tensors = network.architecture, network.tensors
    names = [f"{EXTRACTOR}trunk.{2 * i}" for i in range(len(given.layers))]
    *hidden, (weight, bias) = [(tensors[f"{name}.weight"].numpy(), tensors[f"{name}.bias"].numpy())
                               for name in (*names, "action_net")]
    if not given.continuous:
        weight, bias = weight[1::2] - weight[0::2], bias[1::2] - bias[0::2]
    return [*hidden, (weight, bias)]


def _padded(rows: np.ndarray) -> np.ndarray:
    """Of a multiple of `WIDTH` spacecraft."""
    return np.pad(rows, ((0, 0), (0, -rows.shape[1] % WIDTH)))


class _Products:
    """A network's layers, of which some multiply bytes, as a function of a program.

    Weights lie in the order in which they are used, units in groups of `ROWS`, the last filled with zeros.
    """

    def __init__(self, program: Program, name: str, layers: Sequence[tuple[np.ndarray, np.ndarray]],
                 activation: str, quick: bool) -> None:
        self._activation, self._parts = activation, list[np.ndarray]()
        self._sizes = [layers[0][0].shape[1], *(-(-len(bias) // ROWS) * ROWS for _, bias in layers)]
        self._bytes = [quick and 0 < at < len(layers) - 1 for at in range(len(layers))]
        self._starts = [self._pack(*pair, *sizes, whole) for pair, sizes, whole in
                        zip(layers, pairwise(self._sizes), self._bytes, strict=True)]
        self.weights = np.concatenate(self._parts)
        self.outputs, self.scratch = self._sizes[-1], 2 * max(self._sizes) * WIDTH
        program.function(name, (POINTER, LONG, LONG, POINTER, POINTER, POINTER), self._write)

    def _pack(self, weight: np.ndarray, bias: np.ndarray, inputs: int, units: int, whole: bool) -> int:
        """Where among the weights this layer's begin; bytes are followed by scales, both by biases."""
        start = sum(map(len, self._parts))
        full = np.zeros((units, inputs), np.float32)
        full[:len(weight), :weight.shape[1]] = weight
        ends = [np.pad(bias, (0, units - len(bias)))]
        if whole:
            scale = np.maximum(np.abs(full).max(axis=1), np.float32(1e-30)) / np.float32(127)
            rounded = np.round(full / scale[:, None])
            # Tangents of -1 to 1 are bytes of 0 to 255.
            ends = [scale / np.float32(127.5), ends[0] - scale * rounded.sum(axis=1)]
            full = rounded.astype(np.int8).view(np.float32)
        groups = full.reshape(units // ROWS, ROWS, -1).transpose(0, 2, 1).ravel()
        self._parts += [groups, *(end.astype(np.float32) for end in ends)]
        return start

    def _write(self, code: Code, rows: Value, stride: Value, tiles: Value, weights: Value,
               scratch: Value, out: Value) -> None:
        """Tile by tile, one layer after the other."""
        def tile(number: Value, _: list[Value]) -> list[Value]:
            first = code.mul(number, LONG(WIDTH))
            source, step = code.at(rows, first, FLOAT), stride
            for at in range(len(self._bytes)):
                last = at == len(self._bytes) - 1
                to = code.at(out, first, FLOAT) if last else code.at(
                    scratch, at % 2 * max(self._sizes) * WIDTH, FLOAT)
                self._layer(code, at, code.at(weights, self._starts[at], FLOAT), source, step, to,
                            stride if last else LONG(WIDTH))
                source, step = to, LONG(WIDTH)
            return []

        code.repeat(tiles, [], tile)

    def _layer(self, code: Code, at: int, weights: Value, source: Value, stride: Value,
               to: Value, step: Value) -> None:
        inputs, units, whole = self._sizes[at], self._sizes[at + 1], self._bytes[at]
        length, last = inputs // 4 if whole else inputs, at == len(self._bytes) - 1
        rounds, kind = not last and self._bytes[at + 1], INTS if whole else FLOATS
        ends = code.at(weights, units * length, FLOAT)

        def group(number: Value, _: list[Value]) -> list[Value]:
            first = code.mul(number, LONG(ROWS * length))

            def summand(k: Value, sums: list[Value]) -> list[Value]:
                place, begin = code.mul(k, stride), code.add(first, code.mul(k, LONG(ROWS)))
                x = [code.read(source, code.add(place, LONG(v * LANES)), kind) for v in range(TILE)]
                w = [code.everywhere(code.read(weights, code.add(begin, LONG(u)), kind.element))
                     for u in range(ROWS)]
                return [code.intrinsic(_DOT, old, x[i % TILE], w[i // TILE]) if whole else
                        code.times_plus(w[i // TILE], x[i % TILE], old) for i, old in enumerate(sums)]

            sums = code.repeat(length, [ir.Constant(kind, [0] * LANES)] * (ROWS * TILE), summand)
            unit, values = code.mul(number, LONG(ROWS)), list[Value]()
            for i, value in enumerate(sums):
                u = code.add(unit, LONG(i // TILE))
                if whole:
                    scale = code.everywhere(code.read(ends, u, FLOAT))
                    bias = code.everywhere(code.read(ends, code.add(u, LONG(units)), FLOAT))
                    value = code.times_plus(code.sitofp(value, FLOATS), scale, bias)
                else:
                    value = code.fadd(value, code.everywhere(code.read(ends, u, FLOAT)))
                values.append(value if last else code.activation(self._activation, value))
            if rounds:
                values = [_four(code, values[v::TILE][first:first + 4])
                          for first in range(0, ROWS, 4) for v in range(TILE)]
                unit = code.mul(number, LONG(ROWS // 4))
            for i, value in enumerate(values):
                row = code.mul(code.add(unit, LONG(i // TILE)), step)
                code.write(value, to, code.add(row, LONG(i % TILE * LANES)))
            return []

        code.repeat(units // ROWS, [], group)


def _four(code: Code, values: Sequence[Value]) -> Value:
    """Four numbers from -1 to 1 as the bytes of one."""
    half = code.everywhere(127.5)
    found = [code.fptosi(code.times_plus(x, half, code.everywhere(128.0)), INTS) for x in values]
    result = found[0]
    for i, value in enumerate(found[1:], 1):
        result = code.or_(result, code.shl(value, ir.Constant(INTS, [8 * i] * LANES)))
    return result


def _commands(code: Code, given: Architecture, logits: Value, stride: Value, views: Value,
              vectors: Value, out: Value) -> None:
    """What each thruster is told, from where it is in the view that it was seen in."""
    place = np.arange(given.thrusters)[None] if given.symmetries is None else given.symmetries.place

    def vector(number: Value, _: list[Value]) -> list[Value]:
        first, zero, one = code.mul(number, LONG(LANES)), code.everywhere(0.0), code.everywhere(1.0)
        view = code.read(views, first, INTS)
        rows = [code.add(code.mul(LONG(i), stride), first) for i in range(given.thrusters)]
        told = [code.read(logits, row) for row in rows]
        told = [code.within(x, 0.0, 1.0) if given.continuous else
                code.select(code.fcmp_ordered(">", x, zero), one, zero) for x in told]
        chosen = [told[i] for i in place[0]]
        for side, places in enumerate(place[1:], 1):
            here = code.icmp_signed("==", view, code.everywhere(INT(side)))
            chosen = [code.select(here, told[i], old) for i, old in zip(places, chosen, strict=True)]
        for row, value in zip(rows, chosen, strict=True):
            code.write(value, out, row)
        return []

    code.repeat(vectors, [], vector)
