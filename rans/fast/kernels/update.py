"""The gradient of PPO's losses in one kernel on a GPU, forward and backward (decision 020)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from rans.fast.kernels.design import DoesNotFit, padded, up
from rans.fast.kernels.launch import CudaError, Function
from rans.fast.learn.adam import Adam
from rans.fast.learn.architecture import EXTRACTOR, Architecture
from rans.fast.learn.config import Coefficients
from rans.fast.learn.graph import fused
from rans.fast.learn.network import Network
from rans.fast.learn.rollout import Batch

WARPS = 8
"""Of a block, of which a multiprocessor has one; each takes 16 samples of a tile."""
WIDEST, MOST_INPUTS = 128, 64
"""Gradients of larger weights would not stay in registers."""
PAD = 8
"""Numbers between the rows of a matrix in shared memory, so that eight rows meet all its banks."""
STATISTICS = 5
"""Sums over samples that the kernel gives: `rans.fast.learn.ppo.Losses` but the loss."""


class Places(NamedTuple):
    """Where a matrix is among all weights, of which each number is the difference of two, or one and zero."""

    plus: Tensor
    minus: Tensor


@dataclass(frozen=True)
class UpdateDesign:
    """How a network of this architecture lies in the kernel's memory.

    Raises:
        DoesNotFit: the network is of another kind, or larger.
    """

    given: Architecture
    shared: int
    """Bytes of shared memory that a block may have."""

    def __post_init__(self) -> None:
        given = self.given
        if given.units or given.privileged or given.continuous:
            raise DoesNotFit("a recurrent network, a critic of its own, or continuous commands")
        if len(given.layers) != 2 or max(given.layers) > WIDEST or self.inputs > MOST_INPUTS:
            raise DoesNotFit(f"{self.columns} inputs and layers of {given.layers} units; it has for "
                             f"{MOST_INPUTS - 1} inputs and two layers of {WIDEST}")
        if self.used > self.shared:
            raise DoesNotFit(f"{self.used:,} bytes of shared memory a block; there are {self.shared:,}")

    @property
    def columns(self) -> int:
        """Numbers that the first layer is given."""
        return self.given.seen * (2 if self.given.zoom else 1) + self.given.memory

    @property
    def inputs(self) -> int:
        """The same with a one, whose weights are the biases, and zeros."""
        return up(self.columns + 1, 16)

    @property
    def widths(self) -> tuple[int, int]:
        """Units of both layers, with idle ones."""
        first, second = (up(units, 64) for units in self.given.layers)
        return first, second

    @property
    def heads(self) -> int:
        """Outputs, with idle ones."""
        return up(self.given.thrusters + 1, 16)

    @cached_property
    def sums(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the gradients that a block writes, one after the other, before its statistics."""
        first, second = self.widths
        return {"second": (second, first), "first": (first, self.inputs), "head": (second, self.heads),
                "bias": (second,), "constant": (self.heads,)}

    @property
    def size(self) -> int:
        """Numbers that a block writes."""
        return up(self.end + STATISTICS, 4)

    @property
    def end(self) -> int:
        """Of the sums, where statistics begin."""
        return sum(math.prod(shape) for shape in self.sums.values())

    @property
    def used(self) -> int:
        """Bytes of shared memory of a block."""
        first, second = self.widths
        rows = 16 * WARPS
        weights = first * (self.inputs + PAD) + second * (first + PAD) + 2 * self.heads * (second + PAD)
        exchanged = rows * (self.inputs + 2 * first + 2 * second + self.heads + 6 * PAD)
        return 2 * (weights + exchanged) + 4 * (second + self.heads)

    def places(self, positions: Mapping[str, Tensor], zero: int) -> dict[str, Places]:
        """Of the matrices of `sums`, from the place of every weight by name."""
        def one(name: str) -> tuple[Tensor, Tensor]:
            return positions[f"{name}.weight"], positions[f"{name}.bias"]

        (first, bias), (second, bias_2), (action, shift), (value, constant) = map(
            one, (f"{EXTRACTOR}trunk.0", f"{EXTRACTOR}trunk.2", "action_net", "value_net"))
        # Of two logits a thruster, their difference counts (`Network._heads`).
        head = torch.cat((action[1::2], value)), torch.cat((action[0::2], torch.full_like(value, zero)))
        shifts = torch.cat((shift[1::2], constant)), torch.cat((shift[0::2], torch.full_like(constant, zero)))
        found = {"second": (second,), "first": (torch.cat((first, bias[:, None]), dim=1),),
                 "head": tuple(x.T for x in head), "bias": (bias_2,), "constant": shifts}
        filled = {name: [padded(x, self.sums[name], zero) for x in pair] for name, pair in found.items()}
        return {name: Places(pair[0], pair[-1] if len(pair) > 1 else torch.full_like(pair[0], zero))
                for name, pair in filled.items()}

    def source(self) -> str:
        """CUDA C++ of the kernel ``gradient``, see ``update.cuh``."""
        first, second = self.widths
        numbers = {"INPUTS": self.inputs, "FIRST": first, "SECOND": second, "HEADS": self.heads,
                   "THRUSTERS": self.given.thrusters, "WARPS": WARPS, "PAD": PAD, "SUMS": self.size}
        texts = [files("rans.fast.kernels").joinpath(name).read_text()
                 for name in ("functions.cuh", "warp.cuh", "policy.cuh", "update.cuh")]
        return "\n".join((*texts[:-1], f"typedef {self.given.activation.capitalize()} Activation;",
                          *(f"constexpr int {name} = {number};" for name, number in numbers.items()),
                          texts[-1]))


