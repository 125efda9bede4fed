"""What a network in training says about observations on a CPU, as machine code: all in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from rans.compile.cpu.llvm import (
    FLOAT,
    LANES,
    LONG,
    OPERATIONS,
    POINTER,
    TILE,
    Code,
    Value,
    constant,
    shared,
)
from rans.compile.cpu.matmul import WIDTH, dense
from rans.compile.flight_program import shown
from rans.model.trace import Symbol, Untraceable, ordered
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.capabilities import Capabilities


class CpuActorCritic:
    """Log-odds and values of a network of one member, on/off thrusters and shared layers without memory.

    Args:
        given: its architecture.
        tensors: its weights and statistics, which may change.

    Raises:
        Untraceable: looking takes more than arithmetic.
    """

    capabilities: ClassVar[Capabilities] = Capabilities(
        heads=("on-off",), memory=False, privileged_critic=False
    )

    def __init__(self, given: Architecture, tensors: Mapping[str, Tensor]) -> None:
        self._given = given
        tables = {name: x.detach().numpy() for name, x in tensors.items()}
        self._mean, self._variance = (tables[EXTRACTOR + name] for name in ("mean", "variance"))
        self._heads = [
            (tables[f"action_net.{kind}"], tables[f"value_net.{kind}"])
            for kind in ("weight", "bias")
        ]
        self._trunk = [
            _address(tables[f"{EXTRACTOR}trunk.{2 * i}.{kind}"])
            for i in range(len(given.layers))
            for kind in ("weight", "bias")
        ]
        observed = [Symbol.input(f"observed_{i}") for i in range(given.layout.width)]
        _, self._seen, _, self._view = shown(given, observed)
        self._observed = observed
        self._inputs = given.seen * (2 if given.zoom else 1)
        self._sizes = [self._inputs, *given.layers, given.thrusters + 1]
        used = {symbol.operation for symbol in ordered([*self._seen, self._view]) if symbol.args}
        if unknown := used - OPERATIONS.keys():
            raise Untraceable(f"a look takes {', '.join(unknown)}.")

    @cached_property
    def _run(self) -> Callable[..., None]:
        """Not every network that may look does."""
        given = self._given
        arrays = 4 + 2 * len(self._sizes[1:])
        places = (
            None if given.symmetries is None else tuple(map(tuple, given.symmetries.place.tolist()))
        )
        # The same operations on the same fields are the same symbols.
        alike = (
            *self._sizes,
            given.activation,
            bool(given.zoom),
            given.clip,
            places,
            *self._seen,
            self._view,
        )
        return shared("look", alike, (LONG, LONG, *(POINTER,) * arrays), self._write)

    def __call__(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Log-odds (N, thrusters) and values (N,) of observations (N, width)."""
        columns = observation.to(torch.float32).numpy().T
        count = len(observation)
        padded = -(-count // WIDTH) * WIDTH
        if padded > count or not columns.flags.c_contiguous:
            columns, given = np.zeros((len(columns), padded), np.float32), columns
            columns[:, :count] = given
        scale = 1.0 / np.sqrt(self._variance + np.float32(1e-6))
        normal = np.concatenate((self._mean, scale, scale * np.float32(self._given.zoom)))
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
        found = torch.from_numpy(out[:, :count])
        return found[:-1].T, found[-1]

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
        given = self._given
        sizes = self._sizes
        width = LONG(WIDTH)
        starts = [sum(sizes[:at]) * WIDTH for at in range(len(sizes))]

        def tile(number: Value, _: list[Value]) -> list[Value]:
            first = code.mul(number, width)
            places = [code.add(first, LONG(v * LANES)) for v in range(TILE)]
            views = [
                self._looked(
                    code, observation, stride, place, normal, code.at(scratch, v * LANES, FLOAT)
                )
                for v, place in enumerate(places)
            ]
            for at, (inputs, units) in enumerate(pairwise(sizes)):
                source, to = (code.at(scratch, start, FLOAT) for start in starts[at : at + 2])
                weight, bias = weights[2 * at : 2 * at + 2]
                dense(
                    code,
                    (units, inputs),
                    weight,
                    bias,
                    source,
                    width,
                    to,
                    width,
                    given.activation if at < len(given.layers) else "",
                )
            for v, (place, view) in enumerate(zip(places, views, strict=True)):
                rows = [
                    code.read(scratch, starts[-1] + i * WIDTH + v * LANES) for i in range(sizes[-1])
                ]
                told = [*placed(code, given, rows[:-1], view), rows[-1]]
                for i, value in enumerate(told):
                    code.write(value, out, code.add(code.mul(LONG(i), stride), place))
            return []

        code.repeat(tiles, [], tile)

    def _looked(
        self, code: Code, observation: Value, stride: Value, place: Value, normal: Value, to: Value
    ) -> Value:
        """Write what the first layer is given of a vector of spacecraft; the sides they are seen from."""
        given = self._given
        width = self._given.seen
        known = {
            symbol: code.read(observation, code.add(code.mul(LONG(i), stride), place))
            for i, symbol in enumerate(self._observed)
        }
        *seen, view = code.evaluated([*self._seen, self._view], known)
        for i, value in enumerate(seen):
            mean, scale, zoomed = (
                code.everywhere(code.read(normal, i + k * width, FLOAT)) for k in range(3)
            )
            x = code.fmul(code.fsub(value, mean), scale)
            code.write(code.within(x, -given.clip, given.clip), to, i * WIDTH)
            if given.zoom:
                code.write(code.tanh(code.fmul(value, zoomed)), to, (width + i) * WIDTH)
        return view


def _address(x: np.ndarray) -> int:
    return x.__array_interface__["data"][0]  # three times as fast as its ctypes


def placed(code: Code, given: Architecture, values: Sequence[Value], view: Value) -> list[Value]:
    """Each thruster's, from where it is in the view that it was seen in."""
    if given.symmetries is None:
        return list(values)
    first, *others = given.symmetries.place
    chosen = [values[i] for i in first]
    for side, places in enumerate(others, 1):
        here = code.icmp_signed("==", view, constant(side))
        chosen = [code.select(here, values[i], old) for i, old in zip(places, chosen, strict=True)]
    return chosen
