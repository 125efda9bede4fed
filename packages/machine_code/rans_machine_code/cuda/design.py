"""How a policy's network lies in the memory of a flight's kernel, and how many flights a block has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from rans.extend import Architecture, Capabilities

WIDEST = 512
"""Units of a layer: more would not stay in registers."""
FEW_INPUTS = 64
"""So many are fetched into registers, more again and again."""
_REGISTERS = 144
"""Of a thread, that activations may take."""


class DoesNotFit(TypeError):
    """The network is of a kind, or of a size, that the kernel has no place for."""

    def __init__(self, what: str) -> None:
        super().__init__(f"their kernel has no place for {what}.")


@dataclass(frozen=True)
class Design:
    """Of a network with this architecture, on a chip with so much shared memory a block.

    Raises:
        DoesNotFit: see there.
    """

    capabilities: ClassVar[Capabilities] = Capabilities()
    given: Architecture
    parts: int
    """Numbers are sums of so many of bfloat16: 1, 2 (16 significant bits), or 3 (24, as in float32)."""
    shared: int
    """Bytes."""
    most_warps: int | None = None
    """Of 32 flights each, in a block, of which a multiprocessor has one; None: as many as find registers."""

    def __post_init__(self) -> None:
        architecture = self.given
        if lacking := self.capabilities.missing(architecture):
            raise DoesNotFit(lacking)
        if not architecture.layers or max(architecture.layers) > WIDEST:
            raise DoesNotFit(
                f"a policy with layers of {architecture.layers} units; it has up to {WIDEST}"
            )
        if self.warps < 1:
            raise DoesNotFit(
                f"a policy that takes {self.per_warp:,} bytes for 32 flights; it has "
                f"{self.shared:,}"
            )

    @property
    def columns(self) -> int:
        """Numbers that the first layer is given."""
        return self.given.inputs

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Of inputs and layers, as multiples of 16."""
        return tuple(up(width, 16) for width in (self.columns, *self.given.layers))

    @property
    def outputs(self) -> int:
        """Of the network, as a multiple of 8."""
        return up(self.given.outputs, 8)

    @property
    def tiles(self) -> int:
        """Of 16 flights, that go through the network together."""
        return 2 if self.parts * self._kept_units // 2 <= _REGISTERS else 1

    @property
    def _kept_units(self) -> int:
        """Activations of a flight that are in registers at once."""
        kept = [*([self.widths[0]] if self.widths[0] <= FEW_INPUTS else []), *self.widths[1:-1]]
        return max((a + b for a, b in zip((0, *kept), kept, strict=False)), default=0)

    @property
    def stride(self) -> int:
        """From one flight's inputs to the next, in numbers: so that eight rows meet all banks of memory."""
        return self.widths[0] + 8

    @property
    def stride_out(self) -> int:
        """The same of outputs."""
        return self.outputs + 2

    @cached_property
    def places(self) -> dict[str, int]:
        """First byte of every part of `packed`; "small" is the end of single numbers, "end" that of all.

        Parts are in order of use: single numbers first, then matrices from small to large. Those that do not fit
        into shared memory are the last ones, which the kernel reads from global memory (`kept`). All begin at
        multiples of 16 bytes.
        """
        sizes = {
            "mean": self.given.column_count,
            "scale": self.given.column_count,
            "zoom": self.given.column_count,
            **{f"bias_{i}": width for i, width in enumerate(self.widths[1:])},
            "constant": self.outputs,
        }
        result = {}
        at = 0
        for name, size in sizes.items():
            result[name], at = at, at + 4 * up(size, 4)
        result["small"] = at
        blocks = {
            "head": self.outputs * self.widths[-1],
            **{
                f"layer_{i}": a * b
                for i, (a, b) in enumerate(zip(self.widths, self.widths[1:], strict=False))
            },
        }
        for name, size in sorted(blocks.items(), key=lambda block: block[1]):
            result[name] = at
            at = at + 2 * self.parts * size
        return result | {"end": at}

    @cached_property
    def kept(self) -> int:
        """Bytes of `packed` in shared memory: as many parts as leave room for all warps.

        The others are read through the caches.
        """
        room = self.shared - self.warps * self.per_warp
        ends = sorted(place for name, place in self.places.items() if place >= self.places["small"])
        return max(end for end in ends if end <= room)

    @cached_property
    def warps(self) -> int:
        """Of a block: as many as find registers and memory."""
        taken = self.parts * self.tiles * self._kept_units // 4
        registers = 16 if taken <= 48 else 12 if taken <= 80 else 8
        room = (self.shared - self.places["small"]) // self.per_warp
        return min(self.most_warps or registers, room)

    @property
    def per_warp(self) -> int:
        """Bytes of shared memory of every warp."""
        return self.inputs_bytes + self.outputs_bytes

    @property
    def used(self) -> int:
        """Bytes of shared memory of a block."""
        return self.kept + self.warps * self.per_warp

    @property
    def inputs_bytes(self) -> int:
        """Of a warp's inputs."""
        return 32 * 2 * self.parts * self.stride

    @property
    def outputs_bytes(self) -> int:
        """Of a warp's outputs."""
        return 32 * 4 * self.stride_out

    def packed(self, tables: Mapping[str, np.ndarray]) -> Tensor:
        """The policy's parameters (`FlightProgram.tables`) in one piece, uint8 on the CPU.

        The kernel reads it at `places`.
        """
        table = {name: torch.from_numpy(x) for name, x in tables.items()}
        parts = {name: table[name] for name in ("mean", "scale", "zoom")}
        parts["constant"] = padded(table["head.bias"], (self.outputs,))
        parts["head"] = self._ordered(table["head.weight"], self.outputs, self.widths[-1], 8)
        for i, (width, units) in enumerate(zip(self.widths, self.widths[1:], strict=False)):
            # torch's modules of a trunk are a linear layer and its activation, by turns.
            own = f"trunk.{2 * i}"
            parts[f"bias_{i}"] = padded(table[f"{own}.bias"], (units,))
            parts[f"layer_{i}"] = self._ordered(table[f"{own}.weight"], units, width, 16)
        whole = torch.zeros(self.places["end"], dtype=torch.uint8)
        for name, part in parts.items():
            data = part.contiguous().view(torch.uint8).flatten()
            whole[self.places[name] : self.places[name] + len(data)] = data
        return whole

    def _ordered(self, weight: Tensor, units: int, width: int, together: int) -> Tensor:
        """Weights (units, width) as threads read them, part after part.

        For so many units ``together`` and 16 columns at a time, every thread of a warp finds its operands of
        `mma.m16n8k16` side by side (PTX ISA, "Matrix fragments for mma.m16n8k16"); of the head's units, columns
        come first. Each weight is the sum of `parts` bfloat16 numbers, and the kernel reads this order.
        """
        rest = padded(weight, (units, width))
        parts = []
        for _ in range(self.parts):
            parts.append(rest.to(torch.bfloat16))
            rest = rest - parts[-1].float()
        # units: blocks, 8 (a lane's group); columns: blocks, upper half, a lane's place in its group, pair.
        split = torch.stack(parts).view(
            -1, units // together, together // 8, 8, width // 16, 2, 4, 2
        )
        return split.permute(
            0, *((1, 4, 3, 6, 2, 5, 7) if together == 16 else (4, 1, 3, 6, 2, 5, 7))
        )


def up(number: int, step: int) -> int:
    """The next multiple of a step."""
    return -(-number // step) * step


def padded(x: Tensor, shape: Sequence[int]) -> Tensor:
    """With zeros at the ends of all axes."""
    missing = [want - have for have, want in zip(x.shape, shape, strict=True)]
    gaps = [gap for n in reversed(missing) for gap in (0, n)]
    return functional.pad(x, gaps)
