"""Branch and bound over cells of the start set: each is proved as a whole, split, or refuted by a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rans.errors import ConfigError
from rans_proof.network import Layer, apply
from rans_proof.plants import LinearPlant, Piece, Plant
from rans_proof.polynomial import PolynomialPlant
from rans_proof.problem import Avoid, KeepOut, Problem, SpeedLimit, Within
from rans_proof.relaxation import TorchLayer, Zonotope, enclose

_DIRECTIONS = 64
"""Directions of a speed: their polygon is outside the circle by a factor of 1 / cos(pi / 64), 0.12 %."""
_BATCH = {"cpu": 512, "cuda": 8192}
"""Cells proved together."""
_MOST_CELLS = 20_000_000
"""Cells that are looked at; more are a problem for another method."""


@dataclass(frozen=True)
class Proof:
    """What is known of every start."""

    problem: Problem
    low: np.ndarray
    """(N, n) lower corners of proved cells."""
    high: np.ndarray
    """(N, n) upper corners."""
    margins: np.ndarray
    """(N,) proved margins."""
    open_low: np.ndarray
    """(M, n) lower corners of cells that were neither proved nor refuted."""
    open_high: np.ndarray
    counterexample: np.ndarray | None
    """(n,) a start whose flight breaks the property, if one was found."""

    @property
    def is_whole(self) -> bool:
        """Whether the property is proved from every start."""
        return len(self.open_low) == 0 and self.counterexample is None

    @property
    def volume(self) -> float:
        """Part of the volume of the start set that is proved."""
        span = np.array(self.problem.upper) - np.array(self.problem.lower)
        wide = span > 0
        return float(np.prod((self.high - self.low)[:, wide] / span[wide], axis=1).sum())


def prove(
    problem: Problem,
    layers: Sequence[Layer],
    device: str = "cpu",
    smallest: float = 1.0 / 512,
    first: Sequence[int] | None = None,
    report: Callable[[int, int], object] = lambda proved, left: None,
) -> Proof:
    """Prove that the closed loop of a network keeps a property from every start, or find where it does not.

    Args:
        problem: plant, starts and property.
        layers: network, which takes the state and gives the commands.
        device: "cpu" or "cuda".
        smallest: cells are not split below this part of the start set along a state.
        first: number of cells along each state to begin with; None: one.
        report: called after every batch with the numbers of proved cells and of cells that are left.

    Raises:
        ConfigError: network and problem do not fit, or more than twenty million cells are left.
    """
    if layers[0].weight.shape[1] != problem.states or len(layers[-1].bias) != problem.commands:
        raise ConfigError(
            f"the network takes {layers[0].weight.shape[1]} numbers and gives {len(layers[-1].bias)}, and the "
            f"problem has {problem.states} states and {problem.commands} commands."
        )
    loop = ClosedLoop(problem, layers, torch.device(device))
    span = np.maximum(np.array(problem.upper) - np.array(problem.lower), 1e-300)
    batch = _BATCH[loop.device.type]
    # Cells that are proved, with their margins; too small to split; and still to examine, the last first.
    proved: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    stuck: list[tuple[np.ndarray, np.ndarray]] = []
    queue = [_grid(problem, first or [1] * problem.states)]
    proved_count = 0
    examined = 0
    while queue:
        low, high = queue.pop()
        if len(low) > batch:
            queue.append((low[batch:], high[batch:]))
            low, high = low[:batch], high[:batch]
        examined += len(low)
        if examined > _MOST_CELLS:
            raise ConfigError(
                f"more than {_MOST_CELLS:,} cells are left; the property may be false."
            )
        margins, worth = loop.margins(low, high)
        holds = margins > 0.0
        proved.append((low[holds], high[holds], margins[holds]))
        proved_count += int(holds.sum())
        low, high, worth = low[~holds], high[~holds], worth[~holds]
        if len(low):
            # A flight from an open cell that breaks the property ends the proof; else the cell is split.
            broken = broken_start(problem, layers, low, high)
            if broken is not None:
                return _proof(problem, proved, [*stuck, *queue, (low, high)], broken)
            splittable = high - low > smallest * span * (1.0 + 1e-9)
            small = ~splittable.any(axis=1)
            stuck.append((low[small], high[small]))
            low, high = _halves(
                low[~small], high[~small], np.where(splittable, worth, -1.0)[~small]
            )
            if len(low):
                queue.append((low, high))
        report(proved_count, sum(len(cells) for cells, _ in queue))
    return _proof(problem, proved, stuck, None)


def _proof(
    problem: Problem,
    proved: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    stuck: list[tuple[np.ndarray, np.ndarray]],
    broken: np.ndarray | None,
) -> Proof:
    """Proof of cells (low, high, margin), with the cells that are open and a start that breaks the property."""
    none = np.zeros((0, problem.states))
    low, high, margins = (np.concatenate([cell[k] for cell in proved]) for k in range(3))
    ends = [np.concatenate([none, *(cell[k] for cell in stuck)]) for k in range(2)]
    return Proof(problem, low, high, margins, ends[0], ends[1], broken)


def _grid(problem: Problem, first: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, n) of equal cells; neighbours share their edges bit for bit."""
    edges = [
        np.append(low + (high - low) * (np.arange(count) / count), high)
        for low, high, count in zip(problem.lower, problem.upper, first, strict=True)
    ]
    lows = np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij")
    highs = np.meshgrid(*(edge[1:] for edge in edges), indexing="ij")
    low, high = (np.stack([grid.ravel() for grid in grids], axis=1) for grids in (lows, highs))
    return low, high


