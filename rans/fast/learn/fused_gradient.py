"""Gradients of the PPO losses without autograd, for GPUs with bfloat16 products (docs/decisions/kernels.md).

They are computed in matrix products, forward and backward.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

import torch
from torch import Tensor

from rans.compile.cuda.design import DoesNotFit
from rans.compile.loss_gradient import d_logit, opening_term, transition_losses
from rans.errors import is_installed
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import PPOSettings
from rans.fast.learn.graph import fused
from rans.fast.learn.rollout import Batch
from rans.fast.learn.update_layout import Places, UpdateDesign
from rans.policy.activations import ACTIVATIONS
from rans.policy.network import Network


class GradientBackend(Protocol):
    """Computes gradients of minibatches, written into its `Adam.gradient`."""

    description: ClassVar[str]
    """Description of the computation for the log."""

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of the trunks (N, inputs) from columns (N, k), a history and privileged observations."""
        ...

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, () each, of a minibatch whose memory are the `inputs`."""
        ...


class MatrixGradient:
    """Gradients of minibatches on a GPU in matrix products, of networks with two layers.

    They are written into an `Adam.gradient` without synchronisation.

    Args:
        network: network.
        adam: optimizer, whose `row` and `gradient` keep their addresses.
        settings: coefficients of the losses.

    Raises:
        DoesNotFit: the network is of another kind.
    """

    description: ClassVar[str] = "products of matrices"

    def __init__(self, network: Network, adam: Adam, settings: PPOSettings) -> None:
        self.design = design = UpdateDesign(network.architecture)
        self._network = network
        self._adam = adam
        self._settings = settings
        self._device = adam.row.device
        self._zero = adam.row.new_zeros(1)
        zero = adam.row.shape[0]  # index of a zero behind the parameters, for padding
        # Index of every parameter in the row of all: the tensors are views of that row.
        indices = torch.arange(zero, device=self._device)
        offsets = design.places(
            {
                name: indices.as_strided(x.shape, x.stride(), x.storage_offset())
                for name, x in network.tensors.items()
                if name in network.learnt
            },
            zero,
        )
        head = Places(*(x.T for x in offsets["head"]))
        # What to gather for the packed weights and biases. Each is the difference of two parameters, since a
        # thruster's logit is a difference of outputs. The heads' weights come twice: rounded, and their remainder.
        matrices = [
            [x.flatten() for x in pair]
            for pair in (offsets["first"], offsets["second"], head, head)
        ]
        biases = [[x.flatten() for x in offsets[name]] for name in ("bias", "constant")]
        self._weights, self._biases = (
            [torch.cat(x) for x in zip(*parts, strict=True)] for parts in (matrices, biases)
        )
        self._is_remainder = _last_mask(self._weights[0], len(matrices[-1][0]))
        self._is_head_bias = _last_mask(self._biases[0], design.heads)
        # Where each parameter's gradient is among the sums, and its sign. Padding writes to the last entry, which
        # is cut off.
        self._source = torch.zeros(zero + 1, dtype=torch.int64, device=self._device)
        self._sign = adam.row.new_zeros(zero + 1)
        for pair, sign in zip(zip(*offsets.values(), strict=True), (1.0, -1.0), strict=True):
            flat = torch.cat([x.flatten() for x in pair])
            self._source[flat] = torch.arange(len(flat), device=self._device)
            self._sign[flat] = sign
        self._source = self._source[:zero]
        self._sign = self._sign[:zero]
        self._activation = network.architecture.activation_module()
        self._pack = fused(self._packed, self._device)
        self._gather = fused(self._gathered, self._device)
        # Two trunks are concatenated, which costs no time if compiled.
        self._second_activation = (
            self._activation if design.trunks == 1 else fused(self._joined_activation, self._device)
        )
        self._backward = fused(self._before_activation, self._device)
        self._losses = fused(self._output_gradients, self._device)

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of both trunks (N, inputs), bfloat16, from columns (N, k), a history and privileged observations.

        They are the same in every epoch.
        """
        x = self._network.inputs(seen, memory)
        x = x if privileged is None else torch.cat((x, privileged), dim=1)
        # A column of ones for the first layer's bias, and zeros up to the width that products need.
        ones = x.new_ones(1, 1).expand(len(x), -1)
        padding = x.new_zeros(1, self.design.inputs - self.design.columns - 1).expand(len(x), -1)
        return torch.cat((x, ones, padding), dim=1).bfloat16()

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, () each, of a minibatch whose memory are the `inputs`."""
        assert part.memory is not None
        gradient, statistics = self._gather(
            self._sums(*self._pack(), part.memory, part), len(part.memory)
        )
        self._adam.gradient.copy_(gradient)
        return statistics.unbind()

    def _packed(self) -> tuple[Tensor, Tensor]:
        """Weights (bfloat16) and biases (float32) in the layout of `_sums`, from the flat parameters of Adam.

        The second layer's biases are rounded as in torch's bfloat16 layers.
        """
        row = torch.cat((self._adam.row, self._zero))
        weights, biases = (row[plus] - row[minus] for plus, minus in (self._weights, self._biases))
        weights = torch.where(self._is_remainder, weights - _rounded(weights), weights)
        return weights.bfloat16(), torch.where(self._is_head_bias, biases, _rounded(biases))

    def _gathered(self, sums: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """Gradient (parameters,), and the loss with its statistics, from the sums of ``count`` transitions.

        A thruster's logit is a difference of two outputs, so that a sum counts for one with +1 and for the other
        with -1.
        """
        means = sums / count
        surrogate, value, *rest = means[self.design.end :].split(1)
        loss = surrogate + self._settings.vf_coef * value
        return means[self._source] * self._sign, torch.cat((loss, surrogate, value, *rest))

    def _sums(self, weights: Tensor, biases: Tensor, x: Tensor, part: Batch) -> Tensor:
        """Row of the sums of gradients, laid out by `UpdateDesign`, and of the statistics of a minibatch.

        All of it may be recorded in a CUDA graph: no shape and no branch depends on a value.

        Args:
            weights: bfloat16, in the layout of `UpdateDesign.matrices`.
            biases: float32, of the second layer, then of the heads.
            x: `inputs` of the minibatch.
            part: the minibatch.
        """
        design = self.design
        first_weight, second_weight, head, head_remainder = design.matrices(weights)
        second_bias, head_bias = biases.tensor_split([len(second_weight)])

        # Forward, both trunks side by side. The outputs have a column for either part of the heads' weights.
        first = self._activation(x @ first_weight.T)
        first_parts = first.chunk(design.trunks, dim=1)
        second_weights = second_weight.chunk(design.trunks)
        layers = zip(
            second_bias.bfloat16().chunk(design.trunks), first_parts, second_weights, strict=True
        )
        second = self._second_activation(
            *(torch.addmm(bias, inputs, weight.T) for bias, inputs, weight in layers)
        )
        outputs = _product(second, torch.cat((head, head_remainder)).T)

        # Losses, and backward.
        d_outputs, d_head_bias, statistics = self._losses(
            outputs, head_bias, part.action, part.log_prob, part.advantage, part.target
        )
        d_second, d_second_bias = self._backward(second, d_outputs @ head)
        d_second_parts = d_second.chunk(design.trunks, dim=1)
        d_first, _ = self._backward(
            first,
            *(
                gradient @ weight
                for gradient, weight in zip(d_second_parts, second_weights, strict=True)
            ),
        )

        # Gradients of all weights and biases, in the layout of `UpdateDesign`.
        sums = [
            *(
                _product(gradient.T, inputs)
                for gradient, inputs in zip(d_second_parts, first_parts, strict=True)
            ),
            _product(d_first.T, x),
            _product(second.T, d_outputs),
            d_second_bias,
            d_head_bias,
            statistics,
        ]
        return torch.cat([tensor.flatten() for tensor in sums])

    def _joined_activation(self, *parts: Tensor) -> Tensor:
        """Activations (N, units) of both trunks, side by side."""
        return self._activation(torch.cat(parts, dim=1))

    def _before_activation(self, value: Tensor, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        """Gradients before an activation function (N, units), bfloat16, and their sums (units,).

        It is compiled as one kernel; sums are of the rounded gradients, as the matrix products take them.

        Args:
            value: (N, units) values of the function.
            gradients: gradients of the values, one tensor for each trunk.
        """
        y = value.float()
        after = torch.cat(gradients, dim=1).float()
        slope = ACTIVATIONS[self._network.architecture.activation].slope
        assert slope is not None
        result = (after * slope(y)).bfloat16()
        return result, result.float().sum(dim=0)

    def _output_gradients(
        self,
        outputs: Tensor,
        bias: Tensor,
        action: Tensor,
        log_prob: Tensor,
        advantage: Tensor,
        target: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Gradients of the heads' outputs (N, heads), bfloat16, their sums (heads,), and sums of the statistics.

        Args:
            outputs: (N, 2 heads) outputs by the rounded weights, then by their remainders.
            bias: (heads,).
            action: (N, thrusters) zeros and ones.
            log_prob: (N,) log-probability of the action under the rollout's policy.
            advantage: (N,).
            target: (N,) target of the critic's value.
        """
        thrusters = action.shape[1]
        # Outputs: log-odds of the thrusters, then the value; the rest is padding.
        result = outputs[:, : self.design.heads] + outputs[:, self.design.heads :] + bias
        logit = result[:, :thrusters]
        parts = opening_term(logit, action)
        losses = transition_losses(
            parts.log_prob.sum(dim=1),
            parts.entropy.sum(dim=1),
            result[:, thrusters],
            log_prob,
            advantage,
            target,
            self._settings.clip_range,
            self._settings.vf_coef,
        )
        # Their gradients, padded likewise.
        d_logits = d_logit(action, parts.opening, losses.d_log_prob[:, None])
        d_value = losses.d_value[:, None]
        padding = d_value.new_zeros(1).expand(len(d_value), self.design.heads - thrusters - 1)
        gradient = torch.cat((d_logits, d_value, padding), dim=1)
        sums = torch.stack([x.sum() for x in losses.statistics])
        return gradient.bfloat16(), gradient.sum(dim=0), sums


