"""Training of a policy for any craft, by gradients through flights of random layouts.

The network gives a demanded change of twist (`rans.policy.authority` is what it is given, `rans.policy.allocation`
what becomes of its demand). Each craft of a batch has its own layout, scale, control period and errors. Backwards,
thrusters that are neither shut nor open all the time follow the demand, and others the less the farther they are
from that, so that the price of thrust has a gradient too. Planar craft fly in the plane z = 0 of space. Tensors are
of n craft: vectors (n, 3) in W unless said otherwise, with unit quaternions (n, 4), w first.
`rans_any_craft.agents` trains with it; the shipped weights follow from the order of the random numbers.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.extend import Network, NonFiniteState, Spacecraft, Task, Workers
from rans.model.spacecraft_file import SPACECRAFT, spacecraft_names
from rans.model.twists import authority_margin, balanced, cone_pushes, directions, thrust
from rans.policy.allocation import continuous_price, in_order, subsets, thrust_price
from rans.policy.any_craft import RANGES, authority, coast, columns_of, effects, last_layer
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.authority import (
    SCALARS,
    TURNS,
    VECTORS,
    Authority,
    braking,
    columns,
    rotation_vector,
    width,
)
from rans.tasks.derived import layout
from rans_any_craft.layouts import IN_SPACE, LayoutRanges, Shape, canonical, sample_layout

_TABLE = 256
"""Largest number of subsets of a layout in training: those that demands up to 3 choose most often."""
_HELD_OUT = 2
"""Digits up to which a layout equals one of a shipped craft."""
_GYRATION = 20.0
"""Mass over inertia of a craft of 0.3 m, 1/m^2: how much an offset of the centre of mass turns it."""
_STEEPEST = 30.0
"""Largest derivative of a flight's cost by a state, per m, rad, m/s or rad/s: those of stable flights are below."""
_FASTEST = 8.0
"""Largest speed along an axis, m/s, and spin about it, rad/s, in training."""
_FARTHEST = 50.0
"""Largest distance along an axis in training, m."""
_MEMORY = 0.985
"""Part of a state's gradient that goes back by one period: without it a few flights outweigh all others."""
_IMITATIONS = 600
"""Steps of the imitation of the law made by hand."""
_DESCENTS = 24
"""Steps of accelerated projected gradient descent that find the commands of continuous thrusters in training."""
_SOFT = 0.2
"""Part of a column by which the demand along it may miss its range until the gradient falls to 1/e."""
_RIDGE = 0.02
"""Added to the squares of the columns that follow the demand."""
_COARSE = 0.3
"""Least acceleration of craft with large pulses, over the largest one in training."""
RANGES_OF_LAYOUTS = {2: LayoutRanges(most=10), 3: IN_SPACE}
"""Ranges of layouts in training, by dimension: of more thrusters in the plane there are thousands of subsets."""
_AXES = {2: (0, 1, 5), 3: (0, 1, 2, 3, 4, 5)}
"""Components of a twist in space that a craft of the dimension has."""


class Stage(NamedTuple):
    """A stage of the training, which begins with the weights of the one before it."""

    seconds: float = 180.0
    """Time, s."""
    thrust_price: float = 0.4
    """Price of a second of the craft's least authority, over that of a second outside the tolerances."""
    rest_price: float = 0.0
    """Further price of a second of thrust within the tolerances, in the unit of `thrust_price`."""
    continuous: float = 1.0
    """Factor of both prices for continuous thrusters, which need not push against each other to turn a craft."""
    angle: float = 0.6
    """Weight of angles far from the goal over that of distances. With a small one a craft that has far to go does
    not turn faster than it must."""
    learning_rate: float = 3e-3


@dataclass(frozen=True)
class DemandSettings:
    """Settings of the training."""

    dimension: int = 2
    """2: the plane; 3: space."""
    stages: tuple[Stage, ...] = (Stage(),)
    """Prices of thrust and times, one stage after the other."""
    last: float = 1.0
    """Part of the last stage's weights in the result; the rest are those before it. With weights between those of
    two prices the time and the impulse of flights are between theirs."""
    seed: int = 0
    layouts: int = 1000
    """Number of layouts drawn; each is used at many scales."""
    crafts: int = 384
    """Craft in a batch."""
    steps: int = 160
    """Control periods of a flight."""
    channels: int = 8
    """Hidden units of each layer over 8, the number of turns and mirror images of a square, or 48 of a cube."""
    coarse: float = 0.0
    """Part of the craft of such a batch whose pulses are large for the tolerances."""
    shared: float = 0.0
    """Part of the layouts whose thrusters share a supply, in the plane; they are on or off."""
    device: str = "cpu"
    """Device of torch on which the training runs, such as "cpu" or "cuda"."""


class Pool(NamedTuple):
    """Layouts of the units of their least authority, padded."""

    columns: Tensor
    """(L, n, d) in the order of `rans.policy.allocation.in_order`; zero where there is no thruster."""
    matrix: Tensor
    """(L, n, n) of the descent: identity less the scaled products of the columns."""
    step: Tensor
    """(L, n) step sizes of the descent."""
    thrust: Tensor
    """(L, n) velocity change of each thruster."""
    price: Tensor
    """(L, 1) `rans.policy.allocation.continuous_price`."""
    twist: Tensor
    """(L, 256, d) of subsets."""
    offset: Tensor
    """(L, 256) of their linear functions; very negative where there is no subset."""
    used: Tensor
    """(L, 256) sum of velocity changes of the open thrusters."""
    authority: Tensor
    """(L, 2 d) along both ways of every axis, over the least one."""
    margin: Tensor
    """(L,) `rans.model.twists.authority_margin`."""
    is_continuous: Tensor
    """(L,) bool: the thrusters have no shared supply, which is for thrusters that are on or off."""
    is_on_off: Tensor
    """(L,) bool: there are no wheels, which are continuous."""


