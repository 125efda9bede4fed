"""Gradients of PPO's losses without autograd, where a GPU multiplies in bfloat16 (decision 020).

In one kernel, forward and backward, or for wider networks in products of matrices.
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
    STATISTICS,
    WARPS,
    KernelDesign,
    Places,
    UpdateDesign,
)
from rans.fast.learn.adam import Adam
from rans.fast.learn.config import Coefficients
from rans.fast.learn.graph import fused
from rans.fast.learn.rollout import Batch
from rans.policy.heads import OnOff
from rans.policy.network import Network


class GradientBackend(Protocol):
    """Makes gradients of one member's minibatches, into the row of its `Adam`."""

    description: ClassVar[str]
    """In which they are made."""

    def inputs(
        self, seen: Tensor, memory: Tensor | None, privileged: Tensor | None = None
    ) -> Tensor:
        """What the trunks are given (N, inputs) of columns (N, k), a history and what the critic is told."""
        ...

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """The loss of a minibatch, whose memory are `inputs`, and its `STATISTICS`, each (1,)."""
        ...


class FusedGradient(ABC):
    """Gradients of one member's minibatches, into the row of its `Adam`, without waiting for the device.

    Args:
        design: of the network.
        network: of one member.
        adam: whose `row` and `gradient` never move.
        coefficients: of the losses.
    """

    description: ClassVar[str]
    """In which they are made."""

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
        # The heads' once more, for what rounding leaves of them.
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
        # Where each weight's gradient is among the sums, and its sign; idle ones end beyond.
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
        """Of the fastest kind there is for a network and minibatches of so many samples; None: autograd."""
        row = adam.row
        arguments = (network, adam, coefficients)
        if row.device.type == "cpu":
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
        """What both trunks are given (N, inputs) of columns (N, k), a history and what the critic is told.

        It is the same in every epoch.
        """
        x = self._network.inputs(seen, memory)
        x = x if privileged is None else torch.cat((x, privileged), dim=1)
        one = x.new_ones(1, 1)
        rest = x.new_zeros(1, self.design.inputs - self.design.columns - 1)
        return torch.cat((x, one.expand(len(x), -1), rest.expand(len(x), -1)), dim=1).bfloat16()

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """The loss of a minibatch, whose memory are `inputs`, and its `STATISTICS`, each (1,)."""
        assert part.memory is not None
        gradient, statistics = self._gather(
            self._sums(*self._pack(), part.memory, part), len(part.memory)
        )
        self._adam.gradient.copy_(gradient)
        return statistics.split(1)

    @abstractmethod
    def _sums(self, weights: Tensor, biases: Tensor, x: Tensor, part: Batch) -> Tensor:
        """Gradients and statistics of parts of a minibatch, (parts, `UpdateDesign.size`).

        Weights are as `UpdateDesign.matrices` finds them; biases, float32, the second layer's and the heads'.
        """

    def _packed(self) -> tuple[Tensor, Tensor]:
        """Weights, and biases with those of the hidden layer as torch's products of bfloat16 round them."""
        row = torch.cat((self._adam.row[0], self._zero))
        weights, biases = (row[plus] - row[minus] for plus, minus in (self._weights, self._biases))
        rest = torch.where(self._is_rest, weights - _rounded(weights), weights)
        return rest.bfloat16(), torch.where(self._is_constant, biases, _rounded(biases))

    def _gathered(self, sums: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """The gradient, (1, P), and the loss with its statistics."""
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
    """All in one kernel, where a block of so many bytes of ``shared`` memory has room (`KernelDesign`)."""

    description: ClassVar[str] = "one kernel"
    design: KernelDesign

    def __init__(
        self, network: Network, adam: Adam, coefficients: Coefficients, shared: int
    ) -> None:
        super().__init__(KernelDesign(network.architecture, shared), network, adam, coefficients)

    @cached_property
    def blocks(self) -> int:
        """As many as there are multiprocessors."""
        return torch.cuda.get_device_properties(self._device).multi_processor_count

    @cached_property
    def function(self) -> Function:
        """The compiled kernel; errors are those of `Function`."""
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
    """In products of matrices, for networks that one kernel has no place for, or with two trunks."""

    description: ClassVar[str] = "products of matrices"

    def __init__(self, network: Network, adam: Adam, coefficients: Coefficients) -> None:
        super().__init__(UpdateDesign(network.architecture), network, adam, coefficients)
        self._activation = network.architecture.activation_module()
        # Two trunks' lie beside each other, which takes no longer where it is compiled.
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
        # Forward, a trunk beside the other; outputs are sums of both parts of the heads' weights.
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
        """Gradients before activations from those after them, and their sums over the samples."""
        y = value.float()
        after = torch.cat(gradients, dim=1).float()
        kind = self._network.architecture.activation
        slope = (
            1 - y * y
            if kind == "tanh"
            else (y > 0).float()
            if kind == "relu"
            else torch.where(y > 0, 1.0, y + 1.0)
        )
        result = (after * slope).bfloat16()
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
        """The outputs' gradients, their sums, and the statistics' (`rans.fast.learn.ppo.losses`)."""
        coefficients = self._coefficients
        thrusters = action.shape[1]
        result = outputs[:, : self.design.heads] + outputs[:, self.design.heads :] + constant
        policy = OnOff(result[:, :thrusters])
        error = result[:, thrusters] - target
        change = policy.log_prob(action) - log_prob
        ratio = change.exp()
        gain = advantage * ratio
        clipped = advantage * torch.minimum(
            torch.maximum(ratio, 1 - coefficients.clip_range), 1 + coefficients.clip_range
        )
        # No gain where the ratio has left its range in the direction of the gain.
        slope = torch.where(gain <= clipped, -gain, 0.0)[:, None]
        opening = torch.sigmoid(policy.logit)
        d_logit = slope * (action - opening) + coefficients.ent_coef * policy.logit * opening * (
            1 - opening
        )
        d_value = (2 * coefficients.vf_coef * error)[:, None]
        idle = d_value.new_zeros(1).expand(len(d_value), self.design.heads - thrusters - 1)
        gradient = torch.cat((d_logit, d_value, idle), dim=1)
        statistics = (
            -torch.minimum(gain, clipped),
            error.square(),
            -policy.entropy(),
            ratio - 1 - change,
            ((ratio - 1).abs() > coefficients.clip_range).to(ratio.dtype),
        )
        return gradient.bfloat16(), gradient.sum(dim=0), torch.stack([x.sum() for x in statistics])


def _float32(a: Tensor, b: Tensor) -> Tensor:
    """A product of bfloat16 whose sums are not rounded."""
    return torch.mm(a, b, out_dtype=torch.float32) if a.is_cuda else a.float() @ b.float()


def _rounded(x: Tensor) -> Tensor:
    """To the nearest bfloat16, ties to even, but float32: torch's compiler drops conversions to and fro."""
    bits = x.view(torch.int32)
    return ((bits + 0x7FFF + (bits >> 16 & 1)) & ~0xFFFF).view(torch.float32)


def _last(like: Tensor, count: int) -> Tensor:
    """Which numbers are the last so many."""
    return torch.arange(len(like), device=like.device) >= len(like) - count
