"""Training of a policy for any craft in the plane, by gradients through flights of random layouts.

The network gives a demanded change of twist (`rans.policy.authority` is what it is given,
`rans.policy.allocation` what becomes of its demand). Each craft of a batch has its own layout, scale, control
period and errors. Backwards, the subset of thrusters that is opened counts as a mean over subsets with the weights
of a softmax of their costs, so that the price of thrust has a gradient too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from rans.model.spacecraft import Spacecraft
from rans.model.spacecraft_file import SPACECRAFT, spacecraft_names
from rans.policy.allocation import PRICE, balanced, in_order, subsets
from rans.policy.any_craft import authority, effects, last_layer
from rans.policy.architecture import EXTRACTOR, Architecture
from rans.policy.authority import (
    SCALARS,
    TURNS,
    VECTORS,
    WIDTH,
    Authority,
    braking,
    columns,
    heading_error,
)
from rans.policy.network import Network
from rans.randomization.layouts import (
    LayoutRanges,
    Shape,
    authority_margin,
    canonical,
    layouts,
)
from rans.tasks import Task
from rans.tasks.derived import layout

_TABLE = 128
"""Largest number of subsets of a layout in training: those that demands up to 3 choose most often."""
_HELD_OUT = 2
"""Digits up to which a layout equals one of a shipped craft."""
_GYRATION = 20.0
"""Mass over inertia of a craft of 0.3 m, 1/m^2: how much an offset of the centre of mass turns it."""
_STEEPEST = 30.0
"""Largest derivative of a flight's cost by a state, per m, rad, m/s or rad/s: those of stable flights are below."""
_IMITATIONS = 600
"""Steps of the imitation of the law made by hand."""
_PASSES = 3
"""Passes of coordinate descent over the thrusters in training: what is left is demanded in the next period."""
_MOST = 10
"""Largest number of thrusters in training: of more there are thousands of subsets."""


@dataclass(frozen=True)
class DemandSettings:
    """Settings of the training."""

    seconds: float = 180.0
    """Time of training, s."""
    seed: int = 0
    layouts: int = 1000
    """Number of layouts drawn; each is used at many scales."""
    crafts: int = 384
    """Craft in a batch."""
    steps: int = 160
    """Control periods of a flight."""
    channels: int = 8
    """Hidden units of each layer over 8, the number of turns and mirror images of a square."""
    learning_rate: float = 3e-3
    temperature: float = 0.25
    """Temperature of the softmax over subsets of thrusters, in squared units of the authority."""
    thrust_price: float = 0.4
    """Price of a second of the craft's least authority, over that of a second outside the tolerances."""
    memory: float = 0.985
    """Part of a state's gradient that goes back by one period: without it a few flights outweigh all others."""
    linear: tuple[float, float] = (0.015, 0.7)
    """Range of the least linear authority, m/s^2."""
    angular: tuple[float, float] = (0.15, 8.0)
    """Range of the least angular authority, rad/s^2."""
    period: tuple[float, float] = (0.1, 0.2)
    """Range of the control period, s."""


class Pool(NamedTuple):
    """Layouts in the units of their least authority, padded."""

    columns: Tensor
    """(L, 10, 3) in the order of `rans.policy.allocation.in_order`; zero where there is no thruster."""
    twist: Tensor
    """(L, 128, 3) of subsets."""
    offset: Tensor
    """(L, 128) of their linear functions; very negative where there is no subset."""
    thrust: Tensor
    """(L, 128) sum of velocity changes of the open thrusters."""
    authority: Tensor
    """(L, 6) along both ways of every axis, over the least one."""
    margin: Tensor
    """(L,) `rans.randomization.layouts.authority_margin`."""


def shipped_shapes() -> frozenset[Shape]:
    """Tables of `rans.randomization.layouts.canonical` of all planar craft that come with RANS."""
    crafts = (SPACECRAFT[name].craft for name in spacecraft_names())
    maps = (np.array(craft.wrench_map) for craft in crafts if craft.dimension == 2)
    return frozenset(table for columns in maps for table in canonical(columns, digits=_HELD_OUT))