def shipped_shapes(dimension: int) -> frozenset[Shape]:
    """Tables of `rans_any_craft.layouts.canonical` of all craft of a dimension that come with RANS.

    Layouts of these are left out of the pool: tables of shipped craft are of craft that the training has not met.
    """
    crafts = (SPACECRAFT[name].craft for name in spacecraft_names())
    return frozenset(
        table
        for craft in crafts
        if craft.dimension == dimension and craft.thrusters
        for table in canonical(columns_of(craft), digits=_HELD_OUT)
    )


def draw_pool(
    count: int, seed: int, dimension: int = 2, workers: int | None = 1, shared: float = 0.0
) -> Pool:
    """Draw layouts and what a training needs to know of them.

    Args:
        count: number of layouts; those with the shape of a craft that comes with RANS are left out.
        seed: of the layouts, and of the demands that choose among subsets of thrusters.
        dimension: 2: the plane; 3: space.
        workers: see `rans.processes.Workers`.
        shared: part of the layouts whose thrusters share a supply, in the plane.
    """
    # Enough jobs that all processors end together.
    edges = np.linspace(0, count, min(count, 64) + 1).astype(int).tolist()
    jobs = [(first, end) for first, end in itertools.pairwise(edges)]
    pool = Workers(_Drawing, (seed, dimension, shared), workers, "drew layouts")
    rows = [row for part in pool.ordered(_Drawing.rows, jobs) for row in part]
    *numbers, continuous, on_off = (np.array(column) for column in zip(*rows, strict=True))
    tensors = [torch.tensor(array, dtype=torch.float32) for array in numbers]
    return Pool._make([*tensors, torch.tensor(continuous), torch.tensor(on_off)])


class _Drawing:
    """Rows of the pool: layouts of a seed by their numbers, of which none is a shipped craft's."""

    def __init__(self, seed: int, dimension: int, shared: float) -> None:
        random = np.random.default_rng(seed)
        size = 3 if dimension == 2 else 6
        demands = random.normal(size=(2048, size))
        demands *= 3.0 * random.random((2048, 1)) / np.linalg.norm(demands, axis=1, keepdims=True)
        self._demands = demands
        self._seed = seed
        self._dimension = dimension
        self._shared = shared
        self._shipped = shipped_shapes(dimension)

    def rows(self, first: int, end: int) -> list[tuple[Any, ...]]:
        """Entries of the pool for layouts first to end - 1.

        The number seeds a layout, so that it does not depend on the others.
        """
        ranges = RANGES_OF_LAYOUTS[self._dimension]
        rows = []
        for number in range(first, end):
            random = np.random.default_rng((self._seed, number))
            drawn = sample_layout(random, ranges)
            rows.append(self._row(drawn, bool(random.random() < self._shared)))
        return [row for row in rows if row is not None]

    def _row(self, drawn: np.ndarray, is_shared: bool) -> tuple[Any, ...] | None:
        """Entry of the pool for a layout (n, d), padded with zeros to the most thrusters; None: it is left out.

        Left out are layouts of shipped craft (the held-out test), and those that a craft which shares thrust cannot
        steer. The order of an entry is that of `Pool`.
        """
        dimension = self._dimension
        ranges = RANGES_OF_LAYOUTS[dimension]
        size = drawn.shape[1]
        most = ranges.most + (6 if ranges.wheels else 0)
        # The craft that come with RANS are for evaluation.
        if canonical(drawn, digits=_HELD_OUT) & self._shipped:
            return None
        ways = balanced(drawn, is_shared)
        if dimension == 2:
            ways[:4] = cone_pushes(drawn, is_shared)
        least = np.repeat(
            [ways[: 2 * dimension].min(), ways[2 * dimension :].min()],
            [dimension, size - dimension],
        )
        # A shared supply divides the authority.
        if least.min() <= (0.05 / len(drawn) if is_shared else 0.05):
            return None
        layout = (drawn / least)[in_order(drawn)]
        pushes = thrust(layout)
        padded = np.zeros((most, size))
        padded[: len(layout)] = layout
        # Subsets of on/off thrusters; wheels have none.
        has_wheels = bool((pushes == 0.0).any())
        twist = np.zeros((_TABLE, size))
        offset = np.full(_TABLE, -1e9)
        used = np.zeros(_TABLE)
        if not has_wheels:
            columns = tuple(map(tuple, layout.tolist()))
            every = subsets(columns, is_shared, thrust_price(layout))
            best = np.argmax(self._demands @ every.slope.T + every.offset, axis=1)
            counts = np.bincount(best, minlength=len(every.offset))
            chosen = np.argsort(-counts, kind="stable")[:_TABLE]
            twist[: len(chosen)] = every.twist[chosen]
            offset[: len(chosen)] = every.offset[chosen]
            opened = every.opened[chosen]
            if is_shared:
                opened = opened / np.maximum(opened.sum(axis=1, keepdims=True), 1.0)
            used[: len(chosen)] = opened @ pushes
        return (
            padded,
            *_descent(padded),
            np.pad(pushes, (0, most - len(pushes))),
            [continuous_price(layout, has_wheels)],
            twist,
            offset,
            used,
            ways / least.repeat(2),
            authority_margin(drawn),
            not is_shared,
            not has_wheels,
        )


