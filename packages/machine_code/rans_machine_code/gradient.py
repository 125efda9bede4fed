"""Gradients of the PPO losses of a minibatch on a CPU, as machine code.

One function is printed for each network. It goes through a minibatch in tiles, whose activations fit a core's
cache: forward pass, losses and backward pass of a tile before the next. Gradients overwrite activations.
`tests/test_gradient.py` asks for autograd's gradients; equal trainings need a fixed order of sums.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.extend import (
    ACTIVATIONS,
    Adam,
    Batch,
    Capabilities,
    Network,
    Symbol,
    leaves,
)
from rans_machine_code.llvm import FLOAT, LANES, LONG, POINTER, Code, Value, compiled
from rans_machine_code.loss_gradient import STATISTICS, WITH_SLOPE, Loss, LossProgram
from rans_machine_code.matmul import (
    WIDTH,
    add_vector_sum,
    dense_layer,
    matrix_product,
    numbered_sums,
    row_correlations,
    row_sums,
)
from rans_machine_code.network import joined

_TILE = 512
"""Largest number of samples in a tile, whose activations fit the cache of a core."""
_SUPPORTED = Capabilities(
    heads=("on-off",),
    activations=WITH_SLOPE,
    privileged_critic=False,
)


class _Arguments(NamedTuple):
    """Arguments of the printed function: addresses of float32 arrays, then two whole numbers.

    Samples are the last axis of every array that has them, so that vectors hold consecutive samples.
    """

    inputs: Value
    """(inputs, samples) of the trunk."""
    action: Value
    """(thrusters, samples) zeros and ones."""
    log_prob: Value
    """(samples,) log-probability of the action under the rollout's policy."""
    advantage: Value
    """(samples,)."""
    target: Value
    """(samples,) target of the critic's value."""
    parameters: Value
    """Row of all parameters, as `Adam.row`."""
    gradient: Value
    """Row of their gradients, as `Adam.gradient`, to which those of the trunk are added."""
    head: Value
    """Weights and biases of both heads in one layer."""
    d_head: Value
    """Their gradients, to which is added."""
    activations: Value
    """Scratch memory for the outputs of all layers, (units, tile) each."""
    scalars: Value
    """1 / samples, then sums of the losses, to which is added."""
    tile: Value
    """Samples in a tile."""
    tiles: Value
    """Number of tiles."""


class _Layer(NamedTuple):
    """Sizes and addresses of a layer for one tile of samples."""

    inputs: int
    units: int
    weight: Value
    """(units, inputs)."""
    bias: Value
    """(units,)."""
    d_weight: Value
    """Gradient of the weight."""
    d_bias: Value
    """Gradient of the bias."""
    source: Value
    """Input of the layer, (inputs, tile); later the gradient before the activation that made it."""
    stride: Value
    """Stride of the rows of ``source``."""
    output: Value
    """Output of the layer, (units, tile); later its gradient."""


