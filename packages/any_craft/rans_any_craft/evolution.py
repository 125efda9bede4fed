"""Weights of an agent for any craft at every frugality, by evolution strategies on flights of random layouts.

Weights are linear in the frugality between three nodes (`NODES`). Two networks of a pair, whose weights differ from
those of a value by the same random numbers with both signs, fly the same craft from the same starts. The difference
of their costs moves the weights of the nodes. The cost counts what tables do: settling time and thrust. Gradients
through flights lose them at high prices of thrust, and know nothing of coasting near the goal
(docs/decisions/any_craft_frugal.md). `rans_any_craft.agents` writes the result into the shipped agents; new numbers
drawn anywhere here, or in another order, train other weights.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from rans.extend import RansError
from rans.policy.any_craft import COAST
from rans.policy.authority import Authority, coasting, columns
from rans_any_craft.training import (
    Batch,
    DemandNetwork,
    DemandSettings,
    Layers,
    Motion,
    Pool,
    draw_batch,
    one_period,
)

NODES = (0.0, 0.5, 1.0)
"""Frugalities whose weights are stored."""
_LONGER = (0.72, 1.5, 3.0)
"""Time that a flight of each node takes, over twice the root of its distance over the acceleration."""
_DISTANCE = 0.047
"""Distance, m, within which a flight is settled: 3 mm less than the tolerance of go-to-pose, for sensors."""
_ANGLE = 0.082
"""Angle, rad, likewise: 0.3 degrees less."""
_LOST = (2.5, 0.5)
"""Settling time of flights that do not settle, over their length, and what is added for those that end as far
away as they began. With 1.5 in place of 2.5 frugal craft learn not to arrive; with 5, and logarithms of costs,
on/off craft in space take a half more thrust to lose fewer flights."""
_DROOP = 0.6
"""Least part of their force that throttled thrusters give in half of the flights: nozzles which share a plenum."""
_JUDGED = 1024
"""Craft of either kind of thruster that judge weights."""
_PARTS = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
"""Parts of the way from one node's weights to the next one's that are judged."""
_MAY_LOSE = 0.005
"""Part of the flights that weights of a node may lose beyond those of the beginning."""
_THROTTLED = 0.4
"""Part of the craft with continuous thrusters that never coast, as throttled ones; pulsed ones do."""
_LEAST_SCALE = 0.05
"""Least scale of a tensor's perturbations: biases may be zero."""
_MEAN, _SQUARE, _AVERAGE = 0.1, 0.02, 0.02
"""Part of a step in the mean and the mean square of gradients, and in the average of the weights."""


class TrainingFailed(RansError):
    """A training has ended with weights that are no better than those at its beginning."""


@dataclass(frozen=True)
class EvolutionSettings:
    """Settings of the evolution. Weights of trained networks are its start."""

    seconds: float = 150.0
    """Time, s."""
    prices: tuple[float, ...] = (0.08, 0.5, 1.1)
    """Price of a second of thrust with the craft's least authority at each node, in seconds of settling time."""
    pairs: int = 384
    """Pairs of networks in a step, for either kind of thruster."""
    crafts: int = 48
    """Craft that every pair flies."""
    sigma: float = 0.06
    """Standard deviation of perturbations, over the root mean square of each tensor of weights."""
    rate: float = 4e-3
    """Largest step of Adam, in the same unit."""
    steps: int = 200
    """Control periods of a flight."""
    coarse: float = 0.4
    """See `rans_any_craft.training.DemandSettings`."""
    seed: int = 0
    device: str = "cpu"
    """Device of torch."""


SETTINGS = {2: EvolutionSettings(), 3: EvolutionSettings(prices=(0.05, 0.5, 1.1), pairs=256)}
"""Settings by dimension. In space flights take twice the operations."""


class Flown(NamedTuple):
    """What the flights of a step were like."""

    cost: Tensor
    """(N,) settling time plus the price of thrust, s."""
    settling: Tensor
    """(N,) s; longer than the flight where it does not settle."""
    thrust: Tensor
    """(N,) seconds of thrust with the least authority."""


class _Crafts(NamedTuple):
    """Craft of a step, first all for one network of each pair, then the same for the other."""

    batch: Batch
    coast: Tensor
    """(N,) control periods of coasting; 0: never."""
    price: Tensor
    """(N,) of thrust."""


