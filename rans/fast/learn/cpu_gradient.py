"""Gradients of the PPO losses of a minibatch on a CPU, as machine code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.compile.cpu.llvm import FLOAT, LANES, LONG, POINTER, Code, Value, shared
from rans.compile.cpu.matmul import WIDTH, correlation, dense, each, gather, product, row_sums
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import Coefficients
from rans.fast.learn.rollout import Batch
from rans.policy.activations import WITH_SLOPE
from rans.policy.capabilities import Capabilities
from rans.policy.network import Network

_TILE = 512
"""Largest number of samples whose activations fit the cache of a core."""
_GIVEN = 4
_SUMS = 5
"""Number of inputs and of sums of the losses."""


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
        numbers = np.zeros(_GIVEN + _SUMS, np.float32)
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
        """As `rans.fast.learn.ppo.losses`: outputs become their gradients, statistics are added."""
        action, log_prob, advantage, target = samples
        clip, weight, bonus, share = (
            code.everywhere(code.read(numbers, i, FLOAT)) for i in range(_GIVEN)
        )
        zero, one, two = (code.everywhere(float(i)) for i in range(3))

        def vector(number: Value, sums: list[Value]) -> list[Value]:
            place = code.mul(number, LONG(LANES))
            rows = [code.add(place, code.mul(tile, LONG(i))) for i in range(self._sizes[-1])]
            commands = [
                code.read(action, code.add(place, code.mul(stride, LONG(i))))
                for i in range(self._thrusters)
            ]
            logits = [code.read(outputs, row) for row in rows[:-1]]
            # Log-probability and entropy of the actions: e^-|l| gives log(1 + e^l) and its slope.
            change = code.fneg(code.read(log_prob, place))
            chaos = zero
            opening = list[Value]()
            for logit, chosen in zip(logits, commands, strict=True):
                positive = code.fcmp_ordered(">", logit, zero)
                size = code.select(positive, logit, code.fneg(logit))
                small = code.exp(code.fneg(size))
                beyond = code.log_one_plus(small)
                opened = code.fdiv(code.select(positive, one, small), code.fadd(one, small))
                softplus = code.fadd(code.select(positive, logit, zero), beyond)
                change = code.fadd(change, code.fsub(code.fmul(chosen, logit), softplus))
                chaos = code.fadd(chaos, code.fsub(softplus, code.fmul(logit, opened)))
                opening.append(opened)
            # Clipped surrogate objective.
            ratio = code.exp(change)
            gains = code.read(advantage, place)
            low = code.fsub(one, clip)
            high = code.fadd(one, clip)
            inside = code.select(code.fcmp_ordered("<", ratio, low), low, ratio)
            inside = code.select(code.fcmp_ordered(">", inside, high), high, inside)
            gain = code.fmul(gains, ratio)
            clipped = code.fmul(gains, inside)
            counts = code.fcmp_ordered("<=", gain, clipped)
            slope = code.fmul(code.select(counts, code.fneg(gain), zero), share)
            for row, logit, chosen, opened in zip(rows, logits, commands, opening, strict=False):
                random = code.fmul(
                    code.fmul(logit, opened),
                    code.fmul(code.fsub(one, opened), code.fmul(bonus, share)),
                )
                code.write(code.times_plus(slope, code.fsub(chosen, opened), random), outputs, row)
            error = code.fsub(code.read(outputs, rows[-1]), code.read(target, place))
            code.write(
                code.fmul(error, code.fmul(code.fmul(two, weight), share)), outputs, rows[-1]
            )
            past = code.fsub(ratio, one)
            off = code.select(code.fcmp_ordered(">", past, zero), past, code.fneg(past))
            far = code.fcmp_ordered(">", off, clip)
            result = (
                code.fneg(code.select(counts, gain, clipped)),
                code.fmul(error, error),
                code.fneg(chaos),
                code.fsub(past, change),
                code.select(far, one, zero),
            )
            return [code.fadd(old, new) for old, new in zip(sums, result, strict=True)]

        for i, value in enumerate(
            code.repeat(code.udiv(tile, LONG(LANES)), [zero] * _SUMS, vector)
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
        one = code.everywhere(1.0)
        if self._activation == "tanh":
            return code.fmul(gradient, code.fsub(one, code.fmul(value, value)))
        zero = code.everywhere(0.0)
        below = zero if self._activation == "relu" else code.fmul(gradient, code.fadd(value, one))
        return code.select(code.fcmp_ordered(">", value, zero), gradient, below)

    def _parts(self, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights (heads, features) and biases (heads,)."""
        weight, bias = np.split(head, [self._sizes[-1] * self._sizes[-2]])
        return weight.reshape(self._sizes[-1], -1), bias