class GradientCode(NamedTuple):
    """The printed function: tile by tile forward pass, losses and backward pass."""

    sizes: tuple[int, ...]
    """Inputs of the first layer, and units of each."""
    activation: str
    offsets: tuple[tuple[int, ...], ...]
    """Places in the row of parameters where weight and bias of each trunk layer begin."""
    loss: LossProgram

    def write(self, code: Code, *values: Value) -> None:
        """Print the function, whose arguments are those of `_Arguments`.

        The order is fixed by memory: a backward pass overwrites the activations that the forward pass of its tile
        left.
        """
        arguments = _Arguments(*values)
        tile = arguments.tile
        sizes = self.sizes
        stride = code.mul(tile, arguments.tiles)

        # Addresses of weight, bias and their gradients of each layer, and of each layer's output.
        head_weights = sizes[-1] * sizes[-2]
        parameters = [
            *((arguments.parameters, arguments.gradient, offsets) for offsets in self.offsets),
            (arguments.head, arguments.d_head, (0, head_weights)),
        ]
        addresses = [
            [code.at(row, offset, FLOAT) for row in rows for offset in offsets]
            for *rows, offsets in parameters
        ]
        outputs = [
            code.at(arguments.activations, code.mul(tile, LONG(sum(sizes[1:layer]))), FLOAT)
            for layer in range(1, len(sizes))
        ]

        # Forward, losses and backward of one tile before the next, in the cache.
        def one_tile(number: Value, _: list[Value]) -> list[Value]:
            """Print forward pass, losses and backward pass of the tile with this number; gradients are added up."""
            first = code.mul(number, tile)
            sources = [
                (code.at(arguments.inputs, first, FLOAT), stride),
                *((output, tile) for output in outputs),
            ]
            layers = [
                _Layer._make((inputs, units, *parameters, *source, output))
                for inputs, units, parameters, source, output in zip(
                    sizes[:-1], sizes[1:], addresses, sources, outputs, strict=False
                )
            ]
            for layer in layers:
                self._forward(code, layer, tile, layer is layers[-1])
            per_sample = (
                arguments.action,
                arguments.log_prob,
                arguments.advantage,
                arguments.target,
            )
            samples = [code.at(array, first, FLOAT) for array in per_sample]
            self._losses(code, samples, stride, outputs[-1], arguments.scalars, tile)
            for layer in reversed(layers):
                self._backward(code, layer, tile, layer is layers[0])
            return []

        code.repeat(arguments.tiles, [], one_tile)

    def _forward(self, code: Code, layer: _Layer, tile: Value, is_last: bool) -> None:
        """Print the outputs of a layer for a tile, `WIDTH` samples at a time; the last has no activation.

        They stay where they are until `_backward` writes gradients over them.
        """

        def block(number: Value, _: list[Value]) -> list[Value]:
            """Print a layer's outputs for `WIDTH` columns of the tile."""
            begin = code.mul(number, LONG(WIDTH))
            dense_layer(
                code,
                (layer.units, layer.inputs),
                layer.weight,
                layer.bias,
                code.at(layer.source, begin, FLOAT),
                layer.stride,
                code.at(layer.output, begin, FLOAT),
                tile,
                "" if is_last else self.activation,
            )
            return []

        code.repeat(code.udiv(tile, LONG(WIDTH)), [], block)

    def _losses(
        self,
        code: Code,
        samples: Sequence[Value],
        stride: Value,
        outputs: Value,
        scalars: Value,
        tile: Value,
    ) -> None:
        """Print the losses of a tile, `LANES` samples at a time.

        Args:
            code: of the function.
            samples: addresses of the tile's actions, log-probabilities, advantages and targets.
            stride: stride of the rows of the actions.
            outputs: the heads' outputs, which are overwritten by their gradients.
            scalars: 1 / samples; sums of the losses behind it are added to.
            tile: samples in the tile.
        """
        action, *given = samples
        loss = self.loss
        per_sample = code.everywhere(code.read(scalars, 0, FLOAT))
        zero = code.everywhere(0.0)

        def vector(number: Value, sums: list[Value]) -> list[Value]:
            """Print the losses of `LANES` transitions, add them to the sums, and overwrite outputs by gradients.

            Sums stay in registers, one vector each, and are written after the tile's last transition.
            """
            first = code.mul(number, LONG(LANES))
            rows = [code.add(first, code.mul(tile, LONG(i))) for i in range(self.sizes[-1])]
            values = {x: code.read(outputs, row) for x, row in zip(loss.outputs, rows, strict=True)}
            for i, x in enumerate(loss.commands):
                values[x] = code.read(action, code.add(first, code.mul(stride, LONG(i))))
            values |= {
                x: code.read(place, first) for x, place in zip(loss.given, given, strict=True)
            }
            # Derivatives of the mean over the minibatch, and losses.
            found = code.computed(loss.roots, values)
            for row, derivative in zip(rows, found, strict=False):
                code.write(code.fmul(derivative, per_sample), outputs, row)
            return [code.fadd(old, new) for old, new in zip(sums, found[len(rows) :], strict=True)]

        sums = code.repeat(code.udiv(tile, LONG(LANES)), [zero] * STATISTICS, vector)
        for i, value in enumerate(sums):
            add_vector_sum(code, value, scalars, LONG(1 + i))

    def _backward(self, code: Code, layer: _Layer, tile: Value, is_first: bool) -> None:
        """Print the gradients of a layer's parameters and, but for the first layer, of its inputs.

        The layer's ``output`` holds the derivatives by its sums, as the layer after it, or the losses, have left
        them.
        """
        # Gradients of weight and bias: sums over the tile's samples.
        vectors = code.udiv(tile, LONG(LANES))
        row_correlations(
            code,
            (layer.units, layer.inputs),
            layer.output,
            tile,
            layer.source,
            layer.stride,
            vectors,
            layer.d_weight,
        )
        row_sums(code, layer.units, layer.output, tile, vectors, layer.d_bias)
        if is_first:
            return

        # Gradients of the inputs, which take the place of the activations that they were.

        def block(number: Value, _: list[Value]) -> list[Value]:
            """Print the gradients of a layer's inputs for `WIDTH` columns, in place of the inputs themselves."""
            begin = code.mul(number, LONG(WIDTH))

            def finish(first: Value, sums: list[Sequence[Value]]) -> None:
                """Print what turns sums of rows from the first on into gradients before the activation."""
                for u, v, value in numbered_sums(sums):
                    row = code.mul(code.add(first, LONG(u)), tile)
                    position = code.add(row, code.add(begin, LONG(v * LANES)))
                    activation = code.read(layer.source, position)
                    code.write(
                        self._before_activation(code, value, activation), layer.source, position
                    )

            matrix_product(
                code,
                (layer.inputs, layer.units),
                layer.weight,
                (1, layer.inputs),
                code.at(layer.output, begin, FLOAT),
                tile,
                finish,
            )
            return []

        code.repeat(code.udiv(tile, LONG(WIDTH)), [], block)

    def _before_activation(self, code: Code, gradient: Value, activation: Value) -> Value:
        """Gradient before an activation function, from that after it and the function's value."""
        slope = ACTIVATIONS[self.activation].slope
        assert slope is not None
        return code.fmul(gradient, _printed(code, slope, activation)[0])


