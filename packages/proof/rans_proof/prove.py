"""Branch and bound over cells of the start set: each is proved as a whole, split, or refuted by a flight.

A margin must be a lower bound with all rounding; `rans_proof.check` judges the certificate without this code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.extend import ConfigError
from rans_proof.flights import at_decisions, lowest_margins, worst_start
from rans_proof.motion import TaylorPlant
from rans_proof.network import Layer
from rans_proof.plants import LinearPlant, Piece, Plant
from rans_proof.problem import Distances, HalfSpaces, Problem
from rans_proof.relaxation import Planes, Zonotope, enclose, layer_tensors

_DIRECTIONS = 64
"""Directions of a speed: their polygon is outside the circle by a factor of 1 / cos(pi / 64), 0.12 %."""
_BATCH = {"cpu": 512, "cuda": 8192}
"""Cells proved together."""
_GENERATORS = 48
"""Generators of a set that are kept, at least, once there are twice as many."""
_FLAT = 1e-9
"""Side of a box, as a part of its set, below which it is flat."""
_SMALLER = 1.0 / 16.0
"""By how much a box's sides are shorter along main axes in the mean, as a logarithm, where these are taken."""
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
    flight: np.ndarray | None = None
    """(steps + 1, n) its states at the control instants."""

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
    taken = len(problem.inputs) or problem.states
    if layers[0].weight.shape[1] != taken or len(layers[-1].bias) != problem.commands:
        raise ConfigError(
            f"the network takes {layers[0].weight.shape[1]} numbers and gives {len(layers[-1].bias)}, and the "
            f"problem has {taken} {'inputs' if problem.inputs else 'states'} and {problem.commands} commands."
        )
    none = np.zeros((0, problem.states))
    # What is false is refuted sooner than proved in parts.
    start, margin = worst_start(problem, layers)
    if margin < 0.0:
        return _proof(problem, [(none, none, none[:, 0])], [], start, layers)
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
            low = low[:batch]
            high = high[:batch]
        examined += len(low)
        if examined > _MOST_CELLS:
            raise ConfigError(
                f"more than {_MOST_CELLS:,} cells are left; the property may be false."
            )
        margins, worth = loop.margins(low, high)
        holds = margins > 0.0
        proved.append((low[holds], high[holds], margins[holds]))
        proved_count += int(holds.sum())
        low = low[~holds]
        high = high[~holds]
        worth = worth[~holds]
        if len(low):
            # A flight from an open cell that breaks the property ends the proof; else the cell is split.
            broken = broken_start(problem, layers, low, high)
            if broken is not None:
                return _proof(problem, proved, [*stuck, *queue, (low, high)], broken, layers)
            splittable = high - low > smallest * span * (1.0 + 1e-9)
            small = ~splittable.any(axis=1)
            stuck.append((low[small], high[small]))
            low, high = _halves(
                low[~small], high[~small], np.where(splittable, worth, -1.0)[~small]
            )
            if len(low):
                queue.append((low, high))
        report(proved_count, sum(len(cells) for cells, _ in queue))
    return _proof(problem, proved, stuck, None, layers)


def _proof(
    problem: Problem,
    proved: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    stuck: list[tuple[np.ndarray, np.ndarray]],
    broken: np.ndarray | None,
    layers: Sequence[Layer],
) -> Proof:
    """Proof of cells (low, high, margin), with the cells that are open and a start that breaks the property.

    Cells are (K, states).
    """
    none = np.zeros((0, problem.states))
    low, high, margins = (np.concatenate([cell[k] for cell in proved]) for k in range(3))
    ends = [np.concatenate([none, *(cell[k] for cell in stuck)]) for k in range(2)]
    flight = None if broken is None else at_decisions(problem, layers, broken)
    return Proof(problem, low, high, margins, ends[0], ends[1], broken, flight)


def _grid(problem: Problem, first: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, n) of equal cells; neighbours share their edges bit for bit, and a state of one value has one.

    The checker asks that cells cover the starts: a gap of one rounding between neighbours would be refused.
    """
    edges = [
        np.append(low + (high - low) * (np.arange(count) / count), high)[-2 if low == high else 0 :]
        for low, high, count in zip(problem.lower, problem.upper, first, strict=True)
    ]
    lows = np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij")
    highs = np.meshgrid(*(edge[1:] for edge in edges), indexing="ij")
    low, high = (np.stack([grid.ravel() for grid in grids], axis=1) for grids in (lows, highs))
    return low, high


def _halves(low: np.ndarray, high: np.ndarray, worth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both halves of each cell (B, states), split along the state of the largest worth (B, states).

    All lower ones first.
    """
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


