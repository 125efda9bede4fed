"""Linear enclosures of activations and of whole networks over zonotopes, batched in torch.

A zonotope is {c + G s + r t: s in [-1, 1]^m, t in [-1, 1]^n, element by element}. Over it an activation lies
between two parallel lines (Singh et al., "Fast and effective robustness certification", 2018), so the network
between two parallel planes of the state. Every result is widened by a bound of its rounding: a sum of N products in
double precision errs by at most N u / (1 - N u) times the sum of their absolute values, with u = 2^-53 (Higham,
"Accuracy and stability of numerical algorithms", 3.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

_UNIT = 2.0**-53
"""Unit roundoff of double precision."""
_ULPS = 8.0
"""Errors of tanh, in units in the last place; of libraries in use they are below 2, in single precision below 5."""


class Rounding(NamedTuple):
    """Sizes of the terms of a layer's sums, as a machine rounds them one operation after the other."""

    weight: Any
    """(outputs, inputs) sums of absolute products along the joined operations; an array, or a tensor."""
    bias: Any
    """(outputs,)."""
    times: int
    """Roundings of a term at most."""
    unit: float
    """Unit roundoff of the file's precision."""
    growth: tuple[float, float]
    """Factor and constant of a bound of all partial sums by the largest number that the layer takes, 1 at least."""
    largest: float
    """Largest bound of a partial sum that surely is a number of the file's precision."""

    @property
    def part(self) -> float:
        """Error of a sum at most, a part of the size of its terms, in any order of summation.

        Higham, "Accuracy and stability of numerical algorithms", 3.1.
        """
        return self.times * self.unit / (1.0 - self.times * self.unit)


class Layer(NamedTuple):
    """Layer y = activation(weight x + bias)."""

    weight: Any
    """(outputs, inputs), an array, or a tensor where sets of states go through it."""
    bias: Any
    """(outputs,)."""
    activation: str
    """ "tanh", "sigmoid", "relu" or "" for none."""
    rounding: Rounding | None = None
    """None: computed exactly."""


def layer_tensors(layers: Sequence[Layer], device: torch.device) -> list[Layer]:
    """Layers of arrays as layers of double tensors on a device."""

    def tensor(array: Any) -> Tensor:
        return torch.tensor(array, dtype=torch.float64, device=device)

    result = []
    for weight, bias, activation, machine in layers:
        if machine is not None:
            machine = machine._replace(weight=tensor(machine.weight), bias=tensor(machine.bias))
        result.append(Layer(tensor(weight), tensor(bias), activation, machine))
    return result


class Zonotope(NamedTuple):
    """Sets of states, B of them."""

    centre: Tensor
    """(B, n)."""
    generators: Tensor
    """(B, n, m)."""
    box: Tensor
    """(B, n) radii of a box that is added."""

    @property
    def radius(self) -> Tensor:
        """(B, n) half widths of the smallest boxes around the sets."""
        return self.generators.abs().sum(dim=2) + self.box

    @property
    def size(self) -> Tensor:
        """(B, n) largest absolute value of each coordinate."""
        return self.centre.abs() + self.radius

    def highest(self, direction: Tensor) -> Tensor:
        """(B, k) largest values of linear functions (B or 1, k, n), rounded up."""
        value = direction @ self.centre[:, :, None]
        spread = (direction @ self.generators).abs().sum(dim=2, keepdim=True)
        spread = spread + direction.abs() @ self.box[:, :, None]
        count = self.centre.shape[1] + self.generators.shape[2] + 4
        error = 4.0 * count * _UNIT * (direction.abs() @ self.size[:, :, None])
        return (value + spread + error)[:, :, 0]


class Planes(NamedTuple):
    """Enclosure of a network over a zonotope: outputs lie in gain x + offset +- error."""

    gain: Tensor
    """(B, p, n)."""
    offset: Tensor
    """(B, p)."""
    error: Tensor
    """(B, p)."""


def rounding_error(rounding: Rounding, reach: Tensor) -> Tensor:
    """Errors (B, outputs) of a machine's sums over numbers of absolute values up to (B, inputs).

    Infinite where a partial sum, in any order, may be too large for the machine's precision.
    """
    off = (reach @ rounding.weight.T + rounding.bias) * (rounding.part * (1.0 + 1e-9))
    factor, constant = rounding.growth
    sums = factor * reach.amax(dim=1, keepdim=True).clamp(min=1.0) + constant
    return torch.where(sums < rounding.largest, off, torch.inf)