def _halves(low: np.ndarray, high: np.ndarray, worth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both halves of each cell, split along the state that is worth most."""
    rows = np.arange(len(low))
    axis = worth.argmax(axis=1)
    middle = 0.5 * (low[rows, axis] + high[rows, axis])
    below = high.copy()
    below[rows, axis] = middle
    above = low.copy()
    above[rows, axis] = middle
    return np.concatenate([low, above]), np.concatenate([below, high])


def broken_start(
    problem: Problem, layers: Sequence[Layer], low: np.ndarray, high: np.ndarray
) -> np.ndarray | None:
    """A start among the centres of cells whose simulated flight breaks the property, or None."""
    start = 0.5 * (low + high)
    least = lowest_margins(problem, layers, start)
    worst = int(least.argmin())
    return start[worst] if least[worst] < 0.0 else None


def lowest_margins(problem: Problem, layers: Sequence[Layer], start: np.ndarray) -> np.ndarray:
    """Lowest margins (N,) of simulated flights from starts (N, n), by Runge-Kutta steps of order 4."""
    substeps = 4
    h = problem.period / substeps
    x = start
    least = problem.keep.margins(x)
    for _ in range(problem.steps):
        u = list(apply(list(layers), x).T)

        def rate(state: np.ndarray, held: Sequence[np.ndarray] = u) -> np.ndarray:
            rates = problem.rates(list(state.T), held)
            return np.stack(
                [np.broadcast_to(polynomial, len(state)) for polynomial in rates], axis=1
            )

        for _ in range(substeps):
            k1 = rate(x)
            k2 = rate(x + 0.5 * h * k1)
            k3 = rate(x + 0.5 * h * k2)
            k4 = rate(x + h * k3)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            least = np.minimum(least, problem.keep.margins(x))
    return least if problem.end is None else np.minimum(least, problem.end.margins(x))


class ClosedLoop:
    """Closed loop of a problem and a network on a device."""

    def __init__(self, problem: Problem, layers: Sequence[Layer], device: torch.device) -> None:
        self.problem = problem
        self.device = device
        self._layers = [
            TorchLayer(
                torch.tensor(layer.weight, dtype=torch.float64, device=device),
                torch.tensor(layer.bias, dtype=torch.float64, device=device),
                layer.activation,
            )
            for layer in layers
        ]
        plant = PolynomialPlant if problem.linear() is None else LinearPlant
        self._plant: Plant = plant(problem, device)
        angles = 2.0 * torch.pi * torch.arange(_DIRECTIONS, dtype=torch.float64) / _DIRECTIONS
        self._round = torch.stack((angles.cos(), angles.sin()), 1).to(device)

    @torch.no_grad()
    def margins(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Proved margins (N,) of cells over all times, and what a split along each state is worth (N, n)."""
        ends = [torch.tensor(x, dtype=torch.float64, device=self.device) for x in (low, high)]
        radius = 0.5 * (ends[1] - ends[0])
        centre = 0.5 * (ends[0] + ends[1])
        # The centre and radius are rounded, which the box makes up for.
        box = 2.0**-51 * (ends[0].abs() + ends[1].abs())
        states = Zonotope(centre, torch.diag_embed(radius), box)
        least = torch.full_like(centre[:, 0], torch.inf)
        for _ in range(self.problem.steps):
            planes = enclose(self._layers, states)
            for piece in self._plant.move(states, planes):
                least = torch.minimum(least, self._margin(piece))
                states = piece.end
            if not bool((least > 0.0).any()):
                break
        if self.problem.end is not None:
            still = Piece(states, states, torch.zeros_like(centre))
            least = torch.minimum(least, self._within(still, self.problem.end))
        first = self._layers[0].weight
        worth = radius * torch.linalg.vector_norm(first, dim=0)
        return least.nan_to_num(-torch.inf).cpu().numpy(), worth.cpu().numpy()

    def _margin(self, piece: Piece) -> Tensor:
        """Margin (B,) over all times of a piece."""
        keep = self.problem.keep
        if isinstance(keep, Avoid):
            return self._apart(piece, keep)
        if isinstance(keep, Within):
            return self._within(piece, keep)
        ends = (piece.begin, piece.end)
        position = list(keep.position)
        middle = ends[0].centre[:, position] + ends[1].centre[:, position]
        ahead = middle / torch.linalg.vector_norm(middle, dim=1, keepdim=True).clamp(min=1e-12)
        ahead = ahead * (1.0 - 1e-14)  # no longer than 1, despite its rounding
        if isinstance(keep, KeepOut):
            return self._out(piece, keep, ahead)
        return self._slow(piece, keep, ahead)

    def _apart(self, piece: Piece, keep: Avoid) -> Tensor:
        """Distance from a box along one axis that serves for the whole piece."""
        lower = torch.tensor(keep.lower, dtype=torch.float64, device=self.device)
        upper = torch.tensor(keep.upper, dtype=torch.float64, device=self.device)
        axes = torch.eye(len(lower), dtype=torch.float64, device=self.device)[None]
        ends = (piece.begin, piece.end)
        highest = torch.stack([end.highest(axes) for end in ends]).amax(dim=0) + piece.sag
        lowest = -torch.stack([end.highest(-axes) for end in ends]).amax(dim=0) - piece.sag
        return torch.maximum(lower - highest, lowest - upper).amax(dim=1)

    def _within(self, piece: Piece, keep: Within) -> Tensor:
        """Distance from the faces of a box, from inside."""
        lower, upper = (
            torch.tensor(x, dtype=torch.float64, device=self.device)
            for x in (keep.lower, keep.upper)
        )
        axes = torch.eye(len(lower), dtype=torch.float64, device=self.device)[None]
        inner = [
            torch.minimum(upper - end.highest(axes), -lower - end.highest(-axes))
            for end in (piece.begin, piece.end)
        ]
        return (torch.minimum(*inner) - piece.sag).amin(dim=1)

    def _out(self, piece: Piece, keep: KeepOut, ahead: Tensor) -> Tensor:
        """Distance from a ball: |p| >= d p in any direction d, least at an end of the chord."""
        position = list(keep.position)
        row = torch.zeros(
            (len(ahead), 1, self.problem.states), dtype=torch.float64, device=self.device
        )
        row[:, 0, position] = -ahead
        nearest = torch.stack([-end.highest(row)[:, 0] for end in (piece.begin, piece.end)])
        sag = torch.linalg.vector_norm(piece.sag[:, position], dim=1)
        return nearest.amin(dim=0) - sag * (1.0 + 1e-9) - keep.radius * (1.0 + 1e-14)

    def _slow(self, piece: Piece, keep: SpeedLimit, ahead: Tensor) -> Tensor:
        """Margin of a speed limit.

        In any direction d, |p| >= d p; and |v| <= max over e of e v / cos(pi / K) for K directions e. The sum of
        both is linear, so that over the chord of the piece it is largest at an end.
        """
        position, velocity = list(keep.position), list(keep.velocity)
        ends = (piece.begin, piece.end)
        functions = torch.zeros(
            (len(ahead), _DIRECTIONS, self.problem.states), dtype=torch.float64, device=self.device
        )
        stretched = self._round / np.cos(np.pi / _DIRECTIONS) * (1.0 + 1e-14)
        functions[:, :, velocity] = stretched
        functions[:, :, position] -= keep.slope * ahead[:, None, :]
        highest = torch.stack([end.highest(functions).amax(dim=1) for end in ends]).amax(dim=0)
        sag = torch.linalg.vector_norm(piece.sag[:, velocity], dim=1)
        sag = sag + keep.slope * torch.linalg.vector_norm(piece.sag[:, position], dim=1)
        return keep.base - highest - sag * (1.0 + 1e-9)
