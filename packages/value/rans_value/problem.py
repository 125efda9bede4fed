"""Flights to a pose in the plane as a problem of optimal control: motion, costs, and inputs of a value function.

A flight costs the time outside the goal set and the price of its impulse. States are (7, ...): position (m) and
heading (rad) of the craft in the frame of the goal, velocity (m/s), spin (rad/s), and the trade-off between time
and impulse, 0 to 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import torch
from torch import Tensor

from rans.extend import (
    Body,
    Heading,
    PlanarState,
    Spacecraft,
    State,
    Vec2,
    advance,
    map_leaves,
)
from rans.model.dynamics import mean_thrust, undelayed
from rans.policy.allocation import subsets
from rans.policy.symmetry import symmetries
from rans.tasks.goal_set import REST_SPEED, REST_SPIN

_NODES = 4
"""Nodes of the quadrature of translation, of which float32 needs four."""
_INSIDE = 0.99
"""Tolerances of the costs, of those of the task, so that rounding leaves no flight outside."""
_RESTLESS = 0.8
"""Part of the cost of a second that is due until the craft is at rest in the goal set. The other part is due until
the pose is within the tolerances: a spin between two of those that pulses can reach may allow no rest."""
_PRICE = (0.02, 4.0)
"""Price of the full thrust at a trade-off of 0 and of 1, seconds outside the goal set a second."""
TRADE_OFF = 0.2
"""Trade-off where goals note none."""
_APPROACH = 200.0
_HOLD = 6.0
"""Time constants of the discount outside and inside the goal set, s. Flights are far shorter than the first; the
second is long enough to hold, and short enough that holding does not delay arrival."""
_HOLD_PRICE = (0.2, 0.7)
"""Least and largest price of the full thrust inside the goal set, s/s: a quick flight gains nothing by it there,
and a thrifty one shall not stay outside because holding is dear."""
_ERROR = 0.3
"""Cost of a second at the borders of position and heading, s: the pose is held well within them, and errors of the
value function, or of a policy that imitates its commands, leave no flight outside. It is linear in the error:
by its square, 0.2 at the borders, 3 instead of 59 % of flights stay within 2 cm."""
_SCALES = (1.0, 0.2)
"""Tolerances at which inputs of the value function are steepest, of the errors and their rates, over those of the
goal set."""
_COARSE = 0.02
"""Least distance between headings at rest, rad, at which the value function is given where they lie."""


def relative(state: State, goal: State, like: Tensor, trade_off: float = TRADE_OFF) -> Tensor:
    """States (7, N) of N spacecraft in the frame of their goals, in dtype and device of another tensor.

    The trade-off counts where the goals note none.
    """
    number = partial(torch.as_tensor, dtype=like.dtype, device=like.device)
    now: Any = map_leaves(number, state)
    aim: Any = map_leaves(number, goal)
    cos, sin = aim.attitude.angle.cos(), aim.attitude.angle.sin()
    turned = [
        turn
        for u in (now.p - aim.p, now.v - aim.v)
        for turn in (cos * u.x + sin * u.y, cos * u.y - sin * u.x)
    ]
    heading = _wrapped(now.attitude.angle - aim.attitude.angle)
    noted = number(getattr(goal.notes, "trade_off", trade_off))
    rows = (*turned[:2], heading, *turned[2:], now.w, noted)
    return torch.stack(torch.broadcast_tensors(*rows))


def equivalent(state: Tensor, turn: Tensor, hand: Tensor) -> Tensor:
    """States (7, N) as seen from other sides of a craft, see `rans.policy.symmetry.Symmetries`."""
    x, y, heading, vx, vy, spin, trade_off = state
    rows = (
        turn[..., 0, 0] * x + turn[..., 0, 1] * y,
        turn[..., 1, 0] * x + turn[..., 1, 1] * y,
        hand * heading,
        turn[..., 0, 0] * vx + turn[..., 0, 1] * vy,
        turn[..., 1, 0] * vx + turn[..., 1, 1] * vy,
        hand * spin,
        trade_off,
    )
    return torch.stack(rows)


class PoseProblem:
    """Least cost of flights of a craft to a pose in the plane.

    Args:
        craft: planar craft with thrusters, which are opened or not.
        task: flight to a pose, whose tolerances count.
        period: control period, s.
        position_tolerance: tolerance in flight, m, that of the task or finer; None: that of the task.
    """

    def __init__(
        self,
        craft: Spacecraft,
        task: Any,
        period: float,
        position_tolerance: float | None = None,
    ) -> None:
        self.craft = craft
        self.period = period
        self._finest = position_tolerance or task.position_tolerance
        self._finer = task.position_tolerance / self._finest
        self._body = Body.of(craft)
        bounds = (task.position_tolerance, task.attitude_tolerance, REST_SPEED, REST_SPIN)
        self._bounds = [_INSIDE * bound for bound in bounds]
        # Authority: the force in the weakest direction, and the torque to the weaker side.
        effects = torch.tensor(craft.wrench_map, dtype=torch.float64)
        angle = torch.arange(32, dtype=torch.float64) * (math.pi / 16)
        along = torch.stack((angle.cos(), angle.sin()), dim=1) @ effects[:, :2].T
        torque = effects[:, 2]
        self.force = float(along.clamp(min=0.0).sum(dim=1).min())
        self.acceleration = self.force / craft.mass
        inertia = craft.inertia[2][2]
        twist = min(float(torque.clamp(min=0.0).sum()), float((-torque).clamp(min=0.0).sum()))
        self.angular_acceleration = twist / inertia
        self.range = 0.5 * (task.spawn_distance[0] + task.spawn_distance[1])
        self.scale = math.sqrt(self.range / self.acceleration)
        """Time in which the craft gains its range, s."""
        # Change of spin by the weakest torque in a period, and so the distance of headings at rest.
        arms = torque.abs()
        self.spin_step = float(arms[arms > 1e-9].min()) * period / inertia
        self.thrust = [thruster.force / self.force for thruster in craft.thrusters]
        views = symmetries(craft)
        own = (torch.eye(2)[None], torch.ones(1), torch.arange(craft.thruster_count)[None])
        sides = own if views is None else views.tensors_like(torch.zeros(1))
        self.turn, self.hand, self.place = sides
        # Several patterns of the same effect would be labels that no independent valves can imitate.
        shared = craft.thrust_sharing == "split"
        self.patterns = torch.as_tensor(subsets(craft.wrench_map, shared, 0.0).opened).float()
        """Patterns (C, n) of open valves whose effects differ, of equal ones that of least impulse."""

    def price(self, state: Tensor) -> Tensor:
        """Price of the full thrust, seconds a second."""
        low, high = _PRICE
        return low * torch.exp(math.log(high / low) * state[6])

    def moved(self, state: Tensor, command: Sequence[Tensor]) -> Tensor:
        """States after a control period with these commands of the thrusters."""
        x, y, heading, vx, vy, spin, trade_off = state
        planar = PlanarState(Vec2(x, y), Heading(heading), Vec2(vx, vy), spin)
        for duration, wrench, _, _ in undelayed(self.craft, self._body, command, self.period):
            planar = advance(planar, wrench, self._body, duration, nodes=_NODES)
        angle = _wrapped(planar.attitude.angle)
        rows = (planar.p.x, planar.p.y, angle, planar.v.x, planar.v.y, planar.w, trade_off)
        return torch.stack(torch.broadcast_tensors(*rows))

    def burnt(self, command: Sequence[Tensor]) -> Tensor:
        """Impulse of a control period as a time of full thrust, s."""
        mean = mean_thrust(self.craft, command)
        weighted = [x * y for x, y in zip(mean, self.thrust, strict=True)]
        return self.period * torch.stack(weighted).sum(dim=0)

    def seen(self, state: Tensor) -> Tensor:
        """States as costs and values are of them: within a finer tolerance places are larger by as much."""
        if self._finer == 1.0:
            return state
        distance = torch.sqrt(state[:2].square().sum(dim=0) + 1e-12)
        larger = 1.0 + (self._finer - 1.0) * (self._finest / distance).clamp(max=1.0)
        return torch.cat((state[:2] * larger, state[2:]))

    def inside(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Whether states are within the tolerances, whether they are also at rest, and their error, 0 to 1."""
        x, y, heading, vx, vy, spin, _ = self.seen(state)
        distance, angle, speed, rate = self._bounds
        place = (x * x + y * y) / distance**2
        turn = heading.square() / angle**2
        within = (place <= 1.0) & (turn <= 1.0)
        at_rest = (vx * vx + vy * vy <= speed**2) & (spin.abs() <= rate)
        return within, within & at_rest, (0.5 * (place + turn)).sqrt()

    def waiting(self, state: Tensor) -> Tensor:
        """Cost of a control period by its state, s: of time outside, and of errors inside.

        Those rise with the price of thrust, or a craft that saves thrust would drift over the border and back; but
        at the border they cost less than to be outside.
        """
        within, is_in, error = self.inside(state)
        held = _ERROR * error * (1.0 + self.price(state).clamp(max=_HOLD_PRICE[1]))
        outside = torch.where(within, _RESTLESS, 1.0)
        return self.period * torch.where(is_in, held, outside)

    def thrust_price(self, state: Tensor) -> Tensor:
        """Price of the full thrust where holding the pose has a price of its own, seconds a second."""
        price = self.price(state)
        return torch.where(self.inside(state)[1], price.clamp(*_HOLD_PRICE), price)

    def discount(self, state: Tensor) -> Tensor:
        """Discount of a control period."""
        approach, hold = (math.exp(-self.period / x) for x in (_APPROACH, _HOLD))
        return torch.where(self.inside(state)[1], hold, approach)

    def quickest(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Least times to the origin of each axis alone, s, as of a double integrator."""
        x, y, heading, vx, vy, spin, _ = state
        return (
            _to_rest(x, vx, self.acceleration),
            _to_rest(y, vy, self.acceleration),
            _to_rest(heading, spin, self.angular_acceleration),
        )

    def guess(self, state: Tensor) -> Tensor:
        """Value function to begin with: times of double integrators, one after the other rather than at once.

        They are rather too long, as are the times of thrust, so that the first flights look for nothing better.
        """
        x, y, heading = self.quickest(state)
        longest = torch.sqrt(x * x + y * y) + 0.5 * heading
        return longest * (1.0 + 0.5 * self.price(state)) + self.waiting(state)

    def features(self, state: Tensor) -> Tensor:
        """Inputs of the value function, (..., features)."""
        state = self.seen(state)
        x, y, heading, vx, vy, spin, trade_off = state
        cos, sin = heading.cos(), heading.sin()
        speed = math.sqrt(self.acceleration * self.range)
        rate = math.sqrt(self.angular_acceleration)
        # In the frame of the goal and in that of the body, in units of the craft's authority.
        place = [x / self.range, y / self.range]
        motion = [vx / speed, vy / speed]
        columns = [*place, *motion]
        for first, second in (place, motion):
            columns += [cos * first + sin * second, cos * second - sin * first]
        columns += [cos, sin, (2 * heading).cos(), (2 * heading).sin(), heading, spin / rate]
        # Distances, speeds along and across, and least times.
        distance = torch.sqrt(x * x + y * y + 1e-6)
        columns += [
            distance / self.range,
            torch.sqrt(distance / self.range),
            (x * vx + y * vy) / distance / speed,
            (x * vy - y * vx) / distance / speed,
        ]
        columns += [time / self.scale for time in self.quickest(state)]
        # Close to the goal.
        widths = [bound / _INSIDE for bound in self._bounds]
        errors = [state[i] / widths[kind] for i, kind in enumerate((0, 0, 1, 2, 2, 3))]
        for scale in _SCALES:
            columns += [torch.tanh(scale * error) for error in errors]
        columns.append(torch.tanh(distance / widths[0] - 1.0))
        # Where between the spins and headings that pulses can reach.
        turn = 2 * math.pi / self.spin_step
        columns += [(turn * spin).sin(), (turn * spin).cos()]
        if self.spin_step * self.period > _COARSE:
            phase = (turn / self.period) * (heading - 0.5 * self.period * spin)
            columns += [phase.sin(), phase.cos()]
        # The trade-off.
        columns += [trade_off, trade_off.square(), (5.0 * trade_off).tanh()]
        return torch.stack(torch.broadcast_tensors(*columns), dim=-1)

    def near(self, uniform: Tensor, state: Tensor) -> Tensor:
        """States around the goal at random scales in place of states (7, N), from numbers (8, N) in [0, 1).

        Spins are those of a craft that began at rest for all but a tenth.
        """
        scale = torch.exp(math.log(0.02) * uniform[7])
        spread = 2.0 * uniform[:6] - 1.0
        spin = spread[5] * scale * 2.0 * math.sqrt(self.angular_acceleration)
        reached = torch.round(spin / self.spin_step) * self.spin_step
        speed = math.sqrt(self.acceleration * self.range)
        rows = (
            spread[0] * scale * 1.5,
            spread[1] * scale * 1.5,
            spread[2] * scale.sqrt() * math.pi,
            spread[3] * scale * speed,
            spread[4] * scale * speed,
            torch.where(uniform[6] < 0.9, reached, spin),
            state[6],
        )
        return torch.stack(rows)


def _wrapped(angle: Tensor) -> Tensor:
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi


def _to_rest(offset: Tensor, rate: Tensor, acceleration: float) -> Tensor:
    """Least time in which a double integrator comes to rest at the origin, s."""
    side = torch.where(offset + rate * rate.abs() / (2 * acceleration) >= 0.0, 1.0, -1.0)
    inner = 0.5 * rate.square() + acceleration * side * offset
    return (side * rate + 2.0 * inner.clamp(min=0.0).sqrt()) / acceleration