def draw_pool(count: int, seed: int) -> Pool:
    """Draw layouts and what a training needs to know of them."""
    random = np.random.default_rng(seed)
    demands = random.normal(size=(2048, 3))
    demands *= 3.0 * random.random((2048, 1)) / np.linalg.norm(demands, axis=1, keepdims=True)
    rows = []
    shipped = shipped_shapes()
    for drawn in layouts(count, seed, LayoutRanges(most=_MOST)):
        # The craft that come with RANS are for evaluation.
        if canonical(drawn, digits=_HELD_OUT) & shipped:
            continue
        ways = balanced(drawn)
        scale = np.array([ways[:4].min(), ways[:4].min(), ways[4:].min()])
        if scale.min() <= 0.05:
            continue
        layout = (drawn / scale)[in_order(drawn)]
        every = subsets(tuple(map(tuple, layout.tolist())), False)
        best = np.argmax(demands @ every.slope.T + every.offset, axis=1)
        chosen = np.argsort(-np.bincount(best, minlength=len(every.offset)), kind="stable")[:_TABLE]
        twist = np.zeros((_TABLE, 3))
        twist[: len(chosen)] = every.twist[chosen]
        offset = np.full(_TABLE, -1e9)
        offset[: len(chosen)] = every.offset[chosen]
        thrust = np.zeros(_TABLE)
        thrust[: len(chosen)] = every.opened[chosen] @ np.hypot(layout[:, 0], layout[:, 1])
        padded = np.zeros((_MOST, 3))
        padded[: len(layout)] = layout
        turned = ways / scale[[0, 0, 0, 0, 2, 2]]
        rows.append((padded, twist, offset, thrust, turned, authority_margin(drawn)))
    return Pool(
        *(torch.tensor(np.array(one), dtype=torch.float32) for one in zip(*rows, strict=True))
    )


