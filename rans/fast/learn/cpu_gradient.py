"""Gradients of the PPO losses of a minibatch on a CPU, as machine code."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.compile.cpu.llvm import FLOAT, LANES, LONG, POINTER, Code, Value, shared
from rans.compile.cpu.matmul import WIDTH, correlation, dense, each, gather, product, row_sums
from rans.compile.loss_gradient import (
    STATISTICS,
    Choice,
    choice,
    d_logit,
    transition_losses,
)
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import Coefficients
from rans.fast.learn.rollout import Batch
from rans.model.fields import leaves
from rans.model.trace import Symbol
from rans.policy.activations import ACTIVATIONS, WITH_SLOPE
from rans.policy.capabilities import Capabilities
from rans.policy.network import Network

_TILE = 512
"""Largest number of samples whose activations fit the cache of a core."""
_GIVEN = 4
"""Number of inputs of the losses: three coefficients, and the share of a sample in the mean."""

_CAN = Capabilities(heads=("on-off",), activations=WITH_SLOPE, privileged_critic=False)


class _Layer(NamedTuple):
    """Sizes and addresses of a layer for a tile of samples."""

    inputs: int
    units: int
    weight: Value
    bias: Value
    d_weight: Value
    d_bias: Value
    source: Value
    stride: Value
    """Stride of the rows of the source."""
    to: Value
    """Output of the layer, and later its gradient."""


class CpuGradient:
    """Gradients of minibatches of one member on a CPU, written into its `Adam.gradient`.

    `rans.fast.learn.fused_gradient` is its counterpart on a GPU.

    Args:
        network: network for which `fits` is true.
        adam: optimizer, whose `row` and `gradient` keep their addresses.
        coefficients: coefficients of the losses.
    """

    description: ClassVar[str] = "machine code"

    def __init__(self, network: Network, adam: Adam, coefficients: Coefficients) -> None:
        self._network = network
        self._adam = adam
        self._coefficients = [
            x.numpy()
            for x in (coefficients.clip_range, coefficients.vf_coef, coefficients.ent_coef)
        ]
        architecture = network.architecture
        tensors = network.tensors
        self._activation = architecture.activation
        self._thrusters = architecture.thrusters
        *trunk, actor, critic = (
            name.removesuffix(".weight") for name in network.learnt if name.endswith(".weight")
        )
        self._places = [
            [tensors[f"{name}.{kind}"].storage_offset() for kind in ("weight", "bias")]
            for name in trunk
        ]
        self._sizes = [
            tensors[f"{trunk[0]}.weight"].shape[1],
            *architecture.layers,
            architecture.thrusters + 1,
        ]
        # Both heads in one: the logit of a thruster is the difference of two outputs.
        length = self._sizes[-1] * (self._sizes[-2] + 1)
        self._head = np.zeros(length, np.float32)
        self._d_head = np.zeros(length, np.float32)
        heads = [
            [tensors[f"{name}.{kind}"].detach() for name in (actor, critic)]
            for kind in ("weight", "bias")
        ]
        self._heads = [[x.numpy() for x in pair] for pair in heads]
        self._d_heads = [
            [
                adam.gradient.as_strided(x.shape, x.stride(), x.storage_offset()).numpy()
                for x in pair
            ]
            for pair in heads
        ]
        alike = (
            *self._sizes,
            self._activation,
            *(place for pair in self._places for place in pair),
        )
        self._run = shared("update", alike, (POINTER,) * 11 + (LONG, LONG), self._write)

    @staticmethod
    def fits(network: Network, samples: int) -> bool:
        """Whether the network and minibatches of ``samples`` transitions are supported.

        Thrusters must be on/off, and actor and critic share float32 layers without recurrent memory.
        """
        architecture = network.architecture
        one = next(iter(network.tensors.values()))
        return (
            one.device.type == "cpu"
            and one.dtype == torch.float32
            and network.members == 1
            and samples % WIDTH == 0
            and not _CAN.missing(architecture)
        )

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of the trunk (N, inputs) from columns (N, k) and a history, the same in every epoch."""
        return self._network.inputs(seen, memory)

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and statistics, (1,) each, of a minibatch whose memory are the `inputs`."""
        assert part.memory is not None
        count = len(part.memory)
        tile = next(size for size in range(min(_TILE, count), 0, -WIDTH) if count % size == 0)
        scratch = np.empty(sum(self._sizes[1:]) * tile, np.float32)
        numbers = np.zeros(_GIVEN + STATISTICS, np.float32)
        numbers[:_GIVEN] = *(x[0] for x in self._coefficients), 1 / count
        tensors = (
            part.memory.T.contiguous(),
            part.action.T.contiguous(),
            part.log_prob,
            part.advantage,
            part.target,
            self._adam.row,
            self._adam.gradient.zero_(),
        )
        for to, (actor, critic) in zip(self._parts(self._head), self._heads, strict=True):
            np.subtract(actor[1::2], actor[0::2], out=to[:-1])
            to[-1:] = critic
        self._d_head.fill(0.0)
        self._run(
            *(x.data_ptr() for x in tensors),
            self._head.ctypes.data,
            self._d_head.ctypes.data,
            scratch.ctypes.data,
            numbers.ctypes.data,
            tile,
            count // tile,
        )
        for found, (actor, critic) in zip(self._parts(self._d_head), self._d_heads, strict=True):
            actor[1::2] = found[:-1]
            actor[0::2] = -found[:-1]
            critic[...] = found[-1:]
        surrogate, value, entropy, *rest = numbers[_GIVEN:] * numbers[_GIVEN - 1]
        loss = surrogate + numbers[1] * value + numbers[2] * entropy
        return torch.from_numpy(np.array([loss, surrogate, value, entropy, *rest])).split(1)

    # The function: tile by tile forward, losses, and backward in the place of the activations.

    def _write(
        self,
        code: Code,
        x: Value,
        action: Value,
        log_prob: Value,
        advantage: Value,
        target: Value,
        row: Value,
        gradient: Value,
        head: Value,
        d_head: Value,
        scratch: Value,
        numbers: Value,
        tile: Value,
        tiles: Value,
    ) -> None:
        sizes = self._sizes
        stride = code.mul(tile, tiles)
        width = sizes[-1] * sizes[-2]
        wheres = [*((row, gradient, place) for place in self._places), (head, d_head, (0, width))]
        arrays = [
            [code.at(of, at, FLOAT) for of in pair for at in place] for *pair, place in wheres
        ]
        outputs = [
            code.at(scratch, code.mul(tile, LONG(sum(sizes[1:at]))), FLOAT)
            for at in range(1, len(sizes))
        ]

        def one(number: Value, _: list[Value]) -> list[Value]:
            first = code.mul(number, tile)
            sources = [(code.at(x, first, FLOAT), stride), *((output, tile) for output in outputs)]
            layers = [
                _Layer._make((inputs, units, *each, *source, to))
                for inputs, units, each, source, to in zip(
                    sizes[:-1], sizes[1:], arrays, sources, outputs, strict=False
                )
            ]
            for layer in layers:
                self._forward(code, layer, tile, layer is layers[-1])
            samples = [code.at(of, first, FLOAT) for of in (action, log_prob, advantage, target)]
            self._losses(code, samples, stride, outputs[-1], numbers, tile)
            for layer in reversed(layers):
                self._backward(code, layer, tile, layer is layers[0])
            return []

        code.repeat(tiles, [], one)

    def _forward(self, code: Code, layer: _Layer, tile: Value, last: bool) -> None:
        def block(number: Value, _: list[Value]) -> list[Value]:
            begin = code.mul(number, LONG(WIDTH))
            dense(
                code,
                (layer.units, layer.inputs),
                layer.weight,
                layer.bias,
                code.at(layer.source, begin, FLOAT),
                layer.stride,
                code.at(layer.to, begin, FLOAT),
                tile,
                "" if last else self._activation,
            )
            return []

        code.repeat(code.udiv(tile, LONG(WIDTH)), [], block)

    def _losses(
        self,
        code: Code,
        samples: Sequence[Value],
        stride: Value,
        outputs: Value,
        numbers: Value,
        tile: Value,
    ) -> None:
        """Outputs become their gradients, statistics are added; see `rans.compile.loss_gradient`."""
        action, log_prob, advantage, target = samples
        clip_range, vf_coef, ent_coef, share = (
            code.everywhere(code.read(numbers, i, FLOAT)) for i in range(_GIVEN)
        )
        zero = code.everywhere(0.0)

        def vector(number: Value, sums: list[Value]) -> list[Value]:
            place = code.mul(number, LONG(LANES))
            rows = [code.add(place, code.mul(tile, LONG(i))) for i in range(self._sizes[-1])]
            *logits, value = [code.read(outputs, row) for row in rows]
            commands = [
                code.read(action, code.add(place, code.mul(stride, LONG(i))))
                for i in range(self._thrusters)
            ]
            # Log-probability and entropy of the actions.
            choices = [
                Choice(*_printed(code, choice, *both))
                for both in zip(logits, commands, strict=True)
            ]
            log_probs, entropies = (
                functools.reduce(code.fadd, each) for each in list(zip(*choices, strict=True))[:2]
            )
            # Losses, and derivatives of the mean over the minibatch.
            d_log_prob, d_value, *losses = _printed(
                code,
                transition_losses,
                log_probs,
                entropies,
                value,
                code.read(log_prob, place),
                code.read(advantage, place),
                code.read(target, place),
                clip_range,
                vf_coef,
            )
            for row, logit, command, one in zip(rows, logits, commands, choices, strict=False):
                (derivative,) = _printed(
                    code, d_logit, logit, command, one.opening, d_log_prob, ent_coef
                )
                code.write(code.fmul(derivative, share), outputs, row)
            code.write(code.fmul(d_value, share), outputs, rows[-1])
            return [code.fadd(old, new) for old, new in zip(sums, losses, strict=True)]

        for i, value in enumerate(
            code.repeat(code.udiv(tile, LONG(LANES)), [zero] * STATISTICS, vector)
        ):
            gather(code, value, numbers, LONG(_GIVEN + i))

    def _backward(self, code: Code, layer: _Layer, tile: Value, first_of_all: bool) -> None:
        vectors = code.udiv(tile, LONG(LANES))
        correlation(
            code,
            (layer.units, layer.inputs),
            layer.to,
            tile,
            layer.source,
            layer.stride,
            vectors,
            layer.d_weight,
        )
        row_sums(code, layer.units, layer.to, tile, vectors, layer.d_bias)
        if first_of_all:
            return

        def block(number: Value, _: list[Value]) -> list[Value]:
            begin = code.mul(number, LONG(WIDTH))

            def finish(first: Value, sums: list[Sequence[Value]]) -> None:
                for u, v, value in each(sums):
                    row = code.mul(code.add(first, LONG(u)), tile)
                    place = code.add(row, code.add(begin, LONG(v * LANES)))
                    code.write(
                        self._before(code, value, code.read(layer.source, place)),
                        layer.source,
                        place,
                    )

            product(
                code,
                (layer.inputs, layer.units),
                layer.weight,
                (1, layer.inputs),
                code.at(layer.to, begin, FLOAT),
                tile,
                finish,
            )
            return []

        code.repeat(code.udiv(tile, LONG(WIDTH)), [], block)

    def _before(self, code: Code, gradient: Value, value: Value) -> Value:
        """Gradient before an activation, from that after it and the value of the activation."""
        slope = ACTIVATIONS[self._activation].slope
        assert slope is not None
        return code.fmul(gradient, _printed(code, slope, value)[0])

    def _parts(self, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights (heads, features) and biases (heads,)."""
        weight, bias = np.split(head, [self._sizes[-1] * self._sizes[-2]])
        return weight.reshape(self._sizes[-1], -1), bias


def _printed(code: Code, function: Callable[..., Any], *values: Value) -> list[Value]:
    """Vectors of a function of fields, from those of its arguments."""
    inputs = [Symbol.input(f"x{k}") for k in range(len(values))]
    roots = leaves(function(*inputs))
    return code.evaluated(roots, dict(zip(inputs, values, strict=True)))
