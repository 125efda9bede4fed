"""Dense layers as machine code, with arithmetic before and after them, sixteen spacecraft to a vector."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.extend import Architecture, Capabilities, Symbol
from rans_machine_code.llvm import FLOAT, LANES, LONG, POINTER, TILE, Code, Value, compiled
from rans_machine_code.matmul import WIDTH, dense_layer
from rans_machine_code.policies import NetworkProgram


class NetworkCode(NamedTuple):
    """All that the code of a network depends on: networks that are alike in it share their code."""

    columns: tuple[Symbol, ...]
    """What is given of every spacecraft."""
    numbers: tuple[Symbol, ...]
    """What is the same for all."""
    features: tuple[Symbol, ...]
    """Inputs of the first layer."""
    layers: tuple[tuple[int, str], ...]
    """Units and activation of each."""
    outputs: tuple[Symbol, ...]
    """What the last layer computes."""
    results: tuple[Symbol, ...]
    """What becomes of it."""

    @property
    def sizes(self) -> list[int]:
        """Inputs of the first layer, and units of each."""
        return [len(self.features), *(units for units, _ in self.layers)]

    def write(
        self,
        code: Code,
        stride: Value,
        tiles: Value,
        columns: Value,
        numbers: Value,
        scratch: Value,
        out: Value,
        *weights: Value,
    ) -> None:
        """Print the network for one tile of `WIDTH` spacecraft after another.

        Args:
            code: to write into.
            stride: length of a row of columns and of results, in numbers.
            tiles: how many there are.
            columns: (columns, stride).
            numbers: (numbers,).
            scratch: rows of features and of all layers, for one tile.
            out: (results, stride).
            *weights: weight and bias of each layer.
        """
        sizes = self.sizes
        width = LONG(WIDTH)
        starts = [sum(sizes[:at]) * WIDTH for at in range(len(sizes))]

        def tile(number: Value, _: list[Value]) -> list[Value]:
            """Print one tile, in which every layer's outputs lie behind those of the one before."""
            first = code.mul(number, width)
            offsets = [code.add(first, LONG(v * LANES)) for v in range(TILE)]
            same = {
                symbol: code.everywhere(code.read(numbers, i, FLOAT))
                for i, symbol in enumerate(self.numbers)
            }
            vectors = [
                same
                | {
                    symbol: code.read(columns, code.add(code.mul(LONG(i), stride), offset))
                    for i, symbol in enumerate(self.columns)
                }
                for offset in offsets
            ]
            for v, values in enumerate(vectors):
                for i, value in enumerate(code.computed(self.features, values)):
                    code.write(value, scratch, i * WIDTH + v * LANES)
            for at, (units, activation) in enumerate(self.layers):
                shape = units, sizes[at]
                source, to = (code.at(scratch, start, FLOAT) for start in starts[at : at + 2])
                weight, bias = weights[2 * at : 2 * at + 2]
                dense_layer(code, shape, weight, bias, source, width, to, width, activation)
            for v, (offset, values) in enumerate(zip(offsets, vectors, strict=True)):
                for i, symbol in enumerate(self.outputs):
                    values[symbol] = code.read(scratch, starts[-1] + i * WIDTH + v * LANES)
                for i, value in enumerate(code.computed(self.results, values)):
                    code.write(value, out, code.add(code.mul(LONG(i), stride), offset))
            return []

        code.repeat(tiles, [], tile)


@lru_cache(64)
def network_code(network: NetworkCode) -> Callable[..., None]:
    """The function of a network, written once for all that are alike: that takes longer than hundreds of calls."""
    pointers = 4 + 2 * len(network.layers)
    return compiled((LONG, LONG, *(POINTER,) * pointers), network.write)[0]


class CompiledNetwork:
    """A network whose weights may change in place; sums are torch's to rounding.

    Args:
        network: what it computes.
        weights: weight (units, inputs) and bias (units,) of each layer, float32.
    """

    def __init__(self, network: NetworkCode, weights: Sequence[Sequence[np.ndarray]]) -> None:
        self._run = network_code(network)
        self._scratch = sum(network.sizes) * WIDTH
        self._results = len(network.results)
        self._weights = weights
        self._addresses = [_address(x) for pair in weights for x in pair]

    def __call__(self, columns: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Results (results, N) of columns (columns, N) and of numbers that are the same for all, float32."""
        count = columns.shape[1]
        padded = -(-count // WIDTH) * WIDTH
        if padded > count or not columns.flags.c_contiguous:
            columns, given = np.zeros((len(columns), padded), np.float32), columns
            columns[:, :count] = given
        scratch = np.empty(self._scratch, np.float32)
        out = np.empty((self._results, padded), np.float32)
        arrays = (columns, numbers, scratch, out)
        self._run(padded, padded // WIDTH, *map(_address, arrays), *self._addresses)
        return out[:, :count]


class CpuActorCritic:
    """Log-odds and values of a network, on/off thrusters and shared layers without memory.

    Args:
        architecture: its architecture.
        program: of its actor.
        tensors: its weights and statistics, which may change in place.
    """

    capabilities: ClassVar[Capabilities] = Capabilities(
        heads=("on-off",), memory=False, privileged_critic=False
    )

    def __init__(
        self, architecture: Architecture, program: NetworkProgram, tensors: Mapping[str, Tensor]
    ) -> None:
        tables = {name: x.detach().numpy() for name, x in tensors.items()}
        self._mean, self._variance, _ = (
            next(x for key, x in tables.items() if key.endswith(f".{name}"))
            for name in architecture.statistics()
        )
        self._zoom = np.float32(architecture.zoom)
        *trunk, actor, critic = (
            (x, tables[name.removesuffix("weight") + "bias"])
            for name, x in tables.items()
            if name.endswith(".weight")
        )
        # Actor and critic are one layer, whose weights are joined in every call.
        self._heads = list(zip(actor, critic, strict=True))
        self._joint = tuple(joined(*heads) for heads in self._heads)
        value = Symbol.input("value")
        units = (*architecture.layers, len(program.outputs) + 1)
        activations = (*[architecture.activation] * len(trunk), "")
        code = NetworkCode(
            program.observed,
            program.statistics,
            program.features,
            tuple(zip(units, activations, strict=True)),
            (*program.outputs, value),
            (*program.log_odds, value),
        )
        self._network = CompiledNetwork(code, [*trunk, self._joint])

    def __call__(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Log-odds (N, thrusters), in the order of the craft, and values (N,) of observations (N, width).

        Numbers are torch's to rounding (`tests/test_actor_critic.py`).
        """
        for joint, heads in zip(self._joint, self._heads, strict=True):
            joint[...] = joined(*heads)
        scale = 1.0 / np.sqrt(self._variance + np.float32(1e-6))
        statistics = np.concatenate((self._mean, scale, scale * self._zoom))
        columns = observation.to(torch.float32).numpy().T
        result = torch.from_numpy(self._network(columns, statistics))
        return result[:-1].T, result[-1]


def joined(actor: np.ndarray, critic: np.ndarray) -> np.ndarray:
    """Weights or biases of both heads: log-odds of a thruster are a difference of two outputs."""
    return np.concatenate((actor[1::2] - actor[0::2], critic))


def _address(x: np.ndarray) -> int:
    return x.__array_interface__["data"][0]  # three times as fast as its ctypes