def parallel_lines(low: Tensor, high: Tensor, activation: str) -> tuple[Tensor, Tensor, Tensor]:
    """Slope, offset and error of lines around an activation on [low, high].

    The slope is that of the chord. A function minus a line is extreme at the ends or where the slopes are equal: of
    tanh where tanh^2 = 1 - slope. An error of the point where they are equal hardly changes the value there. A
    rectifier minus a line is extreme at the ends or at 0. All are tensors of one shape.
    """
    if activation == "relu":
        slope = ((high.relu() - low.relu()) / (high - low).clamp(min=1e-9)).clamp(0.0, 1.0)
        points = (low, high, torch.zeros_like(low).clamp(min=low, max=high))
        corners = torch.stack([z.relu() - slope * z for z in points])
        lowest = corners.amin(dim=0)
        highest = corners.amax(dim=0)
        rounding = 4.0 * _ULPS * _UNIT * torch.maximum(low.abs(), high.abs())
        return slope, 0.5 * (highest + lowest), 0.5 * (highest - lowest) + rounding
    scale = 1.0 if activation == "tanh" else 0.5  # sigmoid(z) = 1/2 + tanh(z / 2) / 2
    low = scale * low
    high = scale * high
    width = (high - low).clamp(min=1e-9)
    slope = ((torch.tanh(high) - torch.tanh(low)) / width).clamp(0.0, 1.0)
    point = torch.atanh(torch.sqrt(1.0 - slope).clamp(max=1.0 - 1e-16))
    points = (low, high, point.clamp(min=low, max=high), (-point).clamp(min=low, max=high))
    corners = torch.stack([torch.tanh(z) - slope * z for z in points])
    lowest = corners.amin(dim=0)
    highest = corners.amax(dim=0)
    size = 1.0 + slope * torch.maximum(low.abs(), high.abs())
    error = 0.5 * (highest - lowest) + 4.0 * _ULPS * _UNIT * size
    offset = 0.5 * (highest + lowest)
    if activation == "tanh":
        return slope, offset, error
    return 0.25 * slope, 0.5 + 0.5 * offset, 0.5 * error + _ULPS * _UNIT


_BENDS = {"tanh": torch.tanh, "sigmoid": torch.sigmoid, "relu": torch.relu}


def enclose(layers: Sequence[Layer], states: Zonotope) -> Planes:
    """Planes around a network over zonotopes, as a machine computes it that rounds each layer.

    Errors of an activation stay linear until they reach the output, so that those of several layers may cancel.

    Planes may be too wide, never too narrow; `tests/test_soundness.py` breaks lines of it by their text.
    """
    count, width = states.centre.shape
    eye = torch.eye(width, dtype=states.centre.dtype, device=states.centre.device)
    gain = eye.expand(count, -1, -1)  # (B, n, units): one product then serves all sets
    offset = torch.zeros_like(states.centre)
    slopes: list[Tensor] = []
    errors: list[Tensor] = []
    size = states.size  # bound of the absolute values that are summed, for rounding
    rounding = torch.zeros_like(states.centre)
    reach = states.size  # largest absolute values of what a layer takes
    depth = 0
    # Layer by layer; errors of earlier activations are carried on linearly.
    for number, (weight, bias, activation, machine) in enumerate(layers):
        depth += weight.shape[1] + 4
        gain = gain @ weight.T
        offset = offset @ weight.T + bias
        size = size @ weight.abs().T + bias.abs()
        rounding = rounding @ weight.abs().T + 2.0 * depth * _UNIT * size
        wrong = torch.zeros_like(offset) if machine is None else rounding_error(machine, reach)
        error = rounding + _passed(layers, slopes, errors, number) + wrong
        if not activation:
            return Planes(gain.mT, offset, error)
        middle = _rows(gain, states.centre) + offset
        spread = (states.generators.mT @ gain).abs().sum(dim=1)
        spread = spread + _rows(gain.abs(), states.box) + error
        low = middle - spread
        high = middle + spread
        slope, shift, half = parallel_lines(low, high, activation)
        bend = 0.0 if machine is None or activation == "relu" else _ULPS * machine.unit
        half = half + slope * wrong + bend
        reach = torch.maximum(*(_BENDS[activation](z).abs() for z in (low, high))) + bend + 1e-15
        slopes.append(slope)
        errors.append(half)
        gain = gain * slope[:, None, :]
        offset = slope * offset + shift
        rounding = slope * rounding
        size = slope * size + shift.abs() + half
    error = rounding + slopes[-1] * _passed(layers, slopes, errors, len(layers) - 1) + errors[-1]
    return Planes(gain.mT, offset, error + 4.0 * depth * _UNIT * size)


def _rows(gain: Tensor, values: Tensor) -> Tensor:
    """Products (B, units) of a gain (B, n, units) and values (B, n)."""
    return (values[:, None, :] @ gain)[:, 0]


def _passed(
    layers: Sequence[Layer], slopes: Sequence[Tensor], errors: Sequence[Tensor], number: int
) -> Tensor:
    """What errors of earlier activations add up to at the sums of a layer, (B, units).

    Each may be too large, never too small: planes are as wide as it says.
    """
    if number == 0:
        return torch.zeros(
            (1, len(layers[0].bias)), dtype=torch.float64, device=layers[0].bias.device
        )
    weight = layers[number].weight
    total = errors[number - 1] @ weight.abs().T
    back = weight
    for k in reversed(range(number - 1)):
        back = (back * slopes[k + 1][:, None, :]) @ layers[k + 1].weight
        total = total + (back.abs() @ errors[k][:, :, None])[:, :, 0]
    return total