def parts_of_nodes(value: Tensor) -> Tensor:
    """Parts (N, 3) of the nodes' weights in those of frugalities (N,)."""
    low, middle, high = NODES
    first = ((middle - value) / (middle - low)).clamp(min=0.0)
    last = ((value - middle) / (high - middle)).clamp(min=0.0)
    return torch.stack((first, 1.0 - first - last, last), dim=1)


def _between(numbers: Sequence[float], value: Tensor) -> Tensor:
    """Numbers (N,) of frugalities (N,), whose logarithms are linear between those of the nodes."""
    return (parts_of_nodes(value) @ torch.tensor(numbers, device=value.device).log()).exp()


def _values(count: int, generator: torch.Generator) -> Tensor:
    """Frugalities of pairs (P,): of each eight two are the first node and one each other, the rest are between."""
    number = torch.arange(count, device=generator.device) % 8
    uniform = torch.rand(count, generator=generator, device=generator.device)
    low, middle, high = NODES
    between = torch.where(number < 6, middle * uniform, middle + (high - middle) * uniform)
    fixed = torch.tensor([low, middle, high, low], device=generator.device)
    return torch.where(number < 4, fixed[number.clamp(max=3)], between)


def _demands(
    error: Sequence[Tensor],
    turn: tuple[Tensor, Sequence[Tensor]],
    velocity: Sequence[Tensor],
    spin: Sequence[Tensor],
    authority: Authority,
    before: Tensor,
    layers: Layers,
    coast: Tensor,
) -> Tensor:
    """Demands (N, d) of G networks with layers (G, o, i), each for N / G craft; see `training.Law`.

    A GPU records it, so that it may not branch on values.
    """
    resting = coasting(error, turn, velocity, spin, authority, coast)
    coasts = coast > 0.0

    def chosen(rest: Sequence[Tensor], state: Sequence[Tensor]) -> list[Tensor]:
        return [torch.where(coasts, x, y) for x, y in zip(rest, state, strict=True)]

    cosine = torch.where(coasts, resting[1][0], turn[0])
    given = columns(
        chosen(resting[0], error),
        (cosine, chosen(resting[1][1], turn[1])),
        chosen(resting[2], velocity),
        chosen(resting[3], spin),
        authority,
    )
    x = torch.stack(given, dim=1).unflatten(0, (len(layers[0][0]), -1))
    for number, (weight, bias) in enumerate(layers):
        x = torch.baddbmm(bias[:, None], x, weight.mT)
        x = torch.tanh(x) if number < len(layers) - 1 else x
    return x.flatten(0, 1)


def _period(
    state: Motion,
    before: Tensor,
    drawn: Tensor,
    last_outside: Tensor,
    end: Tensor,
    flat: Sequence[Tensor],
    coast: Tensor,
    fields: Sequence[Tensor],
    continuous: bool,
) -> tuple[Motion, Tensor, Tensor, Tensor]:
    """State, twist, time when it was last outside of the tolerances, and thrust, after a period.

    The period ends ``end`` periods after the start. All are (n,) or (n, k) tensors of n craft; `_flown` calls it,
    and on a GPU a graph records it, so it may not branch on values.
    """
    layers = list(zip(flat[::2], flat[1::2], strict=True))
    law = partial(_demands, layers=layers, coast=coast)
    state, before, _, _, pushes = one_period(
        state, before, drawn, [], fields, continuous=continuous, law=law
    )
    inside = (state.p.norm(dim=1) < _DISTANCE) & (state.angle() < _ANGLE)
    return state, before, torch.where(inside, last_outside, end * fields[0]), pushes