def reduced(states: Zonotope) -> Zonotope:
    """A zonotope of few generators around each of others, whose least ones become a box.

    The box is along their main axes where its sides are shorter: one along the states would grow without end in
    a loop that turns and shears it (Kopetzki, Schuermann and Althoff, "Methods for order reduction of zonotopes",
    2017). Which are the least is as in Girard, "Reachability of uncertain linear systems using zonotopes", 2005.
    Each box widens the set, so that sets are left as they are until they have twice the generators that are kept.
    """
    _, width, columns = states.generators.shape
    retained = max(_GENERATORS, 4 * width)
    if columns <= 2 * retained:
        return states
    scale = states.radius[:, :, None] + 1e-300
    part = states.generators / scale
    worth = part.abs().sum(dim=1) - part.abs().amax(dim=1)
    order = worth.argsort(dim=1, descending=True)[:, None, :].expand(-1, width, -1)
    ordered, part = (x.gather(2, order) for x in (states.generators, part))
    rest = ordered[:, :, retained:]
    part = part[:, :, retained:].nan_to_num(0.0, 0.0, 0.0)
    axes = torch.linalg.eigh(part @ part.mT)[1]
    eye = torch.eye(width, dtype=axes.dtype, device=axes.device).expand_as(axes)
    volumes = [((x.mT @ part).abs().sum(dim=2) + _FLAT).log().sum(dim=1) for x in (axes, eye)]
    axes = torch.where((volumes[0] < volumes[1] - width * _SMALLER)[:, None, None], axes, eye)
    # What is left of the least ones less their parts along the axes is rounding, which the box makes up for.
    along = (axes.mT / scale.mT) @ rest
    axes = scale * axes
    half = along.abs().sum(dim=2)[:, None, :] * (1.0 + 4.0 * columns * 2.0**-53)
    sums = axes.abs() @ along.abs() + rest.abs()
    left = (rest - axes @ along).abs() + 4.0 * width * 2.0**-53 * sums
    off = left.sum(dim=2) * (1.0 + 4.0 * columns * 2.0**-53)
    off = off + 2.0**-52 * (axes.abs() * half).sum(dim=2)
    return Zonotope(
        states.centre, torch.cat((ordered[:, :, :retained], axes * half), dim=2), states.box + off
    )


