"""Forward pass of an actor and a critic in training as machine code for a CPU, in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from rans.extend import Architecture, Capabilities, Symbol, ordered
from rans.model.operations import Untraceable
from rans.policy.architecture import EXTRACTOR
from rans.policy.program import inputs
from rans.policy.scalars import symbols
from rans.policy.traced import policy_program
from rans_machine_code.dialect import LLVM
from rans_machine_code.llvm import (
    FLOAT,
    LANES,
    LONG,
    POINTER,
    TILE,
    Code,
    Value,
    shared,
)
from rans_machine_code.matmul import WIDTH, dense_layer


class CpuActorCritic:
    """Log-odds and values of a network, on/off thrusters and shared layers without memory.

    Args:
        architecture: its architecture.
        tensors: its weights and statistics, which may change.

    Raises:
        Untraceable: the features take more than arithmetic.
    """

    capabilities: ClassVar[Capabilities] = Capabilities(
        heads=("on-off",), memory=False, privileged_critic=False
    )

    def __init__(self, architecture: Architecture, tensors: Mapping[str, Tensor]) -> None:
        # Optimizers change weights in place, so that the addresses of the trunk's layers that are taken here stay
        # valid.
        self._architecture = architecture
        # Statistics, heads and layers, which stay views of the tensors.
        tables = {name: x.detach().numpy() for name, x in tensors.items()}
        self._mean, self._variance = (tables[EXTRACTOR + name] for name in ("mean", "variance"))
        self._heads = [
            (tables[f"action_net.{kind}"], tables[f"value_net.{kind}"])
            for kind in ("weight", "bias")
        ]
        self._trunk = [
            _address(tables[f"{EXTRACTOR}trunk.{2 * i}.{kind}"])
            for i in range(len(architecture.layers))
            for kind in ("weight", "bias")
        ]
        # The policy's program as symbols: features of an observation, and log-odds of the layers' outputs.
        self._observed = inputs("observed", architecture.layout.width)
        values, (stage,) = symbols(
            policy_program(architecture), {"observation": self._observed}, ["shown", "placed_0"]
        )
        self._features = values["shown"]
        self._log_odds = values["placed_0"]
        """In the order of the spacecraft's thrusters."""
        self._outputs = stage.outputs
        self._sizes = [architecture.inputs, *architecture.layers, architecture.thrusters + 1]
        for symbol in ordered([*self._features, *self._log_odds]):
            if symbol.args and (symbol.operation, symbol.operand_kind) not in LLVM:
                raise Untraceable(f"the policy takes {symbol.operation} of its columns.")

    @cached_property
    def _run(self) -> Callable[..., None]:
        """Machine code of the forward pass, written when it is first called.

        All that `_write` prints from must be in the key: networks that differ in anything else would share wrong
        code.
        """
        architecture = self._architecture
        arrays = 4 + 2 * len(self._sizes[1:])
        # The same operations on the same fields are the same symbols.
        alike = (
            *self._sizes,
            architecture.activation,
            *self._features,
            *self._log_odds,
        )
        return shared("look", alike, (LONG, LONG, *(POINTER,) * arrays), self._write)

    def __call__(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Log-odds (N, thrusters) and values (N,) of observations (N, width).

        Statistics and heads are copied in every call; numbers are torch's to rounding
        (`tests/test_actor_critic.py`).
        """
        columns = observation.to(torch.float32).numpy().T
        count = len(observation)
        padded = -(-count // WIDTH) * WIDTH
        if padded > count or not columns.flags.c_contiguous:
            columns, arguments = np.zeros((len(columns), padded), np.float32), columns
            columns[:, :count] = arguments
        scale = 1.0 / np.sqrt(self._variance + np.float32(1e-6))
        normal = np.concatenate((self._mean, scale, scale * np.float32(self._architecture.zoom)))
        # Log-odds of a thruster are a difference of two outputs.
        heads = [
            np.concatenate((actor[1::2] - actor[0::2], critic)) for actor, critic in self._heads
        ]
        scratch = np.empty((sum(self._sizes), WIDTH), np.float32)
        out = np.empty((self._sizes[-1], padded), np.float32)
        self._run(
            padded,
            padded // WIDTH,
            *map(_address, (columns, normal, scratch, out)),
            *self._trunk,
            *map(_address, heads),
        )
        result = torch.from_numpy(out[:, :count])
        return result[:-1].T, result[-1]

    def _write(
        self,
        code: Code,
        stride: Value,
        tiles: Value,
        observation: Value,
        normal: Value,
        scratch: Value,
        out: Value,
        *weights: Value,
    ) -> None:
        """Write the forward pass of all tiles of observations.

        Args:
            code: to write into.
            stride: length of a row of observations and of results, in numbers.
            tiles: number of tiles of `WIDTH` observations.
            observation: (columns, stride).
            normal: mean, scale and zoomed scale of the columns.
            scratch: rows of features and of all layers, for one tile.
            out: (log-odds and value, stride).
            *weights: weight and bias of each layer, those of both heads joined last.
        """
        architecture = self._architecture
        sizes = self._sizes
        width = LONG(WIDTH)
        starts = [sum(sizes[:at]) * WIDTH for at in range(len(sizes))]

        def tile(number: Value, _: list[Value]) -> list[Value]:
            """Print both networks for tile ``number``: `WIDTH` columns, by way of ``scratch``.

            Every layer's outputs lie behind those of the one before, from `starts`: `__call__` allocates the
            scratch memory so.
            """
            first = code.mul(number, width)
            offsets = [code.add(first, LONG(v * LANES)) for v in range(TILE)]
            # Features of the tile, from observations, into the first rows of the scratch memory.
            vectors = [self._read(code, observation, stride, offset, normal) for offset in offsets]
            for v, values in enumerate(vectors):
                for i, symbol in enumerate(self._features):
                    (value,) = code.extended([symbol], values)
                    code.write(value, scratch, i * WIDTH + v * LANES)
            # Layers of actor and critic, each behind the rows of the one before.
            for at, (length, units) in enumerate(pairwise(sizes)):
                source, to = (code.at(scratch, start, FLOAT) for start in starts[at : at + 2])
                weight, bias = weights[2 * at : 2 * at + 2]
                dense_layer(
                    code,
                    (units, length),
                    weight,
                    bias,
                    source,
                    width,
                    to,
                    width,
                    architecture.activation if at < len(architecture.layers) else "",
                )
            # Log-odds in the order of the craft's thrusters, and the value, as the result.
            for v, (offset, values) in enumerate(zip(offsets, vectors, strict=True)):
                *rows, worth = [
                    code.read(scratch, starts[-1] + i * WIDTH + v * LANES) for i in range(sizes[-1])
                ]
                values |= dict(zip(self._outputs, rows, strict=True))
                for i, value in enumerate([*code.extended(self._log_odds, values), worth]):
                    code.write(value, out, code.add(code.mul(LONG(i), stride), offset))
            return []

        code.repeat(tiles, [], tile)

    def _read(
        self, code: Code, observation: Value, stride: Value, offset: Value, normal: Value
    ) -> dict[Symbol, Value]:
        """Vectors of what is observed, and of the statistics that it is normalised by.

        The statistics lie in the order in which `__call__` concatenates them.
        """
        width = self._architecture.column_count
        values = {
            symbol: code.read(observation, code.add(code.mul(LONG(i), stride), offset))
            for i, symbol in enumerate(self._observed)
        }
        for k, name in enumerate(("mean", "scale", "zoom")):
            for i, symbol in enumerate(inputs(name, width)):
                values[symbol] = code.everywhere(code.read(normal, i + k * width, FLOAT))
        return values


def _address(x: np.ndarray) -> int:
    return x.__array_interface__["data"][0]  # three times as fast as its ctypes