@lru_cache(64)
def gradient_code(code: GradientCode) -> Callable[..., None]:
    """The function, written once for all networks that are alike: that takes longer than hundreds of calls."""
    return compiled((POINTER,) * 11 + (LONG, LONG), code.write)[0]


def gradient(network: Network, adam: Adam, loss: Loss, samples: int) -> CpuGradient | None:
    """Gradients of minibatches of ``samples`` transitions; None for networks that it does not support.

    Thrusters must be on/off, and actor and critic share float32 layers.
    """
    tensor = next(iter(network.tensors.values()))
    supported = tensor.dtype == torch.float32 and samples % WIDTH == 0
    supported = supported and not _SUPPORTED.missing(network.architecture)
    return CpuGradient(network, adam, loss) if supported else None


class CpuGradient:
    """Gradients of minibatches on a CPU, written into its `Adam.gradient`.

    `rans_machine_code.cuda.gradient` has its counterpart on a GPU.

    Args:
        network: see `gradient`.
        adam: optimizer, whose `row` and `gradient` keep their addresses.
        loss: of a transition.
    """

    description: ClassVar[str] = "machine code"

    def __init__(self, network: Network, adam: Adam, loss: Loss) -> None:
        self._network = network
        self._adam = adam
        architecture = network.architecture
        tensors = network.tensors
        *trunk, actor, critic = (
            name.removesuffix(".weight") for name in network.learnt if name.endswith(".weight")
        )
        offsets = tuple(
            tuple(int(tensors[f"{name}.{kind}"].storage_offset()) for kind in ("weight", "bias"))
            for name in trunk
        )
        length = tensors[f"{trunk[0]}.weight"].shape[1]
        self._sizes = (length, *architecture.layers, architecture.thrusters + 1)
        # Both heads are one layer: a thruster's logit is the difference of the actor's outputs for open and shut.
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
        program = LossProgram.of(architecture.thrusters, loss)
        self._run = gradient_code(
            GradientCode(self._sizes, architecture.activation, offsets, program)
        )

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of the trunk (N, inputs) from columns (N, k) and a history; they are the same in every epoch."""
        return self._network.inputs(seen, memory)

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and statistics, () each, of a minibatch whose memory are the `inputs`.

        The gradient is written into `Adam.gradient`, which is cleared before. Samples are summed tile by tile:
        another size of tiles is another training in its last bits.
        """
        assert part.memory is not None
        # The largest tile that divides the minibatch, and arrays in the order of `_Arguments`.
        count = len(part.memory)
        tile = next(size for size in range(min(_TILE, count), 0, -WIDTH) if count % size == 0)
        activations = np.empty(sum(self._sizes[1:]) * tile, np.float32)
        scalars = np.zeros(1 + STATISTICS, np.float32)
        scalars[0] = 1 / count
        tensors = (
            part.memory.T.contiguous(),
            part.action.T.contiguous(),
            part.log_prob,
            part.advantage,
            part.target,
            self._adam.row,
            self._adam.gradient.zero_(),
        )
        # Weights of the joint head, from those of actor and critic.
        for joint, (actor, critic) in zip(self._parts(self._head), self._heads, strict=True):
            joint[...] = joined(actor, critic)
        self._d_head.fill(0.0)
        self._run(
            *(x.data_ptr() for x in tensors),
            self._head.ctypes.data,
            self._d_head.ctypes.data,
            activations.ctypes.data,
            scalars.ctypes.data,
            tile,
            count // tile,
        )
        # Gradients of actor and critic, from those of the joint head.
        for joint, (actor, critic) in zip(self._parts(self._d_head), self._d_heads, strict=True):
            actor[1::2] = joint[:-1]
            actor[0::2] = -joint[:-1]
            critic[...] = joint[-1:]
        return torch.from_numpy(scalars[1:] * scalars[0]).unbind()

    def _parts(self, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Views of the joint head's weights (heads, features) and biases (heads,)."""
        weight, bias = np.split(head, [self._sizes[-1] * self._sizes[-2]])
        return weight.reshape(self._sizes[-1], -1), bias


def _printed(code: Code, function: Callable[..., Any], *values: Value) -> list[Value]:
    """Print a function of fields for vectors of samples; its results in order, as `leaves` lists them."""
    inputs = [Symbol.input(f"x{k}") for k in range(len(values))]
    roots = leaves(function(*inputs))
    return code.computed(roots, dict(zip(inputs, values, strict=True)))
