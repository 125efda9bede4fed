"""Gradients of the PPO losses without autograd, for GPUs with bfloat16 products (docs/decisions/engine.md).

They are computed in matrix products, forward and backward.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from typing import ClassVar

import torch
from torch import Tensor

from rans.extend import (
    EXTRACTOR,
    Adam,
    Batch,
    Capabilities,
    Network,
)
from rans_machine_code.cuda.design import padded, up
from rans_machine_code.cuda.update import UpdateKernels
from rans_machine_code.loss_gradient import WITH_SLOPE, Loss

_ALIGNED = 16
"""Multiple to which inputs and outputs are padded, as fast products of bfloat16 need; presets have such layers."""


class MatrixGradient:
    """Gradients of minibatches on a GPU in matrix products, of networks with two layers.

    They are written into an `Adam.gradient` without synchronisation. A critic of its own lies beside the policy:
    the units of both are one first layer, each has a second layer, and heads have no weights of the other's units.

    Args:
        network: network for which `fits` is true.
        adam: optimizer, whose `gradient` keeps its address.
        loss: of a transition.
    """

    description: ClassVar[str] = "products of matrices"

    @staticmethod
    def fits(network: Network) -> bool:
        """Whether these are gradients of such a network: two layers of known slopes, and on/off thrusters.

        Units are read by eights.
        """
        architecture = network.architecture
        can = Capabilities(heads=("on-off",), activations=WITH_SLOPE)
        units = architecture.layers
        return not can.missing(architecture) and len(units) == 2 and not any(x % 8 for x in units)

    def __init__(self, network: Network, adam: Adam, loss: Loss) -> None:
        architecture = network.architecture
        self._network = network
        self._adam = adam
        self._trunks = [f"{EXTRACTOR}{name}" for name in ("trunk", "critic")]
        self._trunks = self._trunks[: 2 if architecture.privileged else 1]
        self._columns = architecture.inputs + architecture.privileged
        """Width of the observed columns and memory, followed by what only the critic is told."""
        self._inputs = up(self._columns + 1, _ALIGNED)
        """Width of the inputs of products: these columns, a one whose weights are the biases, and zeros."""
        self._heads = up(architecture.thrusters + 1, _ALIGNED)
        """Outputs: log-odds of the thrusters, the value, and zeros."""
        self._activation = architecture.activation_module()
        self.kernels = UpdateKernels(architecture, self._heads, loss)
        # Sums of an update, and which of them are the gradient of which number of Adam's row, with which sign.
        first, second = architecture.layers
        trunks = len(self._trunks)
        self._shapes = (
            (trunks * first, self._inputs),
            *[(second, first)] * trunks,
            (trunks * second,),
            (self._heads, trunks * second),
            (self._heads,),
        )
        self._sizes = [*map(math.prod, self._shapes)]
        numbers = torch.arange(1, sum(self._sizes) + 1)
        signed = self._gathered(*self._parted(numbers)).to(adam.row.device)
        self._from, self._sign = signed.abs().clamp(min=1) - 1, signed.sign().to(adam.row.dtype)

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of both trunks (N, inputs), bfloat16, from columns (N, k), a history and privileged observations.

        They are the same in every epoch.
        """
        x = self._network.inputs(seen, memory)
        x = x if privileged is None else torch.cat((x, privileged), dim=1)
        rest = padded(x.new_ones(1, 1), (1, self._inputs - self._columns)).expand(len(x), -1)
        return torch.cat((x.bfloat16(), rest.bfloat16()), dim=1)

    @torch.no_grad()
    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, () each, of a minibatch whose memory are the `inputs`.

        All of it may be recorded in a CUDA graph: no shape and no branch depends on a value.
        """
        x = part.memory
        assert x is not None
        first_weight, layers, heads, head_bias = self._packed()

        # Forward, both trunks side by side. The outputs have a column for either part of the heads' weights.
        first = self._activation(x @ first_weight.T)
        first_parts = first.chunk(len(self._trunks), dim=1)
        second = self._activation(
            _joined(
                torch.addmm(bias, inputs, weight.T)
                for inputs, (weight, bias) in zip(first_parts, layers, strict=True)
            )
        )
        outputs = _product(second, heads.T)

        # Losses, and backward.
        given = part.action, part.log_prob, part.advantage, part.target
        d_outputs, sums = self.kernels.losses(outputs, head_bias, *given)
        d_head_bias, statistics = sums.sum(dim=1).tensor_split([self._heads])
        d_second, biases = self.kernels.backward(second, d_outputs @ heads[: self._heads])
        d_second_parts = d_second.chunk(len(self._trunks), dim=1)
        d_first, _ = self.kernels.backward(
            first,
            _joined(
                gradient @ weight
                for gradient, (weight, _) in zip(d_second_parts, layers, strict=True)
            ),
        )

        # Gradients of all weights and biases.
        d_seconds = [
            _product(gradient.T, inputs)
            for gradient, inputs in zip(d_second_parts, first_parts, strict=True)
        ]
        d_heads = _product(d_outputs.T, second)
        found = (_product(d_first.T, x), *d_seconds, biases.sum(dim=0), d_heads, d_head_bias)
        row = torch.cat([x.flatten() for x in found])[self._from]
        torch.mul(row, self._sign, out=self._adam.gradient).div_(len(x))
        return (statistics / len(x)).unbind()

    def _parted(self, numbers: Tensor) -> list[Tensor]:
        """Numbers as `_shapes`: all first layers, each second one, their biases, heads with theirs."""
        parts = numbers.split(self._sizes)
        return [part.view(shape) for part, shape in zip(parts, self._shapes, strict=True)]

    def _packed(self) -> tuple[Tensor, list[tuple[Tensor, Tensor]], Tensor, Tensor]:
        """The network's weights as its products take them, bfloat16 but for the last.

        They are (units of all trunks, inputs), with the biases as a column; weights and biases of each second
        layer; (2 heads, units of all trunks), rounded, then what rounding leaves of them; and biases (heads,). Each
        is where the sum is that is its gradient.
        """
        row = self._adam.row * self._sign
        packed = row.new_zeros(sum(self._sizes)).index_add_(0, self._from, row)
        *_, heads, bias = self._parted(packed)
        first, *seconds, biases, rounded, _ = self._parted(packed.bfloat16())
        layers = [*zip(seconds, biases.chunk(len(seconds)), strict=True)]
        return first, layers, torch.cat((rounded, (heads - rounded).bfloat16())), bias

    def _gathered(self, d_first: Tensor, *given: Tensor) -> Tensor:
        """Numbers (parameters,) in the order of Adam's row of arrays of `_shapes`."""
        *d_seconds, d_biases, d_heads, d_head_bias = given
        architecture = self._network.architecture
        gradients: dict[str, Tensor] = {}
        firsts, biases = (x.chunk(len(self._trunks)) for x in (d_first, d_biases))
        for trunk, first, second, bias in zip(self._trunks, firsts, d_seconds, biases, strict=True):
            width = self._network.layer(f"{trunk}.0")[0].shape[1]
            gradients[f"{trunk}.0.weight"] = first[:, :width]
            gradients[f"{trunk}.0.bias"] = first[:, self._columns]
            gradients[f"{trunk}.2.weight"] = second
            gradients[f"{trunk}.2.bias"] = bias
        # What a logit gets counts for one of its two outputs with -1.
        end = architecture.thrusters
        d_logit, d_bias = d_heads[:end, : architecture.features], d_head_bias[:end]
        gradients["action_net.weight"] = torch.stack((-d_logit, d_logit), dim=1)
        gradients["action_net.bias"] = torch.stack((-d_bias, d_bias), dim=1)
        gradients["value_net.weight"] = d_heads[end, -architecture.features :]
        gradients["value_net.bias"] = d_head_bias[end : end + 1]
        return self._adam.joined([gradients[name] for name in self._network.learnt])


def matrix_gradient(
    network: Network, adam: Adam, loss: Loss, samples: int
) -> MatrixGradient | None:
    """Gradients of minibatches of any size.

    None without products of bfloat16 or a compiler of kernels, and for networks that do not fit.
    """
    is_float = adam.row.dtype == torch.float32
    if not (is_float and network.architecture.bf16 and MatrixGradient.fits(network)):
        return None
    gradient = MatrixGradient(network, adam, loss)
    with contextlib.suppress(OSError):
        return gradient if gradient.kernels.functions else None
    return None


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Matrix product of bfloat16 matrices, accumulated and returned in float32."""
    return torch.mm(a, b, out_dtype=torch.float32) if a.is_cuda else a.float() @ b.float()


def _joined(parts: Iterable[Tensor]) -> Tensor:
    """Columns side by side; a single tensor as it is."""
    first, *others = parts
    return torch.cat((first, *others), dim=1) if others else first