class UpdateKernel:
    """Gradients of one member's minibatches, into the row of its `Adam`, without waiting for the device.

    Args:
        network: of one member, on a CUDA device.
        adam: whose `row` and `gradient` never move.
        coefficients: of the losses.
        shared: bytes of shared memory that a block may have there.

    Raises:
        DoesNotFit: the network is of another kind, or larger.
    """

    def __init__(self, network: Network, adam: Adam, coefficients: Coefficients, shared: int) -> None:
        self.design = design = UpdateDesign(network.architecture, shared)
        self._network, self._adam, self._coefficients = network, adam, coefficients
        self._device, self._zero = adam.row.device, adam.row.new_zeros(1)
        zero = adam.row.shape[1]
        # The weights are views of their row.
        everywhere = torch.arange(zero, device=self._device)
        places = design.places({name: everywhere.as_strided(x.shape, x.stride(), x.storage_offset())
                                for name, x in network.tensors.items() if name in network.learnt}, zero)
        head = Places(*(x.T for x in places["head"]))
        # As the kernel has them in shared memory: the heads' once more, for what rounding leaves of them.
        matrices = [[functional.pad(x, (0, PAD), value=zero).flatten() for x in pair]
                    for pair in (places["first"], places["second"], head, head)]
        biases = [[x.flatten() for x in places[name]] for name in ("bias", "constant")]
        self._weights, self._biases = (
            [torch.cat(x) for x in zip(*of, strict=True)] for of in (matrices, biases))
        self._is_rest = _last(self._weights[0], len(matrices[-1][0]))
        self._is_constant = _last(self._biases[0], design.heads)
        # Where each weight's gradient is among a block's sums, and its sign; idle ones end beyond.
        self._source = torch.zeros(zero + 1, dtype=torch.int64, device=self._device)
        self._sign = adam.row.new_zeros(zero + 1)
        for pair, sign in zip(zip(*places.values(), strict=True), (1.0, -1.0), strict=True):
            flat = torch.cat([x.flatten() for x in pair])
            self._source[flat] = torch.arange(len(flat), device=self._device)
            self._sign[flat] = sign
        self._source, self._sign = self._source[:zero], self._sign[:zero]
        self._pack, self._gather = fused(self._packed, self._device), fused(self._gathered, self._device)
        self._prepare = fused(self._prepared, self._device)

    @classmethod
    def made(cls, network: Network, adam: Adam, coefficients: Coefficients) -> UpdateKernel | None:
        """A compiled kernel where a GPU multiplies hidden layers in bfloat16 and it fits."""
        row = adam.row
        if not (network.architecture.bf16 and row.is_cuda and row.dtype == torch.float32 and len(row) == 1):
            return None
        try:
            chip = torch.cuda.get_device_properties(row.device)
            kernel = cls(network, adam, coefficients, chip.shared_memory_per_block_optin)
            _ = kernel.function
        except (DoesNotFit, OSError, CudaError):
            return None
        return kernel

    @cached_property
    def blocks(self) -> int:
        """As many as there are multiprocessors."""
        return torch.cuda.get_device_properties(self._device).multi_processor_count

    @cached_property
    def function(self) -> Function:
        """The compiled kernel; errors are those of `Function`."""
        with torch.cuda.device(self._device):
            return Function(self.design.source(), "gradient", torch.cuda.get_device_capability(),
                            self.design.used)

    def prepared(self, batch: Batch) -> Batch:
        """The same with what the trunk is given, (T, N, inputs) of bfloat16, which is so in every epoch."""
        return batch._replace(seen=self._prepare(batch.seen, batch.memory), memory=None)

    def __call__(self, part: Batch) -> tuple[Tensor, ...]:
        """The loss of a minibatch of prepared inputs and its `STATISTICS`, each (1,)."""
        given, count = self._coefficients, len(part.seen)
        weights, biases = self._pack()
        sums = self._adam.row.new_empty(self.blocks, self.design.size)
        tensors = (weights, biases, part.seen, part.action, part.log_prob, part.advantage, part.target,
                   given.clip_range, given.vf_coef, given.ent_coef, sums)
        self._launch([x.data_ptr() for x in tensors], count)
        gradient, found = self._gather(sums, count)
        self._adam.gradient.copy_(gradient)
        return found.split(1)

    def _prepared(self, seen: Tensor, memory: Tensor | None) -> Tensor:
        flat = self._network.inputs(seen.flatten(0, 1), None if memory is None else memory.flatten(0, 1))
        one = flat.new_ones(1).expand(len(flat), 1)
        gap = flat.new_zeros(1).expand(len(flat), self.design.inputs - self.design.columns - 1)
        return torch.cat((flat, one, gap), dim=1).bfloat16().unflatten(0, seen.shape[:2])

    def _packed(self) -> tuple[Tensor, Tensor]:
        """Weights, and biases with those of the hidden layer as torch's products of bfloat16 round them."""
        row = torch.cat((self._adam.row[0], self._zero))
        weights, biases = (row[plus] - row[minus] for plus, minus in (self._weights, self._biases))
        rest = torch.where(self._is_rest, weights - weights.bfloat16().float(), weights)
        return rest.bfloat16(), torch.where(self._is_constant, biases, biases.bfloat16().float())

    def _gathered(self, sums: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """The gradient, (1, P), and the loss with its statistics."""
        means, given = sums.sum(dim=0) / count, self._coefficients
        surrogate, value, entropy, *rest = means[self.design.end:self.design.end + STATISTICS].split(1)
        loss = surrogate + given.vf_coef * value + given.ent_coef * entropy
        return (means[self._source] * self._sign)[None], torch.cat((loss, surrogate, value, entropy, *rest))

    def _launch(self, pointers: list[int], count: int) -> None:
        with torch.cuda.device(self._device):
            stream = torch.cuda.current_stream().cuda_stream
            self.function.launch(self.blocks, 32 * WARPS, stream, pointers, [count])


def _last(like: Tensor, count: int) -> Tensor:
    """Which numbers are the last so many."""
    return torch.arange(len(like), device=like.device) >= len(like) - count