def _descent(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (n, n) and step sizes (n,) of projected gradient descent on the squared error of columns (n, d)."""
    product = columns @ columns.T
    size = np.diag(product)
    scale = np.where(size > 0.0, size, 1.0)
    largest = np.linalg.eigvalsh(product / np.sqrt(np.outer(scale, scale)))[-1]
    step = np.where(size > 0.0, 1.0 / (scale * largest), 0.0)
    return np.eye(len(columns)) - step[:, None] * product, step


class Cube:
    """The symmetries of a square or a cube, under which demands turn as states do; networks obey them."""

    def __init__(self, dimension: int) -> None:
        signs = itertools.product((1.0, -1.0), repeat=dimension)
        orders = itertools.permutations(range(dimension))
        eye = np.eye(dimension)
        self.dimension = dimension
        self.elements = [
            eye[list(order)] * np.array(sign) for order, sign in itertools.product(orders, signs)
        ]
        # The identity comes first.
        self.table = np.array(
            [[self._index(g.T @ k) for k in self.elements] for g in self.elements]
        )

    def _index(self, matrix: np.ndarray) -> int:
        return next(k for k, g in enumerate(self.elements) if np.allclose(g, matrix))

    def _axial(self, number: int) -> np.ndarray:
        """What an element does to a turn: one number in the plane, three in space."""
        g = self.elements[number]
        hand = np.linalg.det(g)
        return np.full((1, 1), hand) if self.dimension == 2 else hand * g

    def on_columns(self, number: int) -> np.ndarray:
        """Matrix (m, m) of what an element of the group does to the m columns of `rans.policy.authority`.

        Its blocks follow the columns of an observation there, vectors first: a new column needs its block.
        """
        g = self.elements[number]
        axial = self._axial(number)
        blocks = [g] * VECTORS + [axial] * TURNS + [np.eye(SCALARS), _on_ways(g), _on_ways(axial)]
        size = width(self.dimension)
        result = np.zeros((size, size))
        start = 0
        for block in blocks:
            end = start + len(block)
            result[start:end, start:end] = block
            start = end
        return result

    def on_demand(self, number: int) -> np.ndarray:
        """What an element does to a demand."""
        g = self.elements[number]
        axial = self._axial(number)
        result = np.zeros((len(g) + len(axial),) * 2)
        result[: len(g), : len(g)] = g
        result[len(g) :, len(g) :] = axial
        return result


def _on_ways(g: np.ndarray) -> np.ndarray:
    """What a signed permutation does to numbers along both ways of every axis: +x, -x, +y and so on."""
    ways = np.vstack([sign * axis for axis in np.eye(len(g)) for sign in (1.0, -1.0)])
    # Entry (i, k) is 1 if the way k becomes the way i.
    return (ways @ g @ ways.T > 0.5).astype(float)


class DemandNetwork(torch.nn.Module):
    """Two hidden layers (tanh) that obey the symmetries of a square or cube; outputs are demands (N, d)."""

    def __init__(self, channels: int, generator: torch.Generator, dimension: int = 2) -> None:
        super().__init__()
        cube = Cube(dimension)
        self.sides = len(cube.elements)
        self.dimension = dimension
        inverse = [int(cube.table[g][0]) for g in range(self.sides)]
        self._inputs: Tensor
        self._demands: Tensor
        self._table: Tensor
        on_columns = np.stack([cube.on_columns(k) for k in inverse])
        on_demand = np.stack([cube.on_demand(k) for k in range(self.sides)])
        self.register_buffer("_inputs", torch.tensor(on_columns, dtype=torch.float32))
        self.register_buffer("_demands", torch.tensor(on_demand, dtype=torch.float32))
        self.register_buffer("_table", torch.tensor(cube.table))

        def drawn(*shape: int, gain: float) -> torch.nn.Parameter:
            return torch.nn.Parameter(gain * torch.randn(shape, generator=generator))

        units = self.sides * channels
        self.first = drawn(channels, width(dimension), gain=1.0 / math.sqrt(width(dimension)))
        self.first_bias = torch.nn.Parameter(torch.zeros(channels))
        self.second = drawn(channels, channels, self.sides, gain=1.0 / math.sqrt(units))
        self.second_bias = torch.nn.Parameter(torch.zeros(channels))
        self.last = drawn(on_demand.shape[1], channels, gain=0.3 / math.sqrt(units))

    def layers(self) -> list[tuple[Tensor, Tensor]]:
        """Weights (o, i) and biases (o,) of ordinary dense layers."""
        units = self.sides * len(self.first)
        # Unit (c, g) has its input as from the side g.
        one = torch.einsum("ci,gij->cgj", self.first, self._inputs).flatten(0, 1)
        two = self.second[..., self._table].permute(0, 2, 1, 3).reshape(units, units)
        three = torch.einsum("gij,jc->icg", self._demands, self.last).flatten(1)
        return [
            (one, self.first_bias.repeat_interleave(self.sides)),
            (two, self.second_bias.repeat_interleave(self.sides)),
            (three, three.new_zeros(len(three))),
        ]


Layers = list[tuple[Tensor, Tensor]]


def stopping_law(
    error: Sequence[Tensor],
    turn: tuple[Tensor, Sequence[Tensor]],
    velocity: Sequence[Tensor],
    spin: Sequence[Tensor],
    authority: Authority,
) -> Tensor:
    """Demands (N, d) of a law made by hand, with which training begins: follow the braking curves.

    Args:
        error: see `rans.policy.authority.columns`, as for the others.
        turn: to the goal's attitude.
        velocity: in B.
        spin: in B.
        authority: of the craft.
    """
    period, _, _, a, alpha, _ = authority

    def missing(way: Sequence[Tensor], speed: Sequence[Tensor], most: Tensor) -> list[Tensor]:
        size = torch.sqrt(torch.as_tensor(sum(x.square() for x in way)) + 1e-12)
        ahead = braking(size, most, period) / size
        return [(ahead * x - v) / (most * period) for x, v in zip(way, speed, strict=True)]

    demand = missing(error, velocity, a) + missing(rotation_vector(*turn), spin, alpha)
    return torch.stack(demand, dim=1).clamp(-2.5, 2.5)


def demanded(layers: Layers, inputs: Tensor) -> Tensor:
    """Demands (N, d) of columns (N, k)."""
    x = inputs
    for weight, bias in layers[:-1]:
        x = torch.tanh(torch.nn.functional.linear(x, weight, bias))
    return torch.nn.functional.linear(x, *layers[-1])


class Motion(NamedTuple):
    """States of craft in W, whose origin is the goal with the attitude 1."""

    p: Tensor
    """(N, 3) position, m."""
    q: Tensor
    """(N, 4) attitude, a unit quaternion (w, x, y, z)."""
    v: Tensor
    """(N, 3) velocity, m/s."""
    spin: Tensor
    """(N, 3) angular velocity in B, rad/s."""

    def angle(self) -> Tensor:
        """Angle to the goal's attitude, rad, (N,)."""
        return 2.0 * torch.atan2(self.q[:, 1:].norm(dim=1), self.q[:, 0].abs())


class Batch(NamedTuple):
    """Craft with their errors, and their states at the start."""

    pool: Pool
    """Rows of the pool, one for each craft."""
    authority: Authority
    scale: Tensor
    """(N, d) change of the twist for a unit: m/s, then rad/s."""
    continuous: bool
    gain: Tensor
    """(N, d) of what thrusters really do over what is expected."""
    late: Tensor
    """(N, 1) part of a period by which commands act late."""
    noise: Tensor
    """(N, 1) scale of the sensors' noise; 1 is that of the conditions called real."""
    centre: Tensor
    """(N, 3) offset of the centre of mass, m; forces then turn the craft."""
    moments: Tensor
    """(N, 3) principal moments of inertia, over their mean: they couple spins."""
    state: Motion
    """At the start."""


def draw_batch(
    pool: Pool,
    settings: DemandSettings,
    generator: torch.Generator,
    continuous: bool,
) -> Batch:
    """Draw as many craft and starts as the settings say, with random numbers of `generator` on its device.

    Accelerations are bounded for the control period, so that on/off pulses stay small against the tolerances.
    The order of draws decides what is trained.
    """
    count = settings.crafts
    dimension = settings.dimension
    device = generator.device
    turning = 2 * dimension - 3

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        drawn = torch.rand(count, *shape, generator=generator, device=device)
        return low + (high - low) * drawn

    def spread(low: float, high: float) -> Tensor:
        return torch.exp(uniform(math.log(low), math.log(high)))

    # On/off thrusters stand alone: wheels, which are continuous, come with continuous ones.
    allowed = pool.is_continuous if continuous else pool.is_on_off
    which = torch.multinomial(allowed.float(), count, replacement=True, generator=generator)
    rows = Pool(*(x[which] for x in pool))
    periods, linear, angular, _ = RANGES[dimension]
    period = spread(periods.low, periods.high)
    # A single pulse should not move the craft by more than it can be brought back from in a few periods.
    largest_a = (0.06 / period.square()).clamp(max=linear.high)
    a = torch.minimum(spread(linear.low, linear.high), largest_a)
    largest_alpha = torch.minimum(1.3 / period, 0.3 / period.square()).clamp(max=angular.high)
    alpha = torch.minimum(spread(angular.low, angular.high), largest_alpha)
    if settings.coarse and not continuous:
        is_coarse = uniform(0.0, 1.0) < settings.coarse
        a = torch.where(is_coarse, largest_a * spread(_COARSE, 1.0), a)
        alpha = torch.where(is_coarse, largest_alpha * spread(_COARSE, 1.0), alpha)
    ways = rows.authority.T
    of_craft = Authority(
        period,
        [a * x for x in ways[: 2 * dimension]],
        [alpha * x for x in ways[2 * dimension :]],
        a,
        alpha,
    )
    scale = torch.stack([a * period] * dimension + [alpha * period] * turning, dim=1)
    real = (uniform(0.0, 1.0, 1) < 0.6).float()
    gain = 1.0 + 0.12 * real * uniform(-1.0, 1.0, dimension + turning)
    late = 0.2 * real * uniform(0.0, 1.0, 1)
    flat = torch.ones(3, device=device)
    flat[dimension:] = 0.0
    centre = 0.004 * real * uniform(-1.0, 1.0, 3) * flat
    moments = torch.exp(uniform(-0.6, 0.6, 3))
    moments = moments / moments.mean(dim=1, keepdim=True)

    # Starts: at rest far away, or near and moving; slow craft start nearer.
    def direction(axes: Tensor) -> Tensor:
        drawn = torch.randn(count, 3, generator=generator, device=device) * axes
        return unit_rows(drawn, axes)

    span = settings.steps * period
    far = torch.minimum(torch.full_like(a, 4.5), 0.12 * a * span.square())
    moving = uniform(0.0, 1.0) < 0.3
    distance = far * torch.where(moving, uniform(0.0, 0.5), uniform(0.2, 1.0))
    speed = moving * uniform(0.0, 1.0) * 0.7 * torch.sqrt(a * far)
    axes = 1.0 - flat if dimension == 2 else flat
    # Angles of uniform attitudes in space have the density (1 - cos angle) / pi: large ones are usual.
    angle = math.pi * (uniform(0.0, 1.0) if dimension == 2 else uniform(0.0, 1.0).pow(0.4))
    half = 0.5 * torch.minimum(angle, 0.08 * alpha * span.square())
    rate = moving * uniform(-1.0, 1.0) * torch.clamp(torch.sqrt(alpha), max=1.5)
    state = Motion(
        distance[:, None] * direction(flat),
        torch.cat((half.cos()[:, None], half.sin()[:, None] * direction(axes)), dim=1),
        speed[:, None] * direction(flat),
        rate[:, None] * direction(axes),
    )
    return Batch(rows, of_craft, scale, continuous, gain, late, real, centre, moments, state)


def allocated(demand: Tensor, rows: Sequence[Tensor], continuous: bool) -> tuple[Tensor, Tensor]:
    """Changes of the twist (N, d) that craft give, and thrust (N,), both in units of the authority.

    Forwards it is what agents do in flight (`rans.policy.allocation`); only backwards it is smoothed.
    """
    layout, matrix, step, pushes, price, twist, offset, used = rows
    # Half of it is the derivative of the cost by a part of the thrust.
    paid = 0.5 * price * pushes
    has_gradient = torch.is_grad_enabled()
    with torch.no_grad():
        wanted = demand.detach()
        opened = None if continuous else _opened(wanted, twist, offset, used)
        # Only gradients need what continuous thrusters would do.
        if opened is not None and not has_gradient:
            return opened
        part = _continuous(wanted, layout, matrix, step, paid)
        given = (part[:, :, None] * layout).sum(dim=1)
        if not has_gradient:
            return given, (part * pushes).sum(dim=1)
        # Thrusters within their range follow the demand, others less.
        square = layout.square().sum(dim=2).clamp(min=1e-9)
        slope = (layout @ (wanted - given)[:, :, None])[:, :, 0] - paid
        weight = torch.exp(-slope.abs() / (_SOFT * square))
        weighted = layout * weight[:, :, None]
        products = weighted.mT @ layout
        ridge = _RIDGE * torch.eye(layout.shape[2], device=demand.device)
        sides = torch.cat((products, weighted.mT @ pushes[:, :, None]), dim=2)
        follows, costs = torch.linalg.solve_ex(products + ridge, sides).result.split(
            (layout.shape[2], 1), dim=2
        )
        hard, spent = opened or (given, (part * pushes).sum(dim=1))
    soft = (follows @ demand[:, :, None])[:, :, 0]
    following = (costs[:, :, 0] * demand).sum(dim=1)
    return soft + (hard - soft).detach(), following + (spent - following).detach()


def _opened(demand: Tensor, twist: Tensor, offset: Tensor, used: Tensor) -> tuple[Tensor, Tensor]:
    """Changes of the twist (N, d) and thrust (N,) of the best subsets of on/off thrusters."""
    # Torch's compiler makes one operation of the sum and the maximum.
    scores = offset + 2.0 * (twist * demand[:, None]).sum(dim=2)
    best = scores.argmax(dim=1)
    rows = best[:, None, None].expand(-1, 1, twist.shape[2])
    return twist.gather(1, rows)[:, 0], used.gather(1, best[:, None])[:, 0]


def _continuous(
    demand: Tensor, layout: Tensor, matrix: Tensor, step: Tensor, paid: Tensor
) -> Tensor:
    """Commands (N, n) of `rans.policy.allocation.shares`, for a layout (N, n, d) of each craft, by matrices.

    Agents in flight descend by that function: too few steps here would train for another allocation.
    """
    along = (layout @ demand[:, :, None])[:, :, 0] - paid
    free = step * along
    part = free.clamp(0.0, 1.0)
    before = part
    momentum = 1.0
    for _ in range(_DESCENTS):
        # Nesterov's sequence.
        following = 0.5 + 0.5 * math.sqrt(1.0 + 4.0 * momentum * momentum)
        ahead = part + (momentum - 1.0) / following * (part - before)
        before = part
        # Torch's compiler makes one operation of the line in this form, and four with a matrix product.
        part = ((matrix * ahead[:, None]).sum(dim=2) + free).clamp(0.0, 1.0)
        momentum = following
    return part


class Bounded(torch.autograd.Function):
    """States whose gradient (N, ...) is bounded for each craft: a few unstable flights have huge ones."""

    @staticmethod
    def forward(ctx: Any, state: Tensor) -> Tensor:
        """States as they are."""
        return state.clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        """Gradients no larger than `_STEEPEST`."""
        return gradients[0].nan_to_num(0.0).clamp(-_STEEPEST, _STEEPEST)


def _turned(q: Tensor, x: Tensor) -> Tensor:
    """Vectors (N, 3) rotated by unit quaternions (N, 4)."""
    cross = torch.linalg.cross(q[:, 1:], x)
    return x + 2.0 * (q[:, :1] * cross + torch.linalg.cross(q[:, 1:], cross))


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Products of quaternions (N, 4)."""
    scalar = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(dim=1, keepdim=True)
    vector = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + torch.linalg.cross(a[:, 1:], b[:, 1:])
    return torch.cat((scalar, vector), dim=1)


def _rotation(vector: Tensor) -> Tensor:
    """Quaternions (N, 4) of rotation vectors (N, 3)."""
    angle = torch.sqrt(vector.square().sum(dim=1, keepdim=True) + 1e-12)
    return torch.cat(((0.5 * angle).cos(), (0.5 * angle).sin() / angle * vector), dim=1)


def _inputs(
    state: Motion, authority: Authority, dimension: int
) -> tuple[list[Tensor], tuple[Tensor, list[Tensor]], list[Tensor], list[Tensor], Authority]:
    """Arguments of `rans.policy.authority.columns`, from states (n, ...) in W.

    Errors, velocities and spins are turned to B.
    """
    back = state.q * state.q.new_tensor([1.0, -1.0, -1.0, -1.0])
    error = _turned(back, -state.p).unbind(dim=1)
    velocity = _turned(back, state.v).unbind(dim=1)
    w = state.q[:, :1]
    cosine = 2.0 * w[:, 0].square() - 1.0
    sines = (-2.0 * w * state.q[:, 1:]).unbind(dim=1)
    turning = slice(2, 3) if dimension == 2 else slice(0, 3)
    return (
        list(error[:dimension]),
        (cosine, list(sines[turning])),
        list(velocity[:dimension]),
        list(state.spin.unbind(dim=1)[turning]),
        authority,
    )


def one_period(
    state: Motion,
    before: Tensor,
    drawn: Tensor,
    flat: list[Tensor],
    fields: Sequence[Tensor],
    continuous: bool,
) -> tuple[Motion, Tensor, Tensor, Tensor, Tensor]:
    """State after a period, twist of this period, cost without thrust, nearness to the goal, and thrust.

    The layers of the network are ``flat``. Everything is a tensor of n craft; ``before`` (n, size) is the twist of
    the period before, ``drawn`` (n, 2 size) normal numbers of the
    sensors, ``fields`` the batch in the order that `fly` gives it.
    """
    period, ways, scale, gain, late, noise, centre, moments, weight, *rows = fields
    size = scale.shape[1]
    dimension = directions(size)
    *accelerations, least_linear, least_angular = ways
    authority = Authority(
        period,
        accelerations[: 2 * dimension],
        accelerations[2 * dimension :],
        least_linear,
        least_angular,
    )
    axes = list(_AXES[dimension])
    # Sensors: noise of the conditions called real.
    drawn = drawn * noise
    errors = torch.zeros(len(period), 6, device=period.device)
    errors[:, axes] = drawn[:, :size]
    rates = torch.zeros(len(period), 6, device=period.device)
    rates[:, axes] = drawn[:, size:]
    measured = Motion(
        state.p + 0.001 * errors[:, :3],
        _product(state.q, _rotation(0.00175 * errors[:, 3:])),
        state.v + 0.003 * rates[:, :3],
        state.spin + 0.003 * rates[:, 3:],
    )
    known = _inputs(measured, authority, dimension)
    layers = list(zip(flat[::2], flat[1::2], strict=True))
    demand = demanded(layers, torch.stack(columns(*known), dim=1))
    unit, pushes = allocated(demand, rows, continuous)
    twist = unit * scale * gain
    acting = torch.zeros_like(errors)
    acting[:, axes] = (1.0 - late) * twist + late * before
    # Motion: the push turns with the craft, whose spin changes evenly.
    push = acting[:, :3]
    kick = acting[:, 3:]
    kick = kick + _GYRATION * torch.linalg.cross(centre, push)
    p, q, v, spin = state
    coupled = torch.linalg.cross(spin, moments * spin) / moments
    kick = kick - period[:, None] * coupled
    long = period[:, None]
    middle = _product(q, _rotation(long * (0.5 * spin + kick / 6.0)))
    push = _turned(middle, push)
    p = p + long * (v + 0.5 * push)
    v = v + push
    q = _product(q, _rotation(long * (spin + 0.5 * kick)))
    q = q / q.norm(dim=1, keepdim=True)
    # Lost craft go on within bounds, or their numbers would overflow and spoil the sums of all.
    spin = (spin + kick).clamp(-_FASTEST, _FASTEST)
    p = p.clamp(-_FARTHEST, _FARTHEST)
    v = v.clamp(-_FASTEST, _FASTEST)
    # Cost of this period: errors far away, being outside of the tolerances, spin.
    distance = torch.sqrt(p.square().sum(dim=1) + 1e-8)
    angle = torch.sqrt((4.0 - 4.0 * q[:, 0].square()).clamp(min=0.0) + 1e-6)
    inside = torch.sigmoid((0.035 - distance) / 0.008) * torch.sigmoid((0.06 - angle) / 0.014)
    far = torch.log1p(20.0 * distance) / 4.4 + weight * torch.log1p(12.0 * angle) / 3.2
    square = spin.square().sum(dim=1)
    cost = period * (far + 1.0 - inside + 0.02 * square.clamp(max=9.0))
    return Motion(p, q, v, spin), twist, cost, inside, pushes


_Period = tuple[Motion, Tensor, Tensor, Tensor, Tensor]
"""What a period results in: motion, twist, cost, whether within the tolerances, and thrust."""


@cache
def _compiled(continuous: bool) -> Callable[..., _Period]:
    """`one_period` for on/off or for continuous thrusters, by torch's compiler."""
    return torch.compile(partial(one_period, continuous=continuous), dynamic=False)


def fly(
    layers: Layers,
    batch: Batch,
    settings: DemandSettings,
    generator: torch.Generator,
    stage: Stage,
) -> Tensor:
    """Cost (N,) of flights of a batch by a network's layers, with gradients if they are enabled.

    It is the mean over periods, over the time that the craft needs at least.

    Args:
        layers: of the network.
        batch: of craft.
        settings: of the training.
        generator: of the sensors' noise.
        stage: whose prices of thrust the cost has.
    """
    state = batch.state
    period = batch.authority.period
    a = batch.authority.least_linear
    count, size = batch.scale.shape
    device = period.device
    start = state.p.norm(dim=1).clamp(min=0.3)
    flown = torch.sqrt(start / a)
    turned = torch.sqrt(state.angle() / batch.authority.least_angular)
    least_time = 2.0 * torch.maximum(flown, turned) + 1.0
    cost = torch.zeros(count, device=device)
    before = torch.zeros(count, size, device=device)
    ways = [*batch.authority.linear, *batch.authority.angular, a, batch.authority.least_angular]
    fields = (
        period,
        torch.stack(ways),
        batch.scale,
        batch.gain,
        batch.late,
        batch.noise,
        batch.centre,
        batch.moments,
        # A tensor, or every weight would be compiled anew.
        torch.full((), stage.angle, device=device),
        *batch.pool[:8],
    )
    flat = [x for layer in layers for x in layer]
    # Compiling pays for a training only.
    period_of: Callable[..., _Period] = (
        _compiled(batch.continuous)
        if torch.is_grad_enabled()
        else partial(one_period, continuous=batch.continuous)
    )
    for _ in range(settings.steps):
        drawn = torch.randn(count, 2 * size, generator=generator, device=device)
        state, before, spent, inside, pushes = period_of(state, before, drawn, flat, fields)
        if torch.is_grad_enabled():
            state = Motion(
                *(Bounded.apply(_MEMORY * x + (1.0 - _MEMORY) * x.detach()) for x in state)
            )
        price = stage.thrust_price + stage.rest_price * inside.detach()
        price = price * (stage.continuous if batch.continuous else 1.0)
        cost = cost + spent + price * period * pushes
    return cost / least_time


def unit_rows(drawn: Tensor, axes: Tensor) -> Tensor:
    """Directions of rows (N, 3) along some axes (3,), 1 or 0; a row of zeros points along the first of them.

    Of one axis a float32 normal number is exactly 0 in one of 2e7 draws, and 0 / 0 would make every weight nan.
    """
    first = axes * (torch.cumsum(axes, dim=0) == 1.0)
    length = drawn.norm(dim=1, keepdim=True)
    return torch.where(length > 0.0, drawn / length.clamp(min=1e-30), first)


def imitate(
    network: DemandNetwork, pool: Pool, settings: DemandSettings, generator: torch.Generator
) -> None:
    """Bring a network near to the law made by hand, by least squares on states that flights may meet.

    The network changes in place; shipped weights depend on the order of the draws.
    """
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    for number in range(_IMITATIONS):
        batch = draw_batch(pool, settings, generator, continuous=True)
        p, q, v, spin = batch.state
        # Half of the states are near the goal, at any scale.
        near = 10.0 ** (-3.0 * torch.rand(len(p), 1, generator=generator, device=p.device))
        is_near = torch.rand(len(p), 1, generator=generator, device=p.device) < 0.5
        near = torch.where(is_near, near, 1.0)
        turn = near * 2.0 * torch.atan2(q[:, 1:].norm(dim=1, keepdim=True), q[:, :1])
        axis = q[:, 1:] / q[:, 1:].norm(dim=1, keepdim=True).clamp(min=1e-9)
        state = Motion(near * p, _rotation(turn * axis), near.sqrt() * v, near.sqrt() * spin)
        inputs = _inputs(state, batch.authority, settings.dimension)
        given = torch.stack(columns(*inputs), dim=1)
        loss = (demanded(network.layers(), given) - stopping_law(*inputs)).square().mean()
        optimizer.param_groups[0]["lr"] = 1e-2 * (1.0 - number / _IMITATIONS)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    if not all(bool(x.isfinite().all()) for x in network.parameters()):
        raise NonFiniteState(
            "the imitation ended with weights that are not finite: try another seed"
        )


def train(
    settings: DemandSettings,
    report: Callable[[str, DemandNetwork], None] = lambda text, network: None,
    pool: Pool | None = None,
) -> DemandNetwork:
    """Train a network: imitate the law made by hand, then go on by gradients through the stages of the settings.

    Args:
        settings: of the training.
        report: is given a line and the network, now and then.
        pool: layouts; None: those of the settings' seed.
    """
    pool = pool or draw_pool(
        settings.layouts, 2 * settings.seed, settings.dimension, None, settings.shared
    )
    pool = Pool(*(x.to(settings.device) for x in pool))
    weights = torch.Generator().manual_seed(settings.seed)
    network = DemandNetwork(settings.channels, weights, settings.dimension).to(settings.device)
    generator = torch.Generator(settings.device).manual_seed(settings.seed)
    imitate(network, pool, settings, generator)
    earlier: dict[str, Tensor] = {}
    for number, stage in enumerate(settings.stages):
        earlier = {name: x.clone() for name, x in network.state_dict().items()}

        def staged(text: str, number: int = number) -> None:
            report(f"stage {number + 1} {text}", network)

        _train_stage(network, pool, settings, stage, generator, staged)
    with torch.no_grad():
        for name, x in network.named_parameters():
            x.lerp_(earlier[name], 1.0 - settings.last)
    return network


class _Gradients:
    """Gradients of the cost of batches, by one kind of thruster.

    On a GPU the operations of a flight and of its gradient are recorded once and replayed, because most of them
    are shorter than their launch.
    """

    def __init__(
        self,
        network: DemandNetwork,
        pool: Pool,
        settings: DemandSettings,
        stage: Stage,
        generator: torch.Generator,
        continuous: bool,
    ) -> None:
        self._network = network
        self._settings = settings
        self._stage = stage
        self._generator = generator
        self._batch = draw_batch(pool, settings, generator, continuous)
        self._graph: torch.cuda.CUDAGraph | None = None
        if generator.device.type == "cuda":
            self._record()

    def of(self, batch: Batch) -> Tensor:
        """Write the gradients of a batch into the network's parameters, and return the flights' costs (N,).

        A recorded graph reads it from the first batch's place.
        """
        if self._graph is None:
            self._batch = batch
            return self._computed()
        for recorded, new in zip(_tensors(self._batch), _tensors(batch), strict=True):
            recorded.copy_(new)
        self._graph.replay()
        return self._cost

    def _computed(self) -> Tensor:
        """Costs of the recorded batch, whose clipped sum has been sent back.

        The parameters' gradients are replaced.
        """
        # Gradients keep their memory, in which recorded operations write.
        self._network.zero_grad(set_to_none=False)
        cost = fly(
            self._network.layers(), self._batch, self._settings, self._generator, stage=self._stage
        )
        # Hopeless flights must not outweigh all others.
        (10.0 * torch.tanh(cost / 10.0)).sum().backward()
        return cost

    def _record(self) -> None:
        """Record `_computed` as a CUDA graph, after two runs on another stream, which libraries need.

        What it computes from must keep its place in memory.
        """
        # Compilers and libraries begin on another stream, before the recording.
        stream = torch.cuda.Stream()
        stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(stream):
            for _ in range(2):
                self._computed()
        torch.cuda.current_stream().wait_stream(stream)
        self._graph = torch.cuda.CUDAGraph()
        self._graph.register_generator_state(self._generator)
        with torch.cuda.graph(self._graph):
            self._cost = self._computed()


def _tensors(batch: Batch) -> Iterator[Tensor]:
    """Tensors of a nested batch, last entries first.

    A recorded graph copies a new batch into its own in this order.
    """
    pending: list[Any] = list(batch)
    while pending:
        entry = pending.pop()
        if isinstance(entry, Tensor):
            yield entry
        elif isinstance(entry, (tuple, list)):
            pending.extend(entry)


def _train_stage(
    network: DemandNetwork,
    pool: Pool,
    settings: DemandSettings,
    stage: Stage,
    generator: torch.Generator,
    report: Callable[[str], None],
) -> None:
    """Train a network for the time of a stage at its prices, with an optimizer of its own.

    The clock ends it, so that a seed alone repeats no training.
    """
    optimizer = torch.optim.Adam(network.parameters(), stage.learning_rate, betas=(0.9, 0.98))
    gradients = {
        continuous: _Gradients(network, pool, settings, stage, generator, continuous)
        for continuous in (False, True)
    }
    begun = time.perf_counter()
    number = 0
    while (elapsed := time.perf_counter() - begun) < stage.seconds:
        elapsed_part = elapsed / stage.seconds
        # The step size rises within the first hundredth and falls to nothing at the end.
        rate = stage.learning_rate * min(1.0, 0.02 + 100.0 * elapsed_part) * (1.0 - elapsed_part**2)
        optimizer.param_groups[0]["lr"] = rate
        # Every second batch is on/off.
        continuous = number % 2 == 0
        cost = gradients[continuous].of(draw_batch(pool, settings, generator, continuous))
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0 * settings.crafts)
        if norm.isfinite():
            optimizer.step()
        if number % 10 <= 1:
            report(
                f"{elapsed:6.0f} s {number:5d} cost {cost.mean():.3f} norm {norm / settings.crafts:.2f}"
            )
        number += 1