class Square:
    """The symmetries of a square, under which demands turn as states do: a network's weights obey them exactly."""

    def __init__(self) -> None:
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        mirror = np.diag([1.0, -1.0])
        turned = [np.linalg.matrix_power(quarter, k) for k in range(4)]
        self.elements = [*turned, *(g @ mirror for g in turned)]
        self.hands = [1.0] * 4 + [-1.0] * 4
        self.table = np.array(
            [[self._index(np.linalg.inv(g) @ k) for k in self.elements] for g in self.elements]
        )

    def _index(self, matrix: np.ndarray) -> int:
        return next(k for k, g in enumerate(self.elements) if np.allclose(g, matrix))

    def on_columns(self, number: int) -> np.ndarray:
        """What an element does to the columns of `rans.policy.authority`."""
        g = self.elements[number]
        hand = self.hands[number]
        result = np.zeros((WIDTH, WIDTH))
        for k in range(VECTORS):
            result[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = g
        start = 2 * VECTORS
        for k in range(TURNS):
            result[start + k, start + k] = hand
        start += TURNS
        for k in range(SCALARS):
            result[start + k, start + k] = 1.0
        # The ways +x, -x, +y, -y are permuted, those of the turn swap in a mirror.
        start += SCALARS
        ways = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        for k, way in enumerate(ways):
            image = next(j for j, other in enumerate(ways) if np.allclose(other, g @ way))
            result[start + image, start + k] = 1.0
        for k in range(2):
            result[start + 4 + (k if hand > 0 else 1 - k), start + 4 + k] = 1.0
        return result

    def on_demand(self, number: int) -> np.ndarray:
        """What an element does to a demand."""
        result = np.zeros((3, 3))
        result[:2, :2] = self.elements[number]
        result[2, 2] = self.hands[number]
        return result


class DemandNetwork(torch.nn.Module):
    """Two hidden layers (tanh) that obey the symmetries of the square; outputs are demands (N, 3)."""

    def __init__(self, channels: int, generator: torch.Generator) -> None:
        super().__init__()
        square = Square()
        inverse = [int(square.table[g][0]) for g in range(8)]
        self.register_buffer(
            "_inputs",
            torch.tensor(np.stack([square.on_columns(k) for k in inverse]), dtype=torch.float32),
        )
        self.register_buffer(
            "_demands",
            torch.tensor(np.stack([square.on_demand(k) for k in range(8)]), dtype=torch.float32),
        )
        self._table: Tensor
        self.register_buffer("_table", torch.tensor(square.table))

        def drawn(*shape: int, gain: float) -> torch.nn.Parameter:
            return torch.nn.Parameter(gain * torch.randn(shape, generator=generator))

        self.first = drawn(channels, WIDTH, gain=1.0 / math.sqrt(WIDTH))
        self.first_bias = torch.nn.Parameter(torch.zeros(channels))
        self.second = drawn(channels, channels, 8, gain=1.0 / math.sqrt(8 * channels))
        self.second_bias = torch.nn.Parameter(torch.zeros(channels))
        self.last = drawn(3, channels, gain=0.3 / math.sqrt(8 * channels))

    def layers(self) -> list[tuple[Tensor, Tensor]]:
        """Weights (o, i) and biases (o,) of ordinary dense layers."""
        channels = len(self.first)
        # Unit (c, g) sees the input as from the side g.
        first = torch.einsum("ci,gij->cgj", self.first, self._inputs).reshape(8 * channels, -1)
        second = self.second[:, :, self._table].permute(0, 2, 1, 3)
        second = second.reshape(8 * channels, 8 * channels)
        last = torch.einsum("gij,jc->icg", self._demands, self.last).reshape(3, -1)
        return [
            (first, self.first_bias.repeat_interleave(8)),
            (second, self.second_bias.repeat_interleave(8)),
            (last, first.new_zeros(3)),
        ]


Layers = list[tuple[Tensor, Tensor]]


def stopping_law(
    error: Sequence[Tensor],
    turn: tuple[Tensor, Tensor],
    velocity: Sequence[Tensor],
    spin: Tensor,
    authority: Authority,
) -> Tensor:
    """Demands (N, 3) of a law made by hand, with which training begins: follow the braking curves."""
    period, _, _, a, alpha = authority
    angle = heading_error(*turn)
    distance = torch.sqrt(error[0].square() + error[1].square() + 1e-12)
    approach = braking(distance, a, period) / distance
    rate = braking(angle.abs(), alpha, period) * angle.sign()
    push = [(approach * e - v) / (a * period) for e, v in zip(error, velocity, strict=True)]
    kick = (rate - spin) / (alpha * period)
    return torch.stack((*push, kick), dim=1).clamp(-2.5, 2.5)


def demanded(layers: Layers, inputs: Tensor) -> Tensor:
    """Demands (N, 3) of columns (N, k)."""
    x = inputs
    for weight, bias in layers[:-1]:
        x = torch.tanh(torch.nn.functional.linear(x, weight, bias))
    return torch.nn.functional.linear(x, *layers[-1])


class Batch(NamedTuple):
    """Craft with their errors, and their states at the start."""

    pool: Pool
    """Rows of the pool, one for each craft."""
    authority: Authority
    scale: Tensor
    """(N, 3) change of the twist for a unit: m/s, m/s, rad/s."""
    continuous: bool
    gain: Tensor
    """(N, 3) of what thrusters really do over what is expected."""
    late: Tensor
    """(N, 1) part of a period by which commands act late."""
    noise: Tensor
    """(N, 1) scale of the sensors' noise; 1 is that of the conditions called real."""
    centre: Tensor
    """(N, 2) offset of the centre of mass, m; forces then turn the craft."""
    state: tuple[Tensor, ...]
    """p (N, 2), heading (N,), v (N, 2), spin (N,) in W, whose origin is the goal with heading 0."""


def draw_batch(
    pool: Pool,
    settings: DemandSettings,
    generator: torch.Generator,
    continuous: bool,
    perturbed: bool = True,
) -> Batch:
    """Draw craft and starts."""
    count = settings.crafts

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(count, *shape, generator=generator)

    def spread(bounds: tuple[float, float]) -> Tensor:
        return torch.exp(uniform(math.log(bounds[0]), math.log(bounds[1])))

    which = torch.randint(len(pool.offset), (count,), generator=generator)
    rows = Pool(*(x[which] for x in pool))
    a = spread(settings.linear)
    period = spread(settings.period)
    # A single pulse should not turn the craft by more than it can be brought back from in a few periods.
    alpha = torch.minimum(spread(settings.angular), 1.3 / period)
    ways = rows.authority.T
    authority = Authority(
        period,
        [a * x for x in ways[:4]],
        [alpha * x for x in ways[4:]],
        a,
        alpha,
    )
    scale = torch.stack([a * period, a * period, alpha * period], dim=1)
    real = (torch.rand(count, 1, generator=generator) < 0.6) * float(perturbed)
    gain = 1.0 + 0.12 * real * uniform(-1.0, 1.0, 3)
    late = 0.2 * real * uniform(0.0, 1.0, 1)
    centre = 0.004 * real * uniform(-1.0, 1.0, 2)
    # Starts: at rest far away, or near and moving.
    span = settings.steps * period
    far = torch.minimum(torch.full_like(a, 4.5), 0.12 * a * span.square())
    moving = torch.rand(count, generator=generator) < 0.3
    distance = far * torch.where(moving, uniform(0.0, 0.5), uniform(0.2, 1.0))
    bearing = uniform(-math.pi, math.pi)
    course = uniform(-math.pi, math.pi)
    speed = moving * uniform(0.0, 1.0) * 0.7 * torch.sqrt(a * far)
    state = (
        torch.stack([distance * bearing.cos(), distance * bearing.sin()], dim=1),
        uniform(-math.pi, math.pi),
        torch.stack([speed * course.cos(), speed * course.sin()], dim=1),
        moving * uniform(-1.0, 1.0) * torch.clamp(torch.sqrt(alpha), max=1.5),
    )
    return Batch(rows, authority, scale, continuous, gain, late, real, centre, state)


def allocated(
    demand: Tensor, rows: Sequence[Tensor], continuous: bool, temperature: float
) -> tuple[Tensor, Tensor]:
    """Changes of the twist (N, 3) that craft give, and thrust (N,), both in units of the authority."""
    layout, twist, offset, used = rows
    scores = offset + 2.0 * torch.bmm(twist, demand[:, :, None]).squeeze(2)
    weights = torch.softmax(scores / temperature, dim=1)
    soft = torch.cat(
        (torch.bmm(weights[:, None], twist)[:, 0], (weights * used).sum(dim=1, keepdim=True)), dim=1
    )
    with torch.no_grad():
        if continuous:
            hard = _continuous(demand.detach(), layout)
        else:
            best = scores.argmax(dim=1)
            chosen = twist.gather(1, best[:, None, None].expand(-1, 1, 3))[:, 0]
            hard = torch.cat((chosen, used.gather(1, best[:, None])), dim=1)
    both = soft + (hard - soft).detach()
    return both[:, :3], both[:, 3]


def _continuous(demand: Tensor, layout: Tensor) -> Tensor:
    """Twists and thrust (N, 4) of `rans.policy.allocation.shares`, for a layout (N, n, 3) of each craft."""
    left = demand
    square = layout.square().sum(dim=2).clamp(min=1e-9)
    thrust = layout[:, :, :2].norm(dim=2)
    offset = 0.5 * PRICE * thrust / square
    share = [torch.zeros_like(demand[:, 0])] * layout.shape[1]
    for _ in range(_PASSES):
        for k in range(layout.shape[1]):
            column = layout[:, k]
            step = (column * left).sum(dim=1) / square[:, k] - offset[:, k]
            after = (share[k] + step).clamp(0.0, 1.0)
            left = left - column * (after - share[k])[:, None]
            share[k] = after
    used = (torch.stack(share, dim=1) * thrust).sum(dim=1, keepdim=True)
    return torch.cat((demand - left, used), dim=1)


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


class Outcome(NamedTuple):
    """What flights were like."""

    cost: Tensor
    """(N,) mean over periods, over the time that the craft needs at least."""
    settled: Tensor
    """(N,) bool: inside 5 cm and 5 degrees in every period of the last fifth."""
    settling: Tensor
    """(N,) time after which it was always inside, over 2 sqrt(d / a)."""
    impulse: Tensor
    """(N,) sum of velocity changes of the thrusters, over 2 sqrt(d a)."""


def _one_period(
    p: Tensor,
    heading: Tensor,
    v: Tensor,
    spin: Tensor,
    before: Tensor,
    drawn: Tensor,
    flat: list[Tensor],
    fields: Sequence[Tensor],
    temperature: float,
    continuous: bool,
) -> tuple[Tensor, ...]:
    """State after a period, twist of this period, cost without thrust, and thrust."""
    period, ways, scale, gain, late, noise, centre, *rows = fields
    linear = [ways[0], ways[1], ways[2], ways[3]]
    authority = Authority(period, linear, [ways[4], ways[5]], ways[6], ways[7])
    # Sensors: noise of the conditions called real.
    drawn = drawn * noise
    seen = heading + 0.00175 * drawn[:, 0]
    c = seen.cos()
    s = seen.sin()
    q = -(p + 0.001 * drawn[:, 1:3])
    w = v + 0.003 * drawn[:, 3:5]
    inputs = columns(
        (c * q[:, 0] + s * q[:, 1], c * q[:, 1] - s * q[:, 0]),
        (c, -s),
        (c * w[:, 0] + s * w[:, 1], c * w[:, 1] - s * w[:, 0]),
        spin + 0.003 * drawn[:, 5],
        authority,
    )
    layers = list(zip(flat[::2], flat[1::2], strict=True))
    demand = demanded(layers, torch.stack(inputs, dim=1))
    unit, thrust = allocated(demand, rows, continuous, temperature)
    twist = unit * scale * gain
    acting = (1.0 - late) * twist + late * before
    # Motion: the push turns with the craft, whose spin changes evenly.
    lever = centre[:, 0] * acting[:, 1] - centre[:, 1] * acting[:, 0]
    kick = acting[:, 2] + _GYRATION * lever
    mid = heading + period * (0.5 * spin + kick / 6.0)
    c = mid.cos()
    s = mid.sin()
    push = torch.stack(
        (c * acting[:, 0] - s * acting[:, 1], s * acting[:, 0] + c * acting[:, 1]), dim=1
    )
    p = p + period[:, None] * (v + 0.5 * push)
    v = v + push
    heading = heading + period * (spin + 0.5 * kick)
    spin = spin + kick
    # Cost of this period: errors far away, being outside of the tolerances, spin.
    distance = torch.sqrt(p.square().sum(dim=1) + 1e-8)
    angle = torch.sqrt((2.0 - 2.0 * heading.cos()).clamp(min=0.0) + 1e-6)
    inside = torch.sigmoid((0.035 - distance) / 0.008) * torch.sigmoid((0.06 - angle) / 0.014)
    far = torch.log1p(20.0 * distance) / 4.4 + 0.6 * torch.log1p(12.0 * angle) / 3.2
    cost = period * (far + 1.0 - inside + 0.02 * spin.square().clamp(max=9.0))
    return p, heading, v, spin, twist, cost, thrust


@cache
def _compiled(continuous: bool) -> Callable[..., tuple[Tensor, ...]]:
    """`_one_period` for on/off or for continuous thrusters, by torch's compiler."""
    return torch.compile(partial(_one_period, continuous=continuous), dynamic=False)


def fly(
    layers: Layers,
    batch: Batch,
    settings: DemandSettings,
    generator: torch.Generator,
    steps: int | None = None,
) -> Outcome:
    """Fly a batch, with gradients if they are enabled."""
    p, heading, v, spin = batch.state
    period = batch.authority.period
    steps = steps or settings.steps
    a = batch.authority.least_linear
    count = len(period)
    start = p.norm(dim=1).clamp(min=0.3)
    least_time = 2.0 * torch.sqrt(start / a) + 1.0
    cost = torch.zeros(count)
    thrust_sum = torch.zeros(count)
    last_outside = torch.zeros(count)
    held = torch.ones(count, dtype=torch.bool)
    before = torch.zeros(count, 3)
    keep = settings.memory
    fields = (
        period,
        torch.stack(
            [*batch.authority.linear, *batch.authority.angular, a, batch.authority.least_angular]
        ),
        batch.scale,
        batch.gain,
        batch.late,
        batch.noise,
        batch.centre,
        *batch.pool[:4],
    )
    flat = [x for layer in layers for x in layer]
    # Compiling pays for a training only.
    one_period = (
        _compiled(batch.continuous)
        if torch.is_grad_enabled()
        else partial(_one_period, continuous=batch.continuous)
    )
    for step in range(steps):
        drawn = torch.randn(count, 6, generator=generator)
        p, heading, v, spin, before, spent, thrust = one_period(
            p, heading, v, spin, before, drawn, flat, fields, settings.temperature
        )
        if torch.is_grad_enabled():
            p, heading, v, spin = (
                Bounded.apply(keep * x + (1.0 - keep) * x.detach()) for x in (p, heading, v, spin)
            )
        cost = cost + spent + settings.thrust_price * period * thrust
        thrust_sum = thrust_sum + thrust.detach() * batch.scale[:, 0]
        with torch.no_grad():
            is_inside = (p.norm(dim=1) < 0.05) & (heading.cos() > 0.9962)
            last_outside = torch.where(is_inside, last_outside, (step + 1) * period)
            if step >= 0.8 * steps:
                held &= is_inside
    return Outcome(
        cost / least_time,
        held,
        last_outside / least_time,
        thrust_sum / (2.0 * torch.sqrt(start * a)),
    )


def imitate(
    network: DemandNetwork, pool: Pool, settings: DemandSettings, generator: torch.Generator
) -> None:
    """Bring a network near to the law made by hand, by least squares on states that flights may meet."""
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    for number in range(_IMITATIONS):
        batch = draw_batch(pool, settings, generator, continuous=True)
        p, heading, v, spin = batch.state
        # Half of the states are near the goal, at any scale.
        near = 10.0 ** (-3.0 * torch.rand(len(spin), generator=generator))
        near = torch.where(torch.rand(len(spin), generator=generator) < 0.5, near, 1.0)
        p = p * near[:, None]
        heading = heading * near
        v = v * near.sqrt()[:, None]
        spin = spin * near.sqrt()
        seen = ([*-p.T], (heading.cos(), -heading.sin()), [*v.T], spin, batch.authority)
        inputs = torch.stack(columns(*seen), dim=1)
        loss = (demanded(network.layers(), inputs) - stopping_law(*seen)).square().mean()
        optimizer.param_groups[0]["lr"] = 1e-2 * (1.0 - number / _IMITATIONS)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()


def train(
    settings: DemandSettings,
    report: Callable[[str, DemandNetwork], None] = lambda text, network: None,
    pool: Pool | None = None,
) -> DemandNetwork:
    """Train a network for the time of the settings.

    Args:
        settings: of the training.
        report: is given a line and the network, now and then.
        pool: layouts; None: those of the settings' seed.
    """
    generator = torch.Generator().manual_seed(settings.seed)
    pool = pool or draw_pool(settings.layouts, 2 * settings.seed)
    network = DemandNetwork(settings.channels, generator)
    optimizer = torch.optim.Adam(network.parameters(), settings.learning_rate, betas=(0.9, 0.98))
    begun = time.perf_counter()
    imitate(network, pool, settings, generator)
    number = 0
    while (elapsed := time.perf_counter() - begun) < settings.seconds:
        share = elapsed / settings.seconds
        # The step size rises within the first hundredth and falls to nothing at the end.
        rate = settings.learning_rate * min(1.0, 0.02 + 100.0 * share) * (1.0 - share**2)
        optimizer.param_groups[0]["lr"] = rate
        batch = draw_batch(pool, settings, generator, continuous=number % 2 == 1)
        outcome = fly(network.layers(), batch, settings, generator)
        # Hopeless flights must not outweigh all others.
        loss = (10.0 * torch.tanh(outcome.cost / 10.0)).sum()
        optimizer.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0 * settings.crafts)
        if norm.isfinite():
            optimizer.step()
        if number % 10 <= 1:
            report(
                f"{elapsed:6.0f} s {number:5d} cost {outcome.cost.mean():.3f} settled "
                f"{outcome.settled.float().mean():.3f} time {outcome.settling.median():.3f} impulse "
                f"{outcome.impulse.median():.3f} norm {norm / settings.crafts:.2f}",
                network,
            )
        number += 1
    return network