class ClosedLoop:
    """Closed loop of a problem and a network on a device: `margins` of sets of starts, with all rounding."""

    def __init__(self, problem: Problem, layers: Sequence[Layer], device: torch.device) -> None:
        self.problem = problem
        self.device = device
        self._layers = layer_tensors(layers, device)
        inputs = problem.network_inputs()
        self._inputs = None if inputs is None else [self._tensor(part) for part in inputs]
        plant = TaylorPlant if problem.linear() is None else LinearPlant
        self._plant: Plant = plant(problem, device)
        angles = 2.0 * torch.pi * torch.arange(_DIRECTIONS, dtype=torch.float64) / _DIRECTIONS
        self._round = torch.stack((angles.cos(), angles.sin()), 1).to(device)

    def _commands(self, states: Zonotope) -> Planes:
        """Planes around the commands of sets of states, by what the network takes of them."""
        if self._inputs is None:
            return enclose(self._layers, states)
        table, shift = self._inputs
        sums = states.size @ table.abs().T + shift.abs()
        taken = Zonotope(
            states.centre @ table.T + shift,
            table @ torch.cat((states.generators, torch.diag_embed(states.box)), dim=2),
            2.0**-50 * (states.centre.shape[1] + 4) * sums,
        )
        gain, offset, error = enclose(self._layers, taken)
        rounding = 2.0**-50 * len(table) * (gain.abs() @ sums[:, :, None])[:, :, 0]
        return Planes(gain @ table, gain @ shift + offset, error + rounding)

    def _tensor(self, array: Any) -> Tensor:
        return torch.tensor(array, dtype=torch.float64, device=self.device)

    @torch.no_grad()
    def margins(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Proved margins (N,) of cells over all times, and what a split along each state is worth (N, n).

        Cells are independent of each other, and a batch is only for speed. What is lost is dropped from it on the
        way.
        """
        ends = [self._tensor(x) for x in (low, high)]
        radius = 0.5 * (ends[1] - ends[0])
        centre = 0.5 * (ends[0] + ends[1])
        # The centre and radius are rounded, which the box makes up for.
        box = 2.0**-51 * (ends[0].abs() + ends[1].abs())
        states = Zonotope(centre, torch.diag_embed(radius), box)
        margins = torch.full_like(centre[:, 0], -torch.inf)
        least = torch.full_like(margins, torch.inf)
        at_end = torch.full_like(margins, -torch.inf)
        end = self.problem.end
        earliest = self.problem.earliest or self.problem.steps
        cells = torch.arange(len(margins), device=self.device)
        for number in range(self.problem.steps):
            planes = self._commands(states)
            # Lost cells would need ever shorter steps; so would those whose network may give no number.
            holds = (least > 0.0) & states.size.isfinite().all(dim=1)
            holds &= planes.error.isfinite().all(dim=1)
            margins[cells[~holds]] = torch.where(least > 0.0, -torch.inf, least)[~holds]
            cells = cells[holds]
            least = least[holds]
            at_end = at_end[holds]
            states = Zonotope(*(x[holds] for x in states))
            planes = Planes(*(x[holds] for x in planes))
            if not len(cells):
                break
            for piece in self._plant.move(states, planes):
                if self.problem.keep is not None and number >= self.problem.begins:
                    least = torch.minimum(least, self._margin(piece))
                states = piece.end
            if end is not None and number + 1 >= earliest:
                still = Piece(states, states, torch.zeros_like(states.centre))
                at_end = torch.maximum(at_end, self._faces(still, end.inside()))
            states = reduced(states)
        margins[cells] = least if end is None else torch.minimum(least, at_end)
        first = self._layers[0].weight
        first = first if self._inputs is None else first @ self._inputs[0]
        worth = radius * torch.linalg.vector_norm(first, dim=0)
        return margins.nan_to_num(-torch.inf).cpu().numpy(), worth.cpu().numpy()

    def _margin(self, piece: Piece) -> Tensor:
        """Margin (B,) over all times of a piece, by the kind of the property; above 0 is a proof for that piece.

        A lower bound with all rounding over both ends and, by the sag, all that lies between them.
        """
        keep = self.problem.keep
        assert keep is not None
        return (
            self._faces(piece, keep)
            if isinstance(keep, HalfSpaces)
            else self._distances(piece, keep)
        )

    def _faces(self, piece: Piece, keep: HalfSpaces) -> Tensor:
        """Least values (pieces,) of all linear functions together, or of the best one."""
        functions = self._tensor(keep.rows)
        constants = self._tensor(keep.offsets)
        lowest = torch.stack([-end.highest(-functions[None]) for end in (piece.begin, piece.end)])
        value = lowest.amin(dim=0) + constants - piece.sag @ functions.abs().T * (1.0 + 1e-9)
        value = value - 2.0**-50 * (lowest.abs().amax(dim=0) + constants.abs())
        return value.amin(dim=1) if keep.every else value.amax(dim=1)

    def _distances(self, piece: Piece, keep: Distances) -> Tensor:
        """Margin (B,) of base + slope |p| - |v|.

        In any direction d, |p| >= d p: along the middle of the chord. Beside it a velocity in the plane is at
        most the maximum over e of e v / cos(pi / K) for K directions e; a vector v alone is at most that to the
        farthest corner of the box around it. The sum of e v and -d p is linear, so that over the chord it is
        largest at an end.
        """
        position = list(keep.position)
        velocity = list(keep.velocity)
        ends = (piece.begin, piece.end)
        middle = ends[0].centre[:, position] + ends[1].centre[:, position]
        ahead = middle / torch.linalg.vector_norm(middle, dim=1, keepdim=True).clamp(min=1e-12)
        ahead = ahead * (1.0 - 1e-14)  # no longer than 1, despite its rounding
        is_joint = bool(position and velocity)
        functions = torch.zeros(
            (len(ahead), _DIRECTIONS if is_joint else 1, self.problem.states),
            dtype=torch.float64,
            device=self.device,
        )
        sag = keep.slope * torch.linalg.vector_norm(piece.sag[:, position], dim=1)
        corner = torch.zeros_like(sag)
        if is_joint:
            stretched = self._round / np.cos(np.pi / _DIRECTIONS) * (1.0 + 1e-14)
            functions[:, :, velocity] = stretched
            sag = sag + torch.linalg.vector_norm(piece.sag[:, velocity], dim=1)
        elif velocity:
            far = [
                torch.linalg.vector_norm((end.size + piece.sag)[:, velocity], dim=1) for end in ends
            ]
            corner = torch.maximum(*far) * (1.0 + 1e-9)
        functions[:, :, position] -= keep.slope * ahead[:, None, :]
        highest = torch.stack([end.highest(functions).amax(dim=1) for end in ends]).amax(dim=0)
        return keep.base - 1e-14 * abs(keep.base) - highest - corner - sag * (1.0 + 1e-9)
