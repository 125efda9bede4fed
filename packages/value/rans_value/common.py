"""The value function of all planar craft: what a craft can do is an input, by its thrusters' accelerations.

A craft is the set of accelerations that its thrusters give: along 42 directions of (x, y, turn) their sum of those
that push that way (the support function), and the most that a thruster gives for its thrust. Neither depends on the
order or number of thrusters, so that a dead or weak one, and what is estimated in flight, are craft like others.
Control periods differ by similarity: times count in periods.
"""

from __future__ import annotations

import math
from copy import copy
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import torch
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn import functional

from rans.extend import ConfigError, Spacecraft, Timing
from rans_value.problem import parted
from rans_value.varied import VariedProblem

PERIOD = 0.2
"""Control period of the fit, s."""
RANGE = 3.5
"""Distance from which flights begin in the mean, m."""
POSITION = 0.05
ATTITUDE = math.radians(5.0)
"""Tolerances of the fit."""
_INSIDE = 0.97
"""Tolerances of the costs, of those of the task: craft are not quite as in their files."""
_ERROR = 0.4
"""Cost of a second at the borders of position and heading, s; it grows with the square of both."""
_PRICED = 0.7
"""Largest price of thrust that raises the cost of an error."""
_APPROACH, _HOLD = 200.0, 6.0
"""Time constants of the discount outside and inside the tolerances, s in periods of the fit."""
_BRAKES = 0.05
"""Square of the speed over the acceleration, m, from which thrust inside has the price of the way: that brakes."""
ACCELERATIONS = 0.012, 1.3
ANGULAR_ACCELERATIONS = 0.06, 10.0
"""Authority of the craft of the fit in the weakest direction, in periods of 0.2 s, m/s^2 and rad/s^2."""
WEIGHTS = Path(__file__).parent / "data" / "planar.safetensors"
"""Weights that come with RANS, of half precision (`campaigns.common_value`)."""


