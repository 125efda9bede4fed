"""Fit of the value function of all planar craft: ``python -m campaigns common-value FOLDER [--seconds 900]``.

Fitted value iteration as that of `rans_value.learner`, over random craft. Flights are by the best of single flips
of valves; half of them are of craft that are not as their files say, so that values are of flights in which
thrusters, readings and timing are off. The folder gets ``planar.safetensors`` every minute, from which a further
call goes on. On an H200 a round takes 0.37 s.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from copy import deepcopy
from pathlib import Path
from typing import Any

import torch
from rans_value.common import (
    ACCELERATIONS,
    ANGULAR_ACCELERATIONS,
    PERIOD,
    RANGE,
    CommonNetwork,
    Craft,
    features,
    sphere,
    terms,
    to_rest,
)
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.nn import functional

from campaigns.command import ended

_THRUSTERS = ((4, 8), (5, 12), (9, 24))
"""Fewest and most thrusters of the craft of a round, and how often there are such rounds."""
_OFTEN = (0.6, 0.25, 0.15)
_SIDES = 24
_PERIODS = 10
"""Control periods that are flown to a target."""
_FLIGHTS = 6
"""Rounds that are fitted together."""
_UPDATES = 32
"""Gradient steps in a round."""
_GOES_ON = 0.6
"""Part of the flights that begin where others ended."""
_RATE = 1e-3
_KEEP = 0.98
"""Average of the weights over gradient steps, by which is flown."""
_PRICE = (0.02, 4.0)
"""Least and largest price of the full thrust, s/s."""
_OFF = 0.45
"""Part of the flights of craft that are not as designed."""
_LOST = (6.0, 8.0)
"""Value, in times in which the craft gains its range and that at full thrust, beyond which flights do not go on,
and the largest that is fitted."""
_NOISE = (0.005, 0.005, 0.009, 0.01, 0.01, 0.009)
"""Largest standard deviations of readings, SI."""
_NODES = (0.0694318442, 0.3300094782, 0.6699905218, 0.9305681558)
_WEIGHTS = (0.1739274226, 0.3260725774, 0.3260725774, 0.1739274226)
"""Gauss-Legendre's."""


class Random:
    """Random numbers of a device."""

    def __init__(self, device: str, seed: int) -> None:
        self.device = device
        self._generator = torch.Generator(device).manual_seed(seed)

    def __call__(self, *shape: int) -> Tensor:
        """Numbers in [0, 1)."""
        return torch.rand(shape, generator=self._generator, device=self.device)

    def whole(self, below: int, *shape: int) -> Tensor:
        """Whole numbers from 0 to less than a number."""
        return torch.randint(below, shape, generator=self._generator, device=self.device)

    def either(self, *shape: int) -> Tensor:
        """Numbers from -1 to 1."""
        return 2.0 * self(*shape) - 1.0

    def normal(self, *shape: int) -> Tensor:
        """Numbers of the standard normal distribution."""
        return torch.randn(shape, generator=self._generator, device=self.device)