def as_policy(network: DemandNetwork, craft: Spacecraft, task: Task, period: float) -> Network:
    """The network as an ordinary policy of a craft, in its own task; see `rans.policy.any_craft.for_craft`."""
    architecture = Architecture(
        layout(task, craft.dimension),
        len(craft.commands),
        (8 * len(network.first),) * 2,
        head="gaussian" if craft.is_continuous else "on-off",
        backbone="allocated",
        tokens=effects(craft, period),
        authority=authority(craft, period),
    )
    first, second, last = ((w.detach(), b.detach()) for w, b in network.layers())
    tensors = last_layer(architecture, *last) | {
        f"{EXTRACTOR}trunk.{2 * number}.{name}": x
        for number, pair in enumerate((first, second))
        for name, x in zip(("weight", "bias"), pair, strict=True)
    }
    tensors |= {EXTRACTOR + name: x for name, x in architecture.statistics().items()}
    shapes = architecture.shapes()
    # There is no critic.
    return Network(architecture, {k: tensors.get(k, torch.zeros(s)) for k, s in shapes.items()})


def policy_layers(policy: Network) -> Layers:
    """Dense layers of a policy of `as_policy`, for `fly`."""
    trunk = [policy.layer(f"{EXTRACTOR}trunk.{2 * k}") for k in range(2)]
    return [*trunk, policy.architecture.last.folded(*policy.layer("action_net"))]