class CommonProblem(VariedProblem):
    """Least cost of flights to a pose by the task's own success: seconds outside the pose, at rest or not.

    Inside, errors count by their square, and thrust has a price of its own unless it brakes.
    """

    hold_price: ClassVar[tuple[float, float]] = (0.6, 0.8)
    """Least and largest price of the full thrust that holds the pose, s/s."""

    def __init__(self, craft: Spacecraft, task: Any, timing: Timing) -> None:
        super().__init__(craft, task, timing)
        # Values are of the tolerance of the fit, and others as larger places.
        self._finer = POSITION / self._finest

    def terms(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """See `PoseProblem.terms`."""
        p, attitude, v, _, _ = parted(self.seen(state))
        return terms(
            p, attitude, v, self.price(state), self.acceleration, self.period, self.hold_price
        )


def terms(
    p: Tensor,
    attitude: Tensor,
    v: Tensor,
    price: Tensor,
    acceleration: Any,
    period: float,
    hold_price: tuple[float, float] = CommonProblem.hold_price,
) -> tuple[Tensor, Tensor, Tensor]:
    """Cost of a period by its state, its price of the full thrust and its discount."""
    place = p.square().sum(dim=0) / (POSITION * _INSIDE) ** 2
    turn = (attitude[0] / (ATTITUDE * _INSIDE)).square()
    inside = torch.maximum(place, turn) <= 1.0
    held = 0.5 * _ERROR * (place + turn) * (1.0 + price.clamp(max=_PRICED))
    braking = (v.square().sum(dim=0) / (_BRAKES * acceleration)).clamp(max=1.0)
    approach, hold = (math.exp(-PERIOD / x) for x in (_APPROACH, _HOLD))
    return (
        period * torch.where(inside, held, 1.0),
        torch.where(inside, torch.lerp(price.clamp(*hold_price), price, braking), price),
        torch.where(inside, hold, approach),
    )


def sphere(count: int) -> Tensor:
    """Unit vectors (count, 3) spread evenly (a Fibonacci lattice)."""
    k = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * k
    across = (1.0 - z * z).sqrt()
    return torch.stack((across * turn.cos(), across * turn.sin(), z), dim=1).float()


_WAYS = torch.cat(
    (sphere(36), torch.eye(3).repeat_interleave(2, 0) * torch.tensor([[1.0], [-1.0]] * 3))
)
"""Directions (42, 3) of x, y and turn in which a craft's code tells what it can do."""
_AROUND = torch.arange(16) * (math.pi / 8.0)
_NONE = 1e-6
"""Share of thrust below which there is no thruster."""


class Craft:
    """What values depend on of N craft, from accelerations (N, n, 3) by their thrusters, of periods of 0.2 s."""

    def __init__(self, columns: Tensor) -> None:
        pushes = columns[..., :2]
        around = torch.stack((_AROUND.cos(), _AROUND.sin())).to(columns)
        self.acceleration = (
            (pushes @ around).clamp(min=0.0).sum(dim=-2).amin(dim=-1).clamp(min=1e-4)
        )
        turns = columns[..., 2]
        either = [(side * turns).clamp(min=0.0).sum(dim=-1) for side in (1.0, -1.0)]
        self.angular = torch.minimum(*either).clamp(min=1e-4)
        """Authority in the weakest direction."""
        self.columns = columns
        self.thrust = pushes.square().sum(dim=-1).sqrt() / self.acceleration[..., None]
        """Thrust of each over the full thrust."""
        self.scale = (RANGE / self.acceleration).sqrt()
        """Time in which the craft gains its range, s."""
        works = self.thrust > _NONE
        kicks = turns.abs() * PERIOD
        kicks = torch.where(works & (kicks > 1e-3), kicks, 99.0)
        self.pulse = kicks.amin(dim=-1).clamp(max=3.0)
        """Smallest spin by a pulse, rad/s."""
        units = torch.stack((self.acceleration, self.acceleration, self.angular), dim=-1)
        along = (columns / units[..., None, :]) @ _WAYS.to(columns).T
        support = along.clamp(min=0.0).sum(dim=-2)
        best = (along / self.thrust.clamp(min=_NONE)[..., None]).where(works[..., None], 0.0)
        numbers = (
            self.acceleration.log(),
            self.angular.log(),
            self.pulse.log(),
            works.sum(dim=-1).to(columns).clamp(min=1.0).log(),
            (10.0 * PERIOD * self.pulse).tanh(),
        )
        sums = [x.clamp(0.0, 40.0).log1p() for x in (support, best.amax(dim=-2))]
        self.code = torch.cat((*sums, torch.stack(numbers, dim=-1)), dim=-1)


def to_rest(offset: Tensor, rate: Tensor, acceleration: Tensor) -> Tensor:
    """Least time in which a double integrator comes to rest at the origin, s."""
    side = torch.where(offset + rate * rate.abs() / (2 * acceleration) >= 0.0, 1.0, -1.0)
    inner = 0.5 * rate.square() + acceleration * side * offset
    return (side * rate + 2.0 * inner.clamp(min=0.0).sqrt()) / acceleration


def features(state: Tensor, craft: Craft, log_price: Tensor) -> Tensor:
    """Inputs (..., N, features) of states (6, ..., N) of N craft, at logarithms (..., N) of prices of thrust."""
    x, y, heading, vx, vy, spin = state
    a, angular, scale = craft.acceleration, craft.angular, craft.scale
    c, s = heading.cos(), heading.sin()
    speed_unit = (a * RANGE).sqrt()

    def in_body(along: Tensor, across: Tensor) -> tuple[Tensor, Tensor]:
        return c * along + s * across, c * across - s * along

    # In the frame of the goal and in that of the body, in units of the craft's authority.
    place = x / RANGE, y / RANGE
    motion = vx / speed_unit, vy / speed_unit
    columns = [*place, *motion, *in_body(*place), *in_body(*motion)]
    columns += [c, s, (2.0 * heading).cos(), (2.0 * heading).sin(), heading]
    columns += [spin / angular.sqrt(), 0.5 * spin]
    # Distances, speeds along and across, least times.
    distance = (x * x + y * y + 1e-6).sqrt()
    speed = (vx * vx + vy * vy + 1e-8).sqrt()
    along = (x * vx + y * vy) / distance
    across = (x * vy - y * vx) / distance
    columns += [distance / RANGE, (distance / RANGE).sqrt()]
    columns += [v / speed_unit for v in (along, across, speed)]
    times = [to_rest(x, vx, a), to_rest(y, vy, a), to_rest(heading, spin, angular)]
    times += [to_rest(distance, along, a)]
    times += [times[2] - times[0], times[2] - times[3]]
    columns += [time / scale if k < 4 else time for k, time in enumerate(times)]
    # Close to the goal, here and where the craft can come to rest.
    brake = speed * (0.5 / a)
    ahead = x + vx * brake, y + vy * brake, heading + 0.5 * spin * spin.abs() / angular
    units = (POSITION, POSITION, ATTITUDE)
    errors = [e / u for e, u in zip((x, y, heading), units, strict=True)]
    errors += [vx / POSITION, vy / POSITION, spin / ATTITUDE]
    errors += [e / u for e, u in zip(ahead, units, strict=True)]
    for steepness in (1.0, 0.2):
        columns += [(steepness * e).tanh() for e in errors]
    turned = heading.abs() / ATTITUDE
    columns += [(distance / POSITION - 1.0).tanh(), (turned - 1.0).tanh()]
    columns += [(4.0 * (torch.maximum(distance / POSITION, turned) / _INSIDE - 1.0)).tanh()]
    # Where it coasts to in a period.
    px, py, facing = x + PERIOD * vx, y + PERIOD * vy, heading + PERIOD * spin
    off = torch.maximum((px * px + py * py + 1e-8).sqrt() / POSITION, facing.abs() / ATTITUDE)
    columns += [(4.0 * (off / _INSIDE - 1.0)).tanh(), (facing / ATTITUDE).tanh()]
    # Where between the spins and headings that pulses can reach, unless these are close.
    pulse = craft.pulse
    for where, step, near in (
        (spin, pulse, (20.0 * (pulse - 0.02)).clamp(0.0, 1.0)),
        (
            heading - 0.5 * PERIOD * spin,
            PERIOD * pulse,
            (50.0 * (PERIOD * pulse - 0.02)).clamp(0.0, 1.0),
        ),
    ):
        phase = (2.0 * math.pi) * where / step
        columns += [near * phase.sin(), near * phase.cos()]
    # What thrusters do towards the goal, away from it and against the motion, in this heading and in the goal's.
    goal = -x / distance, -y / distance
    back = -goal[0], -goal[1]
    here = in_body(*goal)
    against = in_body(-vx / speed, -vy / speed)
    lx, ly = craft.columns[..., 0], craft.columns[..., 1]
    unit = (lx * lx + ly * ly).clamp(min=1e-12).rsqrt()
    for dx, dy in (here, (-here[0], -here[1]), against, goal, back):
        push = dx[..., None] * lx + dy[..., None] * ly
        columns += [(push.clamp(min=0.0).sum(dim=-1) / a).clamp(max=40.0).log1p()]
        columns += [(push * unit).amax(dim=-1)]
    columns += [0.5 * log_price, 0.25 * log_price.square(), log_price.exp(), a.log(), angular.log()]
    return torch.stack(torch.broadcast_tensors(*columns), dim=-1)


class CommonNetwork(nn.Module):
    """Value of states of craft: layers with skips, to each of which a code of the craft adds a vector."""

    mean: Tensor
    spread: Tensor
    cmean: Tensor
    cspread: Tensor

    def __init__(
        self, inputs: int = 68, codes: int = 89, units: int = 640, layers: int = 4
    ) -> None:
        super().__init__()
        for name, size in (
            ("mean", inputs),
            ("spread", inputs),
            ("cmean", codes),
            ("cspread", codes),
        ):
            self.register_buffer(name, torch.ones(size))
        sizes = (codes, 128, 128, layers * units)
        self.side = nn.Sequential()
        for size, following in pairwise(sizes):
            self.side.extend([nn.Linear(size, following), nn.SiLU()])
        del self.side[-1]
        self.first = nn.Linear(inputs, units)
        self.hidden = nn.ModuleList(nn.Linear(units, units) for _ in range(layers - 1))
        self.last = nn.Linear(units, 1)

    def added(self, craft: Craft) -> Tensor:
        """What codes of N craft add to each layer, (layers, N, units)."""
        added = self.side((craft.code - self.cmean) / self.cspread)
        return added.unflatten(-1, (-1, self.first.out_features)).movedim(-2, 0)

    def forward(self, state: Tensor, craft: Craft, log_price: Tensor, added: Tensor) -> Tensor:
        """Values (..., N) of states (6, ..., N), in seconds of craft with periods of 0.2 s."""
        x = self.first((features(state, craft, log_price) - self.mean) / self.spread)
        # Values need eleven bits, gradients a wider range, see `ValueNetwork`.
        half = torch.bfloat16 if torch.is_grad_enabled() else torch.float16
        if x.is_cuda:
            x, added = x.to(half), added.to(half)
        x = functional.silu(x + added[0])
        with torch.autocast("cuda", half, enabled=x.is_cuda):
            for layer, more in zip(self.hidden, added[1:], strict=True):
                x = x + functional.silu(layer(x) + more)
        x = x.float()
        price = log_price.exp()
        waiting = terms(state[:2], state[2:3], state[3:5], price, craft.acceleration, PERIOD)[0]
        return waiting + craft.scale * (1.0 + price) * functional.softplus(self.last(x)[..., 0])


class CommonValue:
    """Values of states (rows, ...) of a `CommonProblem`, whose flights are of craft that `of` reads."""

    _craft: Craft
    _added: Tensor

    def __init__(self, problem: CommonProblem) -> None:
        self._problem = problem
        self._network = CommonNetwork()
        self._network.load_state_dict({k: x.float() for k, x in load_file(WEIGHTS).items()})
        self.mean = self._network.mean
        self._rate = problem.period / PERIOD
        design = self.craft(problem.with_parameters(torch.zeros(7, 1)))
        for what, unit, reached, fitted in (
            ("acceleration", "m/s^2", design.acceleration, ACCELERATIONS),
            ("angular acceleration", "rad/s^2", design.angular, ANGULAR_ACCELERATIONS),
        ):
            low, high = (x / self._rate**2 for x in fitted)
            number = float(reached) / self._rate**2
            if not low <= number <= high:
                raise ConfigError(
                    f"the value function of all planar craft is of those that accelerate in the weakest direction "
                    f"by {low:.2g} to {high:.2g} {unit} where they are commanded every {problem.period:g} s, and "
                    f"the {what} of {problem.craft.name} is {number:.2g}: fly any-craft, or another control period."
                )

    def craft(self, state: Tensor) -> Craft:
        """What thrusters do as states (rows, N) say, in periods of 0.2 s."""
        count = 3 * self._problem.craft.thruster_count
        return Craft(state[6 : 6 + count].T.unflatten(1, (-1, 3)) * self._rate**2)

    def of(self, state: Tensor) -> CommonValue:
        """The values of flights whose thrusters do what states (rows, N) say."""
        made = copy(self)
        made._craft = self.craft(state)
        made._added = self._network.added(made._craft)
        return made

    def __call__(self, state: Tensor) -> Tensor:
        """Values, s, of states of these flights, one after the other any number of times."""
        count = len(self._craft.columns)
        each = state.unflatten(1, (-1, count))
        p, turn, v, spin, _ = parted(self._problem.seen(each))
        moving = torch.cat((p, turn, self._rate * v, self._rate * spin))
        price = self._problem.price(each).log()
        return self._rate * self._network(moving, self._craft, price, self._added).flatten()