def gradient_backend(
    network: Network, adam: Adam, settings: PPOSettings, samples: int
) -> GradientBackend | None:
    """Fastest backend for a network and minibatches of ``samples`` transitions; None: autograd."""
    row = adam.row
    arguments = (network, adam, settings)
    if row.device.type == "cpu":
        if not is_installed("llvmlite"):
            return None
        from rans.fast.learn.cpu_gradient import (
            CpuGradient,  # LLVM, which a GPU does not need
        )

        return CpuGradient(*arguments) if CpuGradient.fits(network, samples) else None
    if not (network.architecture.bf16 and row.is_cuda and row.dtype == torch.float32):
        return None
    try:
        return MatrixGradient(*arguments)
    except DoesNotFit:
        return None


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Matrix product of bfloat16 matrices, accumulated and returned in float32."""
    return torch.mm(a, b, out_dtype=torch.float32) if a.is_cuda else a.float() @ b.float()


def _rounded(x: Tensor) -> Tensor:
    """Float32 numbers rounded to the nearest bfloat16, ties to even.

    By bits, as torch's compiler would drop a conversion there and back.
    """
    bits = x.view(torch.int32)
    return ((bits + 0x7FFF + (bits >> 16 & 1)) & ~0xFFFF).view(torch.float32)


def _last_mask(like: Tensor, count: int) -> Tensor:
    """Mask (len(like),) that is true for the last ``count`` entries."""
    return torch.arange(len(like), device=like.device) >= len(like) - count
