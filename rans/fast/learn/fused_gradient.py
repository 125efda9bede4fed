"""Gradients of the PPO losses without autograd, for GPUs with bfloat16 products (docs/decisions/kernels.md).

They are computed in one kernel, forward and backward, or for wider networks in matrix products.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import ClassVar, Protocol

import torch
from torch import Tensor
from torch.nn import functional

from rans.compile.cuda.design import DoesNotFit
from rans.compile.cuda.launch import CudaError, Function
from rans.compile.cuda.update_design import (
    PAD,
    WARPS,
    KernelDesign,
    Places,
    UpdateDesign,
)
from rans.compile.loss_gradient import STATISTICS, choice, d_logit, transition_losses
from rans.errors import is_installed
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import Coefficients
from rans.fast.learn.graph import fused
from rans.fast.learn.rollout import Batch
from rans.policy.activations import ACTIVATIONS
from rans.policy.network import Network


class GradientBackend(Protocol):
    """Computes gradients of minibatches of one member, written into its `Adam.gradient`."""

    description: ClassVar[str]
    """Description of the computation for the log."""

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of the trunks (N, inputs) from columns (N, k), a history and privileged observations."""
        ...

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, (1,) each, of a minibatch whose memory are the `inputs`."""
        ...


class FusedGradient(ABC):
    """Gradients of minibatches of one member on a GPU, written into its `Adam.gradient` without synchronisation.

    Args:
        design: layout of the computation for the network.
        network: network of one member.
        adam: optimizer, whose `row` and `gradient` keep their addresses.
        coefficients: coefficients of the losses.
    """

    description: ClassVar[str]
    """Description of the computation for the log."""

    def __init__(
        self, design: UpdateDesign, network: Network, adam: Adam, coefficients: Coefficients
    ) -> None:
        self.design = design
        self._network = network
        self._adam = adam
        self._coefficients = coefficients
        self._device = adam.row.device
        self._zero = adam.row.new_zeros(1)
        zero = adam.row.shape[1]
        # The weights are views of their row.
        everywhere = torch.arange(zero, device=self._device)
        places = design.places(
            {
                name: everywhere.as_strided(x.shape, x.stride(), x.storage_offset())
                for name, x in network.tensors.items()
                if name in network.learnt
            },
            zero,
        )
        head = Places(*(x.T for x in places["head"]))
        # The weights of the heads twice: rounded, and the remainder.
        matrices = [
            [functional.pad(x, (0, PAD), value=zero).flatten() for x in pair]
            for pair in (places["first"], places["second"], head, head)
        ]
        biases = [[x.flatten() for x in places[name]] for name in ("bias", "constant")]
        self._weights, self._biases = (
            [torch.cat(x) for x in zip(*of, strict=True)] for of in (matrices, biases)
        )
        self._is_rest = _last(self._weights[0], len(matrices[-1][0]))
        self._is_constant = _last(self._biases[0], design.heads)
        # Index of each weight's gradient among the sums, and its sign; unused ones are at the end.
        self._source = torch.zeros(zero + 1, dtype=torch.int64, device=self._device)
        self._sign = adam.row.new_zeros(zero + 1)
        for pair, sign in zip(zip(*places.values(), strict=True), (1.0, -1.0), strict=True):
            flat = torch.cat([x.flatten() for x in pair])
            self._source[flat] = torch.arange(len(flat), device=self._device)
            self._sign[flat] = sign
        self._source, self._sign = self._source[:zero], self._sign[:zero]
        self._pack, self._gather = (
            fused(self._packed, self._device),
            fused(self._gathered, self._device),
        )

    @staticmethod
    def made(
        network: Network, adam: Adam, coefficients: Coefficients, samples: int
    ) -> GradientBackend | None:
        """Fastest backend for a network and minibatches of ``samples`` transitions; None: autograd."""
        row = adam.row
        arguments = (network, adam, coefficients)
        if row.device.type == "cpu":
            if not is_installed("llvmlite"):
                return None
            from rans.fast.learn.cpu_gradient import (
                CpuGradient,  # LLVM, which a GPU does not need
            )

            return CpuGradient(*arguments) if CpuGradient.fits(network, samples) else None
        if not (
            network.architecture.bf16
            and row.is_cuda
            and row.dtype == torch.float32
            and len(row) == 1
        ):
            return None
        try:
            chip = torch.cuda.get_device_properties(row.device)
            kernel = UpdateKernel(*arguments, chip.shared_memory_per_block_optin)
            _ = kernel.function
        except (DoesNotFit, OSError, CudaError):
            pass
        else:
            return kernel
        try:
            return MatrixGradient(*arguments)
        except DoesNotFit:
            return None

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """Inputs of both trunks (N, inputs) from columns (N, k), a history and privileged observations.

        They are the same in every epoch.
        """
        x = self._network.inputs(seen, memory)
        x = x if privileged is None else torch.cat((x, privileged), dim=1)
        one = x.new_ones(1, 1)
        rest = x.new_zeros(1, self.design.inputs - self.design.columns - 1)
        return torch.cat((x, one.expand(len(x), -1), rest.expand(len(x), -1)), dim=1).bfloat16()

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """Loss and `STATISTICS`, (1,) each, of a minibatch whose memory are the `inputs`."""
        assert part.memory is not None
        gradient, statistics = self._gather(
            self._sums(*self._pack(), part.memory, part), len(part.memory)
        )
        self._adam.gradient.copy_(gradient)
        return statistics.split(1)

    @abstractmethod
    def _sums(self, weights: Tensor, biases: Tensor, x: Tensor, part: Batch) -> Tensor:
        """Gradients and statistics of parts of a minibatch, (parts, `UpdateDesign.size`).

        Weights are in the layout of `UpdateDesign.matrices`; biases, float32, are those of the second layer and of
        the heads.
        """

    def _packed(self) -> tuple[Tensor, Tensor]:
        """Packed weights and biases; those of the hidden layer are rounded as torch's bfloat16 products do."""
        row = torch.cat((self._adam.row[0], self._zero))
        weights, biases = (row[plus] - row[minus] for plus, minus in (self._weights, self._biases))
        rest = torch.where(self._is_rest, weights - _rounded(weights), weights)
        return rest.bfloat16(), torch.where(self._is_constant, biases, _rounded(biases))

    def _gathered(self, sums: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """Gradient (1, P), and the loss with its statistics."""
        means = sums.sum(dim=0) / count
        coefficients = self._coefficients
        surrogate, value, entropy, *rest = means[
            self.design.end : self.design.end + STATISTICS
        ].split(1)
        loss = surrogate + coefficients.vf_coef * value + coefficients.ent_coef * entropy
        return (means[self._source] * self._sign)[None], torch.cat(
            (loss, surrogate, value, entropy, *rest)
        )


class UpdateKernel(FusedGradient):
    """Gradient backend in one kernel, which needs its design to fit the ``shared`` memory of a block, bytes."""

    description: ClassVar[str] = "one kernel"
    design: KernelDesign

    def __init__(
        self, network: Network, adam: Adam, coefficients: Coefficients, shared: int
    ) -> None:
        super().__init__(KernelDesign(network.architecture, shared), network, adam, coefficients)

    @cached_property
    def blocks(self) -> int:
        """Number of blocks: one per multiprocessor."""
        return torch.cuda.get_device_properties(self._device).multi_processor_count

    @cached_property
    def function(self) -> Function:
        """Compiled kernel; raises the errors of `Function`."""
        with torch.cuda.device(self._device):  # a compiled kernel belongs to one device
            return Function(
                self.design.source(),
                "gradient",
                torch.cuda.get_device_capability(),
                self.design.used,
            )

    def _sums(self, weights: Tensor, biases: Tensor, x: Tensor, part: Batch) -> Tensor:
        by = self._coefficients
        sums = self._adam.row.new_empty(self.blocks, self.design.size)
        tensors = (
            weights,
            biases,
            x,
            part.action,
            part.log_prob,
            part.advantage,
            part.target,
            by.clip_range,
            by.vf_coef,
            by.ent_coef,
            sums,
        )
        self._launch([given.data_ptr() for given in tensors], len(x))
        return sums

    def _launch(self, pointers: list[int], count: int) -> None:
        with torch.cuda.device(self._device):
            stream = torch.cuda.current_stream().cuda_stream
            self.function.launch(self.blocks, 32 * WARPS, stream, pointers, [count])


class MatrixGradient(FusedGradient):
    """Gradient backend in matrix products, for networks that do not fit one kernel or have two trunks."""

    description: ClassVar[str] = "products of matrices"

    def __init__(self, network: Network, adam: Adam, coefficients: Coefficients) -> None:
        super().__init__(UpdateDesign(network.architecture), network, adam, coefficients)
        self._activation = network.architecture.activation_module()
        # Two trunks are concatenated, which costs no time if compiled.
        self._second = (
            self._activation if self.design.trunks == 1 else fused(self._beside, self._device)
        )
        self._through, self._output = (
            fused(self._before, self._device),
            fused(self._learnt, self._device),
        )

    def _sums(self, weights: Tensor, biases: Tensor, x: Tensor, part: Batch) -> Tensor:
        design = self.design
        first, second, head, rest = design.matrices(weights)
        bias, constant = biases.tensor_split([len(second)])
        # Forward, both trunks side by side; outputs are sums over both parts of the heads' weights.
        one = self._activation(x @ first.T)
        ones = one.chunk(design.trunks, dim=1)
        seconds = second.chunk(design.trunks)
        given = zip(bias.bfloat16().chunk(design.trunks), ones, seconds, strict=True)
        two = self._second(*(torch.addmm(shift, each, weight.T) for shift, each, weight in given))
        outputs = _float32(two, torch.cat((head, rest)).T)
        # Losses, and backward.
        d_out, of_constant, statistics = self._output(
            outputs, constant, part.action, part.log_prob, part.advantage, part.target
        )
        d_two, of_bias = self._through(two, d_out @ head)
        d_twos = d_two.chunk(design.trunks, dim=1)
        d_one, _ = self._through(
            one, *(each @ weight for each, weight in zip(d_twos, seconds, strict=True))
        )
        sums = [
            *(_float32(each.T, given) for each, given in zip(d_twos, ones, strict=True)),
            _float32(d_one.T, x),
            _float32(two.T, d_out),
            of_bias,
            of_constant,
            statistics,
            self._zero.expand(design.size - design.end - STATISTICS),
        ]
        return torch.cat([each.flatten() for each in sums])[None]

    def _beside(self, *parts: Tensor) -> Tensor:
        return self._activation(torch.cat(parts, dim=1))

    def _before(self, value: Tensor, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        """Gradients before activations, from those after them, and their sums over the samples."""
        y = value.float()
        after = torch.cat(gradients, dim=1).float()
        slope = ACTIVATIONS[self._network.architecture.activation].slope
        assert slope is not None
        result = (after * slope(y)).bfloat16()
        return result, result.float().sum(dim=0)

    def _learnt(
        self,
        outputs: Tensor,
        constant: Tensor,
        action: Tensor,
        log_prob: Tensor,
        advantage: Tensor,
        target: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Gradients of the outputs, their sums, and sums of the statistics."""
        coefficients = self._coefficients
        thrusters = action.shape[1]
        result = outputs[:, : self.design.heads] + outputs[:, self.design.heads :] + constant
        logit = result[:, :thrusters]
        one = choice(logit, action)
        losses = transition_losses(
            one.log_prob.sum(dim=1),
            one.entropy.sum(dim=1),
            result[:, thrusters],
            log_prob,
            advantage,
            target,
            coefficients.clip_range,
            coefficients.vf_coef,
        )
        of_logits = d_logit(
            logit, action, one.opening, losses.d_log_prob[:, None], coefficients.ent_coef
        )
        of_value = losses.d_value[:, None]
        idle = of_value.new_zeros(1).expand(len(of_value), self.design.heads - thrusters - 1)
        gradient = torch.cat((of_logits, of_value, idle), dim=1)
        sums = torch.stack([x.sum() for x in losses.statistics])
        return gradient.bfloat16(), gradient.sum(dim=0), sums


def _float32(a: Tensor, b: Tensor) -> Tensor:
    """Matrix product of bfloat16 numbers with float32 sums."""
    return torch.mm(a, b, out_dtype=torch.float32) if a.is_cuda else a.float() @ b.float()


def _rounded(x: Tensor) -> Tensor:
    """Float32 numbers rounded to the nearest bfloat16, ties to even; torch's compiler would drop conversions."""
    bits = x.view(torch.int32)
    return ((bits + 0x7FFF + (bits >> 16 & 1)) & ~0xFFFF).view(torch.float32)


def _last(like: Tensor, count: int) -> Tensor:
    """Mask of the last ``count`` numbers."""
    return torch.arange(len(like), device=like.device) >= len(like) - count
