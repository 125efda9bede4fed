"""How the weights of an actor-critic lie in memory where its gradient is made without autograd."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from rans.compile.cuda.design import DoesNotFit, padded, up
from rans.policy.activations import WITH_SLOPE
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.capabilities import Capabilities


class Places(NamedTuple):
    """Where a matrix is among all weights, of which each number is the difference of two, or one and zero."""

    plus: Tensor
    minus: Tensor


@dataclass(frozen=True)
class UpdateDesign:
    """Layout of a network with this architecture, whose layers have idle units up to a multiple of 16.

    A critic of its own lies beside the policy: one first layer that both are rows of, a second layer for
    each, and one output of both, in which the other's weights are idle.

    Raises:
        DoesNotFit: the network is of another kind.
    """

    given: Architecture

    def __post_init__(self) -> None:
        architecture = self.given
        can = Capabilities(heads=("on-off",), activations=WITH_SLOPE)
        if lacking := can.missing(architecture):
            raise DoesNotFit(lacking)
        if len(architecture.layers) != 2:
            raise DoesNotFit(f"{len(architecture.layers)} layers; it has two")

    @property
    def trunks(self) -> int:
        """Networks beside each other."""
        return 2 if self.given.privileged else 1

    @property
    def columns(self) -> int:
        """Numbers that the first layer is given, at last what only the critic is told."""
        architecture = self.given
        return architecture.inputs + architecture.privileged

    @property
    def inputs(self) -> int:
        """The same with a one, whose weights are the biases, and zeros."""
        return up(self.columns + 1, 16)

    @property
    def widths(self) -> tuple[int, int]:
        """Units of both layers of a trunk, with idle ones."""
        first, second = (up(units, 16) for units in self.given.layers)
        return first, second

    @property
    def heads(self) -> int:
        """Outputs, with idle ones."""
        return up(self.given.thrusters + 1, 16)

    @cached_property
    def sums(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the gradients, which lie one after the other, before the statistics.

        In this order they lie in one row, from which `places` and `matrices` take their parts.
        """
        first, second = self.widths
        firsts = first * self.trunks
        seconds = second * self.trunks
        return {
            "second": (seconds, first),
            "first": (firsts, self.inputs),
            "head": (seconds, self.heads),
            "bias": (seconds,),
            "constant": (self.heads,),
        }

    @property
    def end(self) -> int:
        """Number of the sums, behind which statistics stand."""
        return sum(math.prod(shape) for shape in self.sums.values())

    def matrices(self, weights: Tensor) -> list[Tensor]:
        """Both layers' (units, inputs), the heads' and what rounding leaves of them, from one row."""
        first = self.sums["first"]
        second = self.sums["second"]
        head = self.sums["head"][::-1]
        shapes = [first, second, head, head]
        parts = weights.split([rows * columns for rows, columns in shapes])
        return [
            part.view(rows, columns) for part, (rows, columns) in zip(parts, shapes, strict=True)
        ]

    def places(self, positions: Mapping[str, Tensor], zero: int) -> dict[str, Places]:
        """Of the matrices of `sums`, from the place of every weight by name."""

        def one(name: str) -> tuple[Tensor, Tensor]:
            return positions[f"{name}.weight"], positions[f"{name}.bias"]

        def beside(layers: Iterable[Tensor], *shape: int) -> tuple[Tensor]:
            return (torch.cat([padded(x, shape, zero) for x in layers]),)

        # Layers of both trunks side by side, then the heads below each other.
        names = ("trunk", "critic")[: self.trunks]
        (width, features) = self.widths
        first, bias = zip(*(one(f"{EXTRACTOR}{name}.0") for name in names), strict=True)
        second, bias_2 = zip(*(one(f"{EXTRACTOR}{name}.2") for name in names), strict=True)
        wide = [padded(x, (len(x), self.columns), zero) for x in first]
        first = [torch.cat((x, shift[:, None]), dim=1) for x, shift in zip(wide, bias, strict=True)]
        # Of two logits a thruster, their difference counts (`Network._heads`); values are of the last trunk.
        (action, shift) = one("action_net")
        (value, constant) = one("value_net")
        action = padded(action, (len(action), features * self.trunks), zero)
        value = functional.pad(value, ((self.trunks - 1) * features, 0), value=zero)
        value = padded(value, (1, features * self.trunks), zero)
        head = (
            torch.cat((action[1::2], value)),
            torch.cat((action[0::2], torch.full_like(value, zero))),
        )
        shifts = (
            torch.cat((shift[1::2], constant)),
            torch.cat((shift[0::2], torch.full_like(constant, zero))),
        )
        result = {
            "second": beside(second, features, width),
            "first": beside(first, width, self.inputs),
            "head": tuple(x.T for x in head),
            "bias": beside(bias_2, features),
            "constant": shifts,
        }
        filled = {
            name: [padded(x, self.sums[name], zero) for x in pair] for name, pair in result.items()
        }
        return {
            name: Places(pair[0], pair[-1] if len(pair) > 1 else torch.full_like(pair[0], zero))
            for name, pair in filled.items()
        }
