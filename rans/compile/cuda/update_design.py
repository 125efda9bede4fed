"""How the weights of an actor-critic lie in memory where its gradient is made without autograd."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from inspect import signature
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from rans.compile import loss_gradient
from rans.compile.cuda.design import DoesNotFit, padded, up
from rans.compile.cuda.source import Lines, indented
from rans.compile.loss_gradient import STATISTICS
from rans.model.trace import Symbol
from rans.policy.activations import ACTIVATIONS, WITH_SLOPE
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.capabilities import Capabilities

WARPS = 8
"""Of the kernel's block, of which a multiprocessor has one; each takes 16 samples of a tile."""
PAD = 8
"""Numbers between the rows of a matrix, so that eight rows meet all banks of shared memory."""
_WIDEST = 128
_MOST_INPUTS = 64
"""Gradients of larger weights would not stay in the kernel's registers."""


class Places(NamedTuple):
    """Where a matrix is among all weights, of which each number is the difference of two, or one and zero."""

    plus: Tensor
    minus: Tensor


@dataclass(frozen=True)
class UpdateDesign:
    """Of a network with this architecture, whose layers have idle units up to a multiple of ``step``.

    A critic of its own lies beside the policy: one first layer that both are rows of, a second layer for
    each, and one output of both, in which the other's weights are idle.

    Raises:
        DoesNotFit: the network is of another kind.
    """

    given: Architecture
    step: int = 16

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
        first, second = (up(units, self.step) for units in self.given.layers)
        return first, second

    @property
    def heads(self) -> int:
        """Outputs, with idle ones."""
        return up(self.given.thrusters + 1, 16)

    @cached_property
    def sums(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the gradients, which lie one after the other, before the statistics."""
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
    def size(self) -> int:
        """Numbers of all sums."""
        return up(self.end + STATISTICS, 4)

    @property
    def end(self) -> int:
        """Of the sums, where statistics begin."""
        return sum(math.prod(shape) for shape in self.sums.values())

    def matrices(self, weights: Tensor) -> list[Tensor]:
        """Both layers' (units, inputs), the heads' and what rounding leaves of them, from one row."""
        first = self.sums["first"]
        second = self.sums["second"]
        head = self.sums["head"][::-1]
        shapes = [first, second, head, head]
        parts = weights.split([rows * (columns + PAD) for rows, columns in shapes])
        return [
            part.view(rows, -1)[:, :columns]
            for part, (rows, columns) in zip(parts, shapes, strict=True)
        ]

    def places(self, positions: Mapping[str, Tensor], zero: int) -> dict[str, Places]:
        """Of the matrices of `sums`, from the place of every weight by name."""

        def one(name: str) -> tuple[Tensor, Tensor]:
            return positions[f"{name}.weight"], positions[f"{name}.bias"]

        def beside(layers: Iterable[Tensor], *shape: int) -> tuple[Tensor]:
            return (torch.cat([padded(x, shape, zero) for x in layers]),)

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


class KernelDesign(UpdateDesign):
    """In shared memory of so many bytes a block; DoesNotFit where that or registers are too few."""

    def __init__(self, architecture: Architecture, shared: int) -> None:
        super().__init__(architecture, 64)
        if architecture.privileged:
            raise DoesNotFit("a critic of its own")
        if max(architecture.layers) > _WIDEST or self.inputs > _MOST_INPUTS:
            raise DoesNotFit(
                f"{self.columns} inputs and layers of {architecture.layers} units; it has for "
                f"{_MOST_INPUTS - 1} inputs and two layers of {_WIDEST}"
            )
        if self.used > shared:
            raise DoesNotFit(f"{self.used:,} bytes of shared memory a block; there are {shared:,}")

    @property
    def used(self) -> int:
        """Bytes of shared memory of a block."""
        first, second = self.widths
        rows = 16 * WARPS
        weights = (
            first * (self.inputs + PAD) + second * (first + PAD) + 2 * self.heads * (second + PAD)
        )
        exchanged = rows * (self.inputs + 2 * first + 2 * second + self.heads + 6 * PAD)
        return 2 * (weights + exchanged) + 4 * (second + self.heads)

    def source(self) -> str:
        """CUDA C++ of the kernel ``gradient``, see ``update.cuh``."""
        first, second = self.widths
        numbers = {
            "INPUTS": self.inputs,
            "FIRST": first,
            "SECOND": second,
            "HEADS": self.heads,
            "THRUSTERS": self.given.thrusters,
            "WARPS": WARPS,
            "PAD": PAD,
            "SUMS": self.size,
            "STATISTICS": STATISTICS,
        }
        texts = [
            files("rans.compile.cuda").joinpath(name).read_text()
            for name in ("functions.cuh", "warp.cuh", "policy.cuh", "losses.cuh", "update.cuh")
        ]
        return "\n".join(
            (
                "typedef float real;",
                *texts[:3],
                f"typedef {self.given.activation.capitalize()} Activation;",
                *(f"constexpr int {name} = {number};" for name, number in numbers.items()),
                _slope(self.given.activation),
                *_losses(),
                *texts[3:],
            )
        )


class _QuickLines(Lines):
    """Lines whose divisions are to two units in the last place, as `__fdividef` computes them."""

    def expression(self, symbol: Symbol, args: list[str]) -> str:
        if symbol.operation == "/":
            return f"__fdividef({args[0]}, {args[1]})"
        return super().expression(symbol, args)


def _function(name: str, inputs: Sequence[Symbol], results: Mapping[str, Symbol]) -> str:
    """CUDA C++ of a function that gives results by reference."""
    lines = _QuickLines()
    body = [*lines.values(results.values())]
    body += [f"{result} = {lines.operand(value)};" for result, value in results.items()]
    arguments = [f"const real {operand.value}" for operand in inputs]
    arguments += [f"real& {result}" for result in results]
    return "\n".join(
        (f"__device__ inline void {name}({', '.join(arguments)}) {{", *indented(body), "}")
    )


def _inputs(function: Callable[..., object]) -> list[Symbol]:
    """Symbols of a function's arguments, with their names."""
    return [Symbol.input(name) for name in signature(function).parameters]


def _slope(activation: str) -> str:
    """CUDA C++ of ``slope``, the derivative of an activation from its value."""
    derivative = ACTIVATIONS[activation].slope
    assert derivative is not None
    value = Symbol.input("value")
    lines = _QuickLines()
    body = [*lines.values([derivative(value)]), f"return {lines.operand(derivative(value))};"]
    return "\n".join(("__device__ inline float slope(const real value) {", *indented(body), "}"))


def _losses() -> Iterator[str]:
    """CUDA C++ of the functions of `rans.compile.loss_gradient`."""
    inputs = _inputs(loss_gradient.opening_term)
    results = loss_gradient.opening_term(*inputs)._asdict()
    yield _function("choice", inputs, results)
    inputs = _inputs(loss_gradient.transition_losses)
    d_log_prob, d_value, statistics = loss_gradient.transition_losses(*inputs)
    results = {"d_log_prob": d_log_prob, "d_value": d_value}
    results |= {f"statistic_{k}": value for k, value in enumerate(statistics)}
    yield _function("transition_losses", inputs, results)
    inputs = _inputs(loss_gradient.d_logit)
    yield _function("d_logit", inputs, {"result": loss_gradient.d_logit(*inputs)})