def random_craft(random: Random, count: int, fewest: int, most: int) -> Tensor:
    """Accelerations (count, 24, 3) of random craft by their thrusters; those that are none are zero."""
    found: list[Tensor] = []
    ways = sphere(256).to(random.device)
    around = torch.arange(16, device=random.device) * (math.pi / 8.0)
    around = torch.stack((around.cos(), around.sin()))
    k = torch.arange(most, device=random.device)[None]
    while sum(map(len, found)) < count:
        batch = 4096
        number = fewest + random.whole(most - fewest + 1, batch, 1)

        def some(part: float, size: Any, number: int = batch) -> Any:
            return torch.where(random(number, 1) < part, size, 0.0)

        # Two at each corner of a rectangle (along its sides, or across), in a ring, or anywhere.
        aspect = 0.4 + 0.6 * random(batch, 1)
        corner = (k // 2) % 4
        inset = torch.where(k < 8, 1.0, 0.5 + some(0.5, 0.5 * random(batch, most)))
        cx = torch.where((corner == 0) | (corner == 3), inset, -inset)
        cy = torch.where(corner < 2, inset, -inset) * aspect
        odd = k % 2 == 0
        quarter = 0.5 * math.pi
        along = torch.where(cx > 0.0, math.pi, 0.0)
        sides = torch.where(odd, along, torch.where(cy > 0.0, -quarter, quarter))
        turned = torch.where(odd, 1.0, -1.0)
        pairs = (2.0 * math.pi) * ((k // 2) / ((number + 1) // 2) + random(batch, 1))
        reach = random(batch, most).sqrt()
        somewhere = 2.0 * math.pi * random(batch, most)
        axes = torch.where(random(batch, 1) < 0.5, (k + k // 4) % 4, random.whole(4, batch, most))
        families = (
            (cx, cy, sides),
            (cx, cy, torch.atan2(cy, cx) + turned * quarter),
            (pairs.cos(), pairs.sin(), pairs + turned * (quarter + random(batch, 1) - 0.3)),
            (reach * somewhere.cos(), reach * somewhere.sin(), 2.0 * math.pi * random(batch, most)),
            (reach * somewhere.cos(), reach * somewhere.sin(), quarter * axes),
        )
        family = random.whole(5, batch)
        chosen = [torch.stack(torch.broadcast_tensors(*x)) for x in zip(*families, strict=True)]
        px, py, angle = (x[family, torch.arange(batch, device=random.device)] for x in chosen)
        # Crooked, moved, with the centre of mass off, of unequal forces, one missing.
        angle = angle + (random(batch, most) - 0.5) * some(0.35, 0.6 * random(batch, 1))
        px, py = (
            x
            + some(0.3, 0.3) * (random(batch, most) - 0.5)
            + some(0.35, 0.5) * (random(batch, 1) - 0.5)
            for x in (px, py)
        )
        force = (some(0.5, 1.2 * random(batch, 1)) * random.either(batch, most)).exp()
        gone = (k == (random(batch, 1) * number).long()) & (random(batch, 1) < 0.2)
        force = force * ((k < number) & ~gone)
        heading = torch.where(random(batch, 1) < 0.3, 2.0 * math.pi * random(batch, 1), 0.0)
        heading = heading + (math.pi / 4.0) * random.whole(2, batch, 1)
        torque = force * (px * angle.sin() - py * angle.cos())
        angle = angle + heading
        columns = torch.stack((force * angle.cos(), force * angle.sin(), torque), dim=-1)
        # Those that can be steered, at random authorities.
        push = (columns[..., :2] @ around).clamp(min=0.0).sum(dim=1).amin(dim=1)
        either = [(side * columns[..., 2]).clamp(min=0.0).sum(dim=1) for side in (1.0, -1.0)]
        turn = torch.minimum(*either)
        steers = (push > 0.05) & (turn > 0.05)
        columns = columns / torch.stack((push, push, turn), dim=1).clamp(min=0.05)[:, None]
        steers &= (columns @ ways.T).clamp(min=0.0).sum(dim=1).amin(dim=1) > 0.2
        a, b = (
            torch.exp(math.log(low) + math.log(high / low) * random(batch))
            for low, high in (ACCELERATIONS, ANGULAR_ACCELERATIONS)
        )
        steers &= (b / a > 0.5) & (b / a < 60.0)
        columns = columns * torch.stack((a, a, b), dim=1)[:, None]
        kicks = PERIOD * columns[..., 2].abs()
        steers &= torch.where(kicks > 1e-3, kicks, 99.0).amin(dim=1) < 2.0
        found.append(functional.pad(columns[steers], (0, 0, 0, _SIDES - most)))
    return torch.cat(found)[:count]


def taken(craft: Craft, index: Tensor) -> Craft:
    """The craft at some indices."""
    made = object.__new__(Craft)
    for name, x in vars(craft).items():
        setattr(made, name, x[index])
    return made


def moved(state: Tensor, acceleration: Tensor, seconds: Any, push: Any = 0.0) -> Tensor:
    """States (6, ..., N) after a time with accelerations (3, ..., N) in B and a push (2, N) in the goal's frame."""
    x, y, heading, vx, vy, spin = state
    along, across, turning = acceleration
    force, place = torch.zeros_like(state[:2]), torch.zeros_like(state[:2])
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        at = node * seconds
        angle = heading + spin * at + 0.5 * turning * at * at
        c, s = angle.cos(), angle.sin()
        here = torch.stack((c * along - s * across, s * along + c * across)) + push
        force, place = force + weight * here, place + weight * (1.0 - node) * here
    after = heading + spin * seconds + 0.5 * turning * seconds * seconds
    after = after - 2.0 * math.pi * torch.round(after / (2.0 * math.pi))
    velocity = torch.stack((vx, vy))
    there = torch.stack((x, y)) + seconds * velocity + seconds * seconds * place
    rows = (there, after[None], velocity + seconds * force, (spin + seconds * turning)[None])
    return torch.cat(rows)


class Fit:
    """The value function, its flights and its gradient steps.

    Args:
        device: device of torch.
        flights: flights of a round, of as many random craft.
        batch: states in a gradient step.
        units: units of a layer.
        crafts: random craft of each number of thrusters.
    """

    def __init__(
        self, device: str, flights: int, batch: int, units: int, crafts: int, seed: int = 7
    ) -> None:
        torch.manual_seed(seed)
        self.random = Random(device, seed)
        self.flights, self.batch, self.crafts = flights, batch, crafts
        drawn = [random_craft(self.random, crafts, *number) for number in _THRUSTERS]
        self.craft = Craft(torch.cat(drawn))
        index = self.random.whole(crafts, flights)
        example = taken(self.craft, index)
        state, log_price = self.begun(example)
        inputs = features(state, example, log_price)
        self.value = CommonNetwork(inputs.shape[1], self.craft.code.shape[1], units).to(device)
        for name, x in (("", inputs), ("c", self.craft.code)):
            getattr(self.value, f"{name}mean").copy_(x.mean(dim=0))
            getattr(self.value, f"{name}spread").copy_(x.std(dim=0).clamp(min=0.05))
        self.average = deepcopy(self.value)
        self._adam = torch.optim.Adam(self.value.parameters(), _RATE)
        self._ends: dict[int, tuple[Tensor, ...]] = {}
        self._rounds: list[tuple[Tensor, ...]] = []
        fused: Any = torch.compile if device.startswith("cuda") else (lambda x: x)
        self._values = fused(lambda *x: self.average(*x))
        self._loss = fused(self._loss_of)

    def begun(self, craft: Craft) -> tuple[Tensor, Tensor]:
        """States (6, N) at which flights of craft begin, half of them near the goal, and logarithms of prices."""
        random, count = self.random, len(craft.scale)
        # From afar, half of them moving.
        far = torch.where(random(count) < 0.75, 3.0 + random(count), 4.5 * random(count))
        angle, way = 2.0 * math.pi * random(count), 2.0 * math.pi * random(count)
        moving = (random(count) < 0.5) * random(count)
        speed = 0.35 * moving * random(count)
        places = far * angle.cos(), far * angle.sin(), math.pi * random.either(count)
        task = (*places, speed * way.cos(), speed * way.sin(), 0.6 * moving * random.either(count))
        # Near, at random scales; spins are whole pulses or not.
        scale = torch.exp(math.log(0.008) * random(count))
        fast = (craft.acceleration * RANGE).sqrt() * scale
        spin = 2.0 * craft.angular.sqrt() * scale * random.either(count)
        whole = (random(count) < 0.5) & (craft.pulse > 0.03)
        spin = torch.where(whole, (spin / craft.pulse).round() * craft.pulse, spin)
        px, py, turn, vx, vy = random.either(5, count)
        turn = math.pi * turn * scale ** torch.where(random(count) < 0.5, 0.5, 1.0)
        near = (1.5 * scale * px, 1.5 * scale * py, turn, fast * vx, fast * vy, spin)
        low, high = map(math.log, _PRICE)
        log_price = low + (high - low) * (1.2 * random(count) - 0.1).clamp(0.0, 1.0)
        is_task = random(count) < 0.5
        return torch.where(is_task, torch.stack(task), torch.stack(near)), log_price

    def best(
        self, state: Tensor, craft: Craft, log_price: Tensor, added: Tensor, most: int
    ) -> Tensor:
        """Patterns (N, 24) of least cost of a period and the value after it, by flips of single valves."""
        count = state.shape[1]
        flips = torch.eye(most + 1, _SIDES + 1, device=state.device)[:, 1:]
        waiting, price, discount = _terms(state, craft, log_price)

        def costs(patterns: Tensor) -> Tensor:
            acceleration = torch.einsum("cnk,nkd->dcn", patterns, craft.columns)
            after = moved(state[:, None], acceleration, PERIOD)
            burnt = PERIOD * (patterns * craft.thrust).sum(dim=2)
            return waiting + price * burnt + discount * self._values(after, craft, log_price, added)

        tried = [flips[:, None].expand(-1, count, -1)]
        cost = [costs(tried[0])]
        # All that promise something alone, then flips of it, then of the best.
        pattern = functional.pad((cost[0][1:] < cost[0][:1]).T.float(), (0, _SIDES - most))
        for _ in range(2):
            tried.append((pattern - flips[:, None]).abs())
            cost.append(costs(tried[-1]))
            least = torch.cat(cost).argmin(dim=0)
            pattern = torch.cat(tried)[least, torch.arange(count, device=state.device)]
        return pattern

    @torch.no_grad()
    def flown(self, kind: int) -> tuple[Tensor, ...]:
        """States of a round of flights, costs from there, logarithms of prices, and numbers of the craft."""
        random, count = self.random, self.flights
        index = kind * self.crafts + random.whole(self.crafts, count)
        state, log_price = self.begun(taken(self.craft, index))
        if kind in self._ends:
            ended_in, priced, flown = self._ends[kind]
            goes_on = random(count) < _GOES_ON
            index = torch.where(goes_on, flown, index)
            state = torch.where(goes_on, ended_in, state)
            log_price = torch.where(goes_on & (random(count) < 0.8), priced, log_price)
        craft = taken(self.craft, index)
        added = self.average.added(craft)
        most = _THRUSTERS[kind][1]
        # What is not as in the file: forces, mass, a thruster, delay, readings, a constant push.
        off = random(count) < _OFF

        def some(part: float) -> Tensor:
            return off & (random(count) < part)

        heavier = 1.0 + 0.1 * some(0.5)[:, None] * random.either(count, 1)
        gain = heavier + 0.08 * off[:, None] * random.either(count, _SIDES)
        dead = (random(count, 1) * most).long() == torch.arange(_SIDES, device=state.device)
        gain = torch.where(dead & some(0.08)[:, None] & self._spared(craft), 0.0, gain)
        late = 0.5 * PERIOD * some(0.4) * random(count)
        noise = some(0.4) * random(count) * state.new_tensor(_NOISE)[:, None]
        push = 0.1 * some(0.4) * craft.acceleration * random.either(2, count)
        columns = craft.columns * gain[..., None]
        # A quarter begins with a random command.
        first = (random(count, _SIDES) < 0.25) & (random(count, 1) < 0.25)
        state = moved(state, _pushed(first.float(), craft.columns), PERIOD)
        before = torch.zeros_like(craft.thrust)
        periods = []
        for _ in range(_PERIODS):
            seen = state + noise * random.normal(6, count)
            command = self.best(seen, craft, log_price, added, most)
            waiting, price, discount = _terms(state, craft, log_price)
            burnt = PERIOD * (command * craft.thrust).sum(dim=1)
            periods.append((state, waiting + price * burnt, discount))
            state = moved(state, _pushed(before, columns), late, push)
            state = moved(state, _pushed(command, columns), PERIOD - late, push)
            before = command
        scale = craft.scale * (1.0 + log_price.exp())
        target = self.average(state, craft, log_price, added).clamp(max=_LOST[1] * scale)
        over = (target > _LOST[0] * scale) | (state[:2].norm(dim=0) > 9.0) | (state[5].abs() > 4.0)
        self._ends[kind] = torch.where(over, self.begun(craft)[0], state), log_price, index
        states, targets = [], []
        for begun, cost, discount in reversed(periods):
            target = cost + discount * target
            states.append(begun)
            targets.append(target)
        numbers = (x.repeat(_PERIODS) for x in (log_price, index))
        return (torch.cat(states, dim=1), torch.cat(targets), *numbers)

    def _spared(self, craft: Craft) -> Tensor:
        """Which thrusters (N, 24) craft can do without."""
        units = torch.stack((craft.acceleration, craft.acceleration, craft.angular), dim=1)
        ways = sphere(64).to(units).T
        along = ((craft.columns / units[:, None]) @ ways).clamp(min=0.0)
        return (along.sum(dim=1, keepdim=True) - along).amin(dim=2) > 0.15

    def _loss_of(self, state: Tensor, target: Tensor, log_price: Tensor, craft: Craft) -> Tensor:
        value = self.value(state, craft, log_price, self.value.added(craft))
        # Errors count relative to the value, with a floor of a twenty-fifth of the time scale.
        floor = 0.04 * craft.scale * (1.0 + log_price.exp().clamp(max=1.0))
        error = (value - target) / (target + floor)
        return functional.smooth_l1_loss(error, torch.zeros_like(error), beta=0.05)

    def fit(self, state: Tensor, target: Tensor, log_price: Tensor, index: Tensor) -> float:
        """One gradient step; returns the loss."""
        loss = self._loss(state, target, log_price, taken(self.craft, index))
        self._adam.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.value.parameters(), 1.0)
        self._adam.step()
        with torch.no_grad():
            for average, weight in zip(
                self.average.parameters(), self.value.parameters(), strict=True
            ):
                average.lerp_(weight, 1.0 - _KEEP)
        return float(loss.detach())

    def begin(self, steps: int) -> None:
        """Fit the first values: times of double integrators, and of thrust."""
        for _ in range(steps):
            index = self.random.whole(len(self.craft.scale), self.batch)
            craft = taken(self.craft, index)
            state, log_price = self.begun(craft)
            x, y, heading, vx, vy, spin = state
            place = to_rest(x, vx, craft.acceleration), to_rest(y, vy, craft.acceleration)
            seconds = torch.hypot(*place) + 0.5 * to_rest(heading, spin, craft.angular).abs()
            target = seconds * (1.0 + 0.5 * log_price.exp()) + _terms(state, craft, log_price)[0]
            self.fit(state, target, log_price, index)

    def round(self, done: float) -> float:
        """A round of flights and gradient steps at a part of the fit that is done; returns the mean loss."""
        self._adam.param_groups[0]["lr"] = _RATE * (0.01 + 0.495 * (1.0 + math.cos(math.pi * done)))
        kind = int(torch.multinomial(torch.tensor(_OFTEN), 1))
        self._rounds = [*self._rounds[1 - _FLIGHTS :], self.flown(kind)]
        rows = [torch.cat(x, dim=-1) for x in zip(*self._rounds, strict=True)]
        losses = []
        for _ in range(_UPDATES):
            index = self.random.whole(len(rows[1]), self.batch)
            losses.append(self.fit(*(x[..., index] for x in rows)))
        return sum(losses) / len(losses)

    def save(self, file: Path) -> None:
        """Write the average weights, of half precision."""
        save_file({k: x.half().contiguous() for k, x in self.average.state_dict().items()}, file)

    def load(self, file: Path) -> None:
        """Go on from weights."""
        weights = {name: x.float() for name, x in load_file(file).items()}
        for network in (self.value, self.average):
            network.load_state_dict(weights)


def _terms(state: Tensor, craft: Craft, log_price: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    p, turn, v = state[:2], state[2:3], state[3:5]
    return terms(p, turn, v, log_price.exp(), craft.acceleration, PERIOD)


def _pushed(command: Tensor, columns: Tensor) -> Tensor:
    return torch.einsum("nk,nkd->dn", command, columns)


def main() -> int:
    """Fit, or go on with a fit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, default=900.0)
    parser.add_argument("--device", default="cuda")
    chosen = parser.parse_args()
    fit = Fit(chosen.device, flights=24576, batch=65536, units=640, crafts=32768)
    file = chosen.folder / "planar.safetensors"
    chosen.folder.mkdir(parents=True, exist_ok=True)
    if file.exists():
        fit.load(file)
    else:
        fit.begin(400)
    begun = saved = time.monotonic()
    while (now := time.monotonic()) - begun < chosen.seconds:
        loss = fit.round((now - begun) / chosen.seconds)
        if now - saved > 60.0:
            fit.save(file)
            saved = now
            print(f"{now - begun:.0f} s, loss {loss:.4f}", flush=True)  # noqa: T201
    fit.save(file)
    return 0


if __name__ == "__main__":
    sys.exit(ended("python -m campaigns common-value", main))