def _flown(
    layers: Layers,
    crafts: _Crafts,
    steps: int,
    generator: torch.Generator,
    period_of: Callable[..., tuple[Motion, Tensor, Tensor, Tensor]],
) -> Flown:
    """Flights of G networks with layers (G, o, i): the crafts are dealt out to them in equal parts, in order.

    Draws one normal number a reading from `generator`, the same for both halves of the crafts: pairs of networks
    differ in their weights alone.
    """
    batch = crafts.batch
    state = batch.state
    period = batch.authority.period
    count, size = batch.scale.shape
    start = state.p.norm(dim=1)
    zero = torch.zeros_like(period)
    last_outside, thrust, before = zero, zero, zero[:, None].expand(-1, size)
    own = batch.authority
    ways = [*own.linear, *own.angular, own.least_linear, own.least_angular]
    craft = (batch.scale, batch.gain, batch.late, batch.noise, batch.centre, batch.moments)
    # The weight of angles is that of a cost which is not used here.
    fields = (period, torch.stack(ways), *craft, torch.ones_like(period[0]), *batch.pool[:8])
    flat = [x for layer in layers for x in layer]
    for number in range(steps):
        # Both networks of a pair read the same noise.
        drawn = torch.randn(count // 2, 2 * size, generator=generator, device=period.device)
        end = torch.full_like(period[0], number + 1.0)
        state, before, last_outside, pushes = period_of(
            state, before, drawn.repeat(2, 1), last_outside, end, flat, crafts.coast, fields
        )
        thrust = thrust + pushes * period
    length = steps * period
    is_lost = last_outside > length - 0.5 * period
    away = (state.p.norm(dim=1) / start.clamp(min=0.3)).clamp(max=1.0)
    settling = torch.where(is_lost, length * (_LOST[0] + _LOST[1] * away), last_outside + period)
    return Flown(settling + crafts.price * thrust, settling, thrust)


class Evolution:
    """Weights of the nodes, and steps that improve them."""

    def __init__(
        self,
        network: DemandNetwork,
        nodes: Sequence[Mapping[str, Tensor]],
        pool: Pool,
        settings: EvolutionSettings,
    ) -> None:
        """Begin with the weights of networks.

        Stores moments of Adam like `theta`, and the running average that `weights` gives.

        Args:
            network: of the dimension and size; its weights do not count.
            nodes: weights by name with which each node begins.
            pool: layouts.
            settings: of the evolution.
        """
        device = settings.device
        self._network = network.to(device)
        self._shapes = {name: x.shape for name, x in network.named_parameters()}
        self._settings = settings
        self._pool = Pool(*(x.to(device) for x in pool))
        self._generator = torch.Generator(device).manual_seed(settings.seed)
        rows = [torch.cat([node[name].flatten() for name in self._shapes]) for node in nodes]
        self.theta = torch.stack(rows).to(device)
        """(3, k) weights of the nodes."""
        scales = [
            torch.full((x.numel(),), max(float(x.square().mean().sqrt()), _LEAST_SCALE))
            for x in (nodes[0][name] for name in self._shapes)
        ]
        self._scale = torch.cat(scales).to(device)
        self._average = self.theta.clone()
        self._mean = torch.zeros_like(self.theta)
        self._square = torch.zeros_like(self.theta)
        self._count = 0
        self._recorded: dict[bool, tuple[torch.cuda.CUDAGraph, Layers, _Crafts, Flown]] = {}

    def layers(self, theta: Tensor) -> Layers:
        """Dense layers (G, o, i), (G, o) of weights (G, k); see `rans_any_craft.training.DemandNetwork.layers`."""
        sizes = [math.prod(shape) for shape in self._shapes.values()]
        weights = {
            name: part.unflatten(1, shape)
            for (name, shape), part in zip(
                self._shapes.items(), theta.split(sizes, dim=1), strict=True
            )
        }
        return self._network.stacked(weights)

    @torch.no_grad()
    def step(self, part: float) -> str:
        """Improve the weights, after a part of the time, and return a line of figures.

        `theta` changes in place. Draws come in the order values, noise, craft, for each kind of thruster.
        """
        own = self._settings
        gradient = torch.zeros_like(self.theta)
        weight = torch.zeros_like(self.theta[:, :1])
        line = f"{self._count:5d}"
        for continuous in (False, True):
            value = _values(own.pairs, self._generator)
            parts = parts_of_nodes(value)
            shape = (own.pairs, self.theta.shape[1])
            noise = torch.randn(shape, generator=self._generator, device=value.device)
            moved = own.sigma * self._scale * noise
            centre = parts @ self.theta
            layers = self.layers(torch.cat((centre + moved, centre - moved)))
            flown = self._fly(layers, self._crafts(value, continuous, own.crafts))
            plus, minus = flown.cost.unflatten(0, (2, own.pairs, own.crafts))
            # The derivative of the logarithm of the cost: every craft counts alike.
            change = (2.0 * (plus - minus) / (plus + minus)).mean(dim=1).nan_to_num(0.0)
            gradient += parts.T @ (change[:, None] * noise) / (2.0 * own.sigma)
            weight += parts.square().sum(dim=0)[:, None]
            cost = flown.cost.log().unflatten(0, (2, own.pairs, own.crafts)).mean(dim=(0, 2))
            means = (parts.T @ cost) / parts.sum(dim=0)
            line += " | log cost " + " ".join(f"{x:.3f}" for x in means.tolist())
        self._move(gradient / weight, part)
        return line

    def _move(self, gradient: Tensor, part: float) -> None:
        """Change `theta` and its average by a step of Adam along a gradient (3, k).

        ``part`` of the time, 0 to 1, is over. The size rises within the first twentieth of the time and falls to
        nothing.
        """
        self._count += 1
        self._mean.lerp_(gradient, _MEAN)
        self._square.lerp_(gradient.square(), _SQUARE)
        mean = self._mean / (1.0 - (1.0 - _MEAN) ** self._count)
        square = self._square / (1.0 - (1.0 - _SQUARE) ** self._count)
        rate = self._settings.rate * min(1.0, 0.05 + 20.0 * part) * (1.0 - part)
        self.theta -= rate * self._scale * mean / (square.sqrt() + 1e-8)
        self._average.lerp_(self.theta, max(_AVERAGE, 1.0 / self._count))

    def chosen(self, begun: Tensor, report: Callable[[str], None]) -> Tensor:
        """Weights (3, k) of the nodes: averages over the last fifty steps or so, as far as they lose no flight.

        The weights of a node are as far on the way from those of the node before it as they lose no more flights
        than the weights (k,) of the beginning, from the same starts with craft that no step has had.

        Raises:
            TrainingFailed: the first node is not quicker, or loses flights.
        """
        rows: list[Tensor] = []
        for number, (own, value) in enumerate(zip(self._average, NODES, strict=True)):
            parts = _PARTS if number else _PARTS[:1]
            before = rows[-1] if rows else own
            candidates = torch.stack([torch.lerp(before, own, part) for part in parts])
            lost, quicker = self._judged(candidates, begun, value)
            for part, *figures in zip(parts, lost, quicker, strict=True):
                report(
                    f"value {value:g}, {part:g} of the way: loses {100 * figures[0]:.2f} % more flights, takes "
                    f"{math.exp(figures[1]):.3f} of the time"
                )
            good = [k for k, more in enumerate(lost) if more <= _MAY_LOSE]
            if number == 0 and (not good or quicker[0] >= 0.0):
                raise TrainingFailed(
                    f"weights of the fast end lose {100 * lost[0]:.2f} % more flights than those at the beginning, "
                    f"and take {math.exp(quicker[0]):.3f} of their time: try another seed"
                )
            rows.append(candidates[good[0]] if good else before)
        return torch.stack(rows)

    def _judged(self, rows: Tensor, begun: Tensor, value: float) -> tuple[list[float], list[float]]:
        """What flights with weights (G, k) lose more than with others (k,), and logarithms of times over theirs.

        Both networks of a pair fly the same craft from the same starts; it draws from the training's own generator,
        which changes all that follows.
        """
        lost = torch.zeros(len(rows), device=rows.device)
        quicker = torch.zeros_like(lost)
        for continuous in (False, True):
            values = torch.full((len(rows),), value, device=rows.device)
            crafts = self._crafts(values, continuous, _JUDGED)
            layers = self.layers(torch.cat((rows, begun.expand_as(rows))))
            own = self._settings
            flown = _flown(
                layers,
                crafts,
                own.steps,
                self._generator,
                partial(_period, continuous=continuous),
            )
            length = own.steps * crafts.batch.authority.period
            shape = (2, len(rows), _JUDGED)
            is_lost = (flown.settling > length).float().unflatten(0, shape)
            lost += 0.5 * (is_lost[0] - is_lost[1]).mean(dim=1)
            both = 1.0 - is_lost.amax(dim=0)
            times = flown.settling.log().unflatten(0, shape)
            change = ((times[0] - times[1]) * both).sum(dim=1) / both.sum(dim=1)
            quicker += 0.5 * change
        return lost.tolist(), quicker.tolist()

    def named(self, rows: Tensor) -> list[dict[str, Tensor]]:
        """Weights (G, k), flat in the order of `_shapes`, as a dictionary of tensors by name for each row.

        Names are those of `DemandNetwork`'s parameters.
        """
        sizes = [math.prod(shape) for shape in self._shapes.values()]
        return [
            {
                name: part.reshape(shape).clone()
                for (name, shape), part in zip(self._shapes.items(), row.split(sizes), strict=True)
            }
            for row in rows.cpu()
        ]

    def _crafts(self, value: Tensor, continuous: bool, number: int) -> _Crafts:
        """Craft, a number of them for each pair, whose frugalities are (P,).

        It draws the batch first and then one number a craft: seeds of trainings rely on the order.
        """
        own = self._settings
        value = value.repeat_interleave(number)
        settings = DemandSettings(
            self._network.dimension, crafts=len(value), steps=own.steps, coarse=own.coarse
        )
        batch = draw_batch(self._pool, settings, self._generator, continuous)
        # Frugal flights take longer, and begin nearer, so that they end in half of the time.
        reach = own.steps * batch.authority.period / (4.0 * _between(_LONGER, value))
        far = batch.state.p.norm(dim=1).clamp(min=1e-3)
        nearer = (batch.authority.least_linear * reach.square() / far).clamp(max=1.0)
        batch = batch._replace(state=batch.state._replace(p=nearer[:, None] * batch.state.p))
        uniform = torch.rand(len(value), generator=self._generator, device=value.device)
        is_throttled = (uniform < _THROTTLED) & continuous
        coast = torch.where(is_throttled, 0.0, COAST)
        # Half of the throttled ones droop.
        drooped = _DROOP + (1.0 - _DROOP) * 2.0 * uniform / _THROTTLED
        gain = torch.where(is_throttled, drooped.clamp(max=1.0), 1.0)
        batch = batch._replace(gain=gain[:, None] * batch.gain)
        return _twice(_Crafts(batch, coast, _between(own.prices, value)))

    def _fly(self, layers: Layers, crafts: _Crafts) -> Flown:
        """Flights; on a GPU their operations are recorded once for each kind of thruster, and replayed.

        The recording reads `crafts` and `layers` from where it was made, so new values are copied there.
        """
        continuous = crafts.batch.continuous
        steps, generator = self._settings.steps, self._generator
        alone = partial(_period, continuous=continuous)
        if generator.device.type != "cuda":
            return _flown(layers, crafts, steps, generator, alone)
        if continuous not in self._recorded:
            compiled = torch.compile(alone, dynamic=False)
            kept = [(weight.clone(), bias.clone()) for weight, bias in layers]
            # Compilers and libraries begin on another stream, before the recording.
            stream = torch.cuda.Stream()
            stream.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(stream):
                for _ in range(2):
                    _flown(kept, crafts, steps, generator, compiled)
            torch.cuda.current_stream().wait_stream(stream)
            graph = torch.cuda.CUDAGraph()
            graph.register_generator_state(generator)
            with torch.cuda.graph(graph):
                flown = _flown(kept, crafts, steps, generator, compiled)
            self._recorded[continuous] = graph, kept, crafts, flown
        graph, *recorded, flown = self._recorded[continuous]
        for old, new in zip(_tensors(recorded), _tensors((layers, crafts)), strict=True):
            old.copy_(new)
        graph.replay()
        return flown


def _twice(entry: Any) -> Any:
    """The entry with every tensor (N, ...) repeated (2 N, ...)."""
    if isinstance(entry, Tensor):
        return torch.cat((entry, entry))
    if not isinstance(entry, tuple | list):
        return entry
    parts = [_twice(x) for x in entry]
    return type(entry)(*parts) if hasattr(entry, "_fields") else parts


def _tensors(entry: Any) -> Iterator[Tensor]:
    """Tensors of nested tuples and lists, one after the other."""
    if isinstance(entry, Tensor):
        yield entry
    elif isinstance(entry, tuple | list):
        for x in entry:
            yield from _tensors(x)


def evolve(
    begun: Sequence[DemandNetwork],
    pool: Pool,
    settings: EvolutionSettings,
    report: Callable[[str], None] = lambda line: None,
) -> list[dict[str, Tensor]]:
    """Evolve weights for the values `NODES` from fast to frugal for some time, and choose the best of each.

    Returns weights by name, one table a value of `NODES`, in this order. The time is that of a clock, so that
    another machine finds others.

    Args:
        begun: the network that `rans_any_craft.training.train` has trained, then those of the nodes if there are
            any, with which the evolution begins.
        pool: layouts.
        settings: of the evolution.
        report: is given a line now and then.

    Raises:
        TrainingFailed: the weights are no better than those at the beginning.
    """
    first, *nodes = (
        {name: x.detach().cpu().clone() for name, x in one.named_parameters()} for one in begun
    )
    evolution = Evolution(begun[0], nodes or [first] * len(NODES), pool, settings)
    own = torch.cat([x.flatten() for x in first.values()]).to(settings.device)
    evolution.step(0.0)  # compilers take their time
    begin = time.perf_counter()
    number = 0
    while (elapsed := time.perf_counter() - begin) < settings.seconds:
        line = evolution.step(elapsed / settings.seconds)
        if number % 20 == 0:
            report(f"{elapsed:6.0f} s {line}")
        number += 1
    return evolution.named(evolution.chosen(own, report))