def as_policy(network: DemandNetwork, craft: Spacecraft, task: Task, period: float) -> Network:
    """The network as an ordinary policy of a craft, in its own task; see `rans.policy.any_craft.for_craft`."""
    architecture = Architecture(
        layout(task, craft.dimension),
        len(craft.commands),
        (network.sides * len(network.first),) * 2,
        head="gaussian" if craft.is_continuous else "on-off",
        backbone="allocated",
        tokens=effects(craft, period),
        authority=authority(craft, period),
        coast=coast(craft),
    )
    tensors = _tensors_of(architecture, network)
    tensors |= {EXTRACTOR + name: x for name, x in architecture.statistics().items()}
    shapes = architecture.shapes()
    # There is no critic.
    return Network(architecture, {k: tensors.get(k, torch.zeros(s)) for k, s in shapes.items()})


def _tensors_of(architecture: Architecture, network: DemandNetwork) -> dict[str, Tensor]:
    """Tensors of the network's layers by their names in a policy."""
    first, second, last = ((w.detach().cpu(), b.detach().cpu()) for w, b in network.layers())
    return last_layer(architecture, *last) | {
        f"{EXTRACTOR}trunk.{2 * number}.{name}": x
        for number, pair in enumerate((first, second))
        for name, x in zip(("weight", "bias"), pair, strict=True)
    }
