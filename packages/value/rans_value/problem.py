"""Flights to a pose as a problem of optimal control: motion, costs, and inputs of a value function.

A flight costs the time outside the goal set and the price of its impulse; one that is lost, because it failed or
broke a limit, costs as much as a whole flight that does not arrive. States are those of `rans_value.goal_frame`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any, ClassVar

import torch
from torch import Tensor
from torch.nn import functional

from rans.extend import (
    REST_SPEED,
    REST_SPIN,
    Heading,
    Quat,
    Spacecraft,
    Timing,
    Vec2,
    Vec3,
    aims,
    subsets,
)
from rans.model.dynamics import mean_thrust
from rans.policy.symmetry import symmetries
from rans_value.goal_frame import GoalFrame, parted

_ENUMERATED = 2**16
"""Largest number of patterns of open valves: all of 16 thrusters, of more those with fewest open. The free flyer's
have 4,225 different effects."""
_INSIDE = 0.99
"""Tolerances of the costs, of those of the task, so that rounding leaves no flight outside."""
_RESTLESS = 0.8
"""Part of the cost of a second that is due until the craft is at rest in the goal set. The other part is due until
the pose is within the tolerances: a spin between two of those that pulses can reach may allow no rest."""
_PRICE = (0.02, 4.0)
"""Price of the full thrust at a trade-off of 0 and of 1, seconds outside the goal set a second. The second is lower
for weak craft, see `_LONGEST`."""
_LONGEST = 0.72
"""Part of a flight that the thriftiest transfers take at most, so that those from far away arrive too."""
TRADE_OFF = 0.2
"""Trade-off where goals note none."""
_APPROACH = 200.0
_HOLD = 6.0
"""Time constants of the discount outside and inside the goal set, s. Flights are far shorter than the first; the
second is long enough to hold, and short enough that holding does not delay arrival."""
_ERROR = 0.3
"""Cost of a second at the borders of position and heading, s: the pose is held well within them, and errors of the
value function, or of a policy that imitates its commands, leave no flight outside. It is linear in the error:
by its square, 0.2 at the borders, 3 instead of 59 % of flights stay within 2 cm."""
_AIMED = math.radians(5.0)
"""Error of attitude at which inputs are steep where none is asked for."""
_MARGINS = 0.05
"""Margin of a limit at which inputs are steep, of the range."""
_SCALES = (1.0, 0.2)
"""Tolerances at which inputs of the value function are steepest, of the errors and their rates, over those of the
goal set."""
_COARSE = 0.02
"""Least distance between headings at rest, rad, at which the value function is given where they lie."""


class PoseProblem:
    """Least cost of flights of a craft to a pose.

    Args:
        craft: craft with thrusters and, in the plane, wheels.
        task: flight whose errors, limits and ends depend on the state relative to the goal.
        timing: control period, checks and length of a flight.
        position_tolerance: tolerance in flight, m, that of the task or finer; None: that of the task.

    Raises:
        ConfigError: the task is of another kind, see `rans_value.goal_frame.GoalFrame`.
    """

    hold_price: ClassVar[tuple[float, float]] = (0.4, 0.7)
    """Least and largest price of the full thrust inside the goal set, s/s: a quick flight gains nothing by thrust
    there, and a thrifty one shall not stay outside because holding is dear. At 0.2 errors of the value function
    open valves all the time, at 0.7 some quick flights leave (docs/decisions/value.md)."""

    def __init__(
        self,
        craft: Spacecraft,
        task: Any,
        timing: Timing,
        position_tolerance: float | None = None,
    ) -> None:
        self.craft = craft
        self.frame = GoalFrame(craft, task, timing)
        self.period = timing.control_period
        self._flight = timing.episode_steps * self.period
        tolerances = self.frame.tolerances
        self._finest = position_tolerance or tolerances["position"]
        self._finer = tolerances["position"] / self._finest
        self.dimension = craft.dimension
        usual = {"attitude": _AIMED, "velocity": REST_SPEED, "spin": REST_SPIN}
        self._widths = [(usual | tolerances)[name] for name in ("position", *usual)]
        self._resting = aims(task) - tolerances.keys()
        # Authority: force and torque in the weakest direction.
        columns = torch.tensor(craft.wrenches_either_way.T)
        forces, torques = columns.tensor_split((craft.dimension,), 1)
        self.force = _weakest(forces)
        self.acceleration = self.force / craft.mass
        moments = torch.tensor(craft.inertia, dtype=torch.float64).diagonal()[-torques.shape[1] :]
        self.angular_acceleration = _weakest(torques / moments)
        self.range = 0.5 * (task.spawn_distance[0] + task.spawn_distance[1])
        self.scale = math.sqrt(self.range / self.acceleration)
        """Time in which the craft gains its range, s."""
        # A double integrator that burns, coasts and brakes by two thrusters at the price q takes the least cost in
        # 1.05 (r + 1/r) of this time, where r^2 = 1 + 4 q; 1.05 is that of flights of nine craft.
        longest = max(_LONGEST * self._flight / (1.05 * self.scale), 2.1)
        root = 0.5 * (longest + math.sqrt(longest**2 - 4.0))
        self._price = (_PRICE[0], min(_PRICE[1], 0.25 * (root**2 - 1.0)))
        # Changes of spin by each thruster in a period, and so the distances of headings at rest.
        kicks = torques * self.period / moments
        steps = kicks.abs().where(kicks.abs() > 1e-9, math.inf).amin(dim=0)
        self.spin_steps = [float(step) for step in steps]
        self._is_coarse = craft.dimension == 2 and self.spin_steps[0] * self.period > _COARSE
        self.phases = craft.wheel_count or 2 * (len(steps) + self._is_coarse)
        """Inputs of the value function, before the last three: sines and cosines between such spins, or momenta of
        wheels, which stop any."""
        self._kicks = kicks.float()
        self.rows = (7 if craft.dimension == 2 else 14) + self.frame.turns + craft.wheel_count
        limits = self.frame.margins(torch.zeros(self.rows))
        self.limits = 4 * len(limits) + 2 * self.frame.turns
        """Inputs of the value function, before the phases, of limits and of goals that turn."""
        self.numbers = 2 + 2 * craft.dimension + len(steps) + len(forces)
        """Random numbers of a state near the goal."""
        self._thrust = [thruster.force / self.force for thruster in craft.thrusters]
        # In the plane wheels turn the craft alike on all sides.
        views = symmetries(replace(craft, wheels=()))
        valves = torch.arange(craft.thruster_count)[None]
        own = torch.eye(self.dimension)[None], torch.ones(1), valves
        sides = own if views is None else views.tensors_like(torch.zeros(1))
        kept = [self.frame.is_symmetric(*side) for side in zip(*sides[:2], strict=True)]
        self.turn, self.hand, place = (x[torch.tensor(kept)] for x in sides)
        wheels = torch.arange(craft.thruster_count, craft.command_count)
        self.place = torch.cat((place, wheels.expand(len(place), -1)), dim=1)
        # Several patterns of the same effect would be labels that no independent valves can imitate.
        shared = craft.thrust_sharing == "split"
        different = subsets(craft.wrench_map, shared, 0.0, _ENUMERATED)
        opened = torch.as_tensor(different.opened).float()
        self.patterns = functional.pad(opened, (0, craft.wheel_count))
        """Patterns (C, n) of open valves whose effects differ, of equal ones that of least impulse; wheels rest."""

    def with_parameters(self, state: Tensor) -> Tensor:
        """States (rows, N) with what differs from flight to flight, here nothing, see `VariedProblem`."""
        return state

    def price(self, state: Tensor) -> Tensor:
        """Price of the full thrust, seconds a second."""
        low, high = self._price
        return low * torch.exp(math.log(high / low) * state[-1])

    def step(self, state: Tensor, command: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """States (rows, ...) after a control period with commands (..., n), its cost, s, and its discount.

        Nothing follows the end of a flight.
        """
        after, won, lost = self.after(state, command)
        waiting, price, discount = self.terms(state)
        thrust = self.mean_thrust(command)
        weighted = [x * y for x, y in zip(thrust, self._thrust, strict=True)]
        burnt = self.period * torch.stack(weighted).sum(dim=0)
        failure = self._flight * (1.0 + self.price(state))
        return (
            after,
            waiting + price * burnt + torch.where(lost, failure, 0.0),
            torch.where(won | lost, 0.0, discount),
        )

    def after(self, state: Tensor, command: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """States (rows, ...) after a control period, and whether that won or lost the flight."""
        return self.frame.step(state, command.unbind(dim=-1))

    def mean_thrust(self, command: Tensor) -> Tensor:
        """Shares (n, ...) of their forces that thrusters give in the mean of a period, by commands (..., n)."""
        return torch.stack(mean_thrust(self.craft, command.unbind(dim=-1)))

    def seen(self, state: Tensor) -> Tensor:
        """States as costs and values are of them: within a finer tolerance places are larger by as much."""
        place = state[: self.dimension]
        distance = torch.sqrt(place.square().sum(dim=0) + 1e-12)
        larger = 1.0 + (self._finer - 1.0) * (self._finest / distance).clamp(max=1.0)
        return torch.cat((place * larger, state[self.dimension :]))

    def offsets(self, state: Tensor) -> tuple[Tensor, ...]:
        """Rows of position, rotation vector, velocity and spin."""
        p, attitude, v, w, _ = parted(state)
        if self.dimension == 3:
            axis = attitude[1:] * torch.where(attitude[:1] < 0.0, -1.0, 1.0)
            sine = (axis.square().sum(dim=0) + 1e-12).sqrt()
            attitude = axis * (2.0 * torch.atan2(sine, attitude[0].abs()) / sine)
        return p, attitude, v, w

    def inside(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Whether states are within the tolerances, whether they are also at rest, and their error, 0 to 1."""
        errors = torch.stack(self.frame.errors(self.seen(state))) / _INSIDE
        within = (errors <= 1.0).all(dim=0)
        _, _, v, w, _ = parted(state)
        is_in = within
        for name, rows, width in zip(("velocity", "spin"), (v, w), self._widths[2:], strict=True):
            if name in self._resting:
                is_in = is_in & (rows.square().sum(dim=0) <= (_INSIDE * width) ** 2)
        return within, is_in, errors.square().mean(dim=0).sqrt()

    def terms(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Cost of a control period by its state, s, its price of the full thrust, s/s, and its discount.

        The cost is of time outside, and of errors inside. Those rise with the price of thrust, or a craft that
        saves thrust would drift over the border and back; but at the border they cost less than to be outside.
        Holding the pose has a price and a discount of its own.
        """
        within, is_in, error = self.inside(state)
        price = self.price(state)
        held = _ERROR * error * (1.0 + price.clamp(max=self.hold_price[1]))
        outside = torch.where(within, _RESTLESS, 1.0)
        approach, hold = (math.exp(-self.period / x) for x in (_APPROACH, _HOLD))
        return (
            self.period * torch.where(is_in, held, outside),
            torch.where(is_in, price.clamp(*self.hold_price), price),
            torch.where(is_in, hold, approach),
        )

    def quickest(self, state: Tensor) -> tuple[Tensor, Tensor]:
        """Least times to the origin of each axis alone, s, as of a double integrator: of place and of attitude."""
        p, turn, v, w = self.offsets(state)
        return _to_rest(p, v, self.acceleration), _to_rest(turn, w, self.angular_acceleration)

    def guess(self, state: Tensor) -> Tensor:
        """Value function to begin with: times of double integrators, one after the other rather than at once.

        They are rather too long, as are the times of thrust, so that the first flights look for nothing better.
        """
        place, turn = (x.square().sum(dim=0).sqrt() for x in self.quickest(state))
        return (place + 0.5 * turn) * (1.0 + 0.5 * self.price(state)) + self.terms(state)[0]

    def features(self, state: Tensor) -> Tensor:
        """Inputs of the value function, (..., features)."""
        state = self.seen(state)
        _, attitude, _, _, rest = parted(state)
        offsets = self.offsets(state)
        p, turn, v, w = offsets
        speed = math.sqrt(self.acceleration * self.range)
        # In the frame of the goal and in that of the body, in units of the craft's authority.
        place = p / self.range
        motion = v / speed
        columns = [*place, *motion]
        facing: Any = Heading(*attitude) if self.dimension == 2 else Quat(*attitude)
        vector: Any = Vec2 if self.dimension == 2 else Vec3
        for rows in (place, motion):
            columns += facing.inverse().rotate(vector(*rows)).columns()
        columns += facing.columns()
        if self.dimension == 2:
            columns += Heading(2.0 * attitude[0]).columns()
        else:
            columns += facing.rotate(Vec3(0.0, 0.0, 1.0)).columns()
        columns += [*turn, *(w / math.sqrt(self.angular_acceleration))]
        # Distances, speeds along and across, and least times.
        distance = torch.sqrt(p.square().sum(dim=0) + 1e-6)
        along = (p * v).sum(dim=0) / distance
        if self.dimension == 2:
            across = (p[0] * v[1] - p[1] * v[0]) / distance
        else:
            across = (v.square().sum(dim=0) - along.square()).clamp(min=1e-6).sqrt()
        columns += [
            distance / self.range,
            torch.sqrt(distance / self.range),
            along / speed,
            across / speed,
        ]
        columns += [time / self.scale for times in self.quickest(state) for time in times]
        # Close to the goal.
        widths = self._widths
        errors = torch.cat([x / width for x, width in zip(offsets, widths, strict=True)])
        for scale in _SCALES:
            columns += [*torch.tanh(scale * errors)]
        columns.append(torch.tanh(distance / widths[0] - 1.0))
        if self.dimension == 3:
            angle = (turn.square().sum(dim=0) + 1e-6).sqrt()
            columns += [angle, torch.tanh(angle / widths[1] - 1.0)]
        # Limits here, and where the craft can come to rest.
        braked = p + v * v.square().sum(dim=0).sqrt() / (2.0 * self.acceleration)
        at_rest = torch.cat((braked, state[self.dimension :]))
        for margin in (*self.frame.margins(state), *self.frame.margins(at_rest)):
            columns += [margin / self.range, torch.tanh(margin / (_MARGINS * self.range))]
        # How full wheels are, or where between the spins and headings that pulses can reach.
        if self.frame.turns:
            w = w + rest[:1]
            columns += [rest[0] / self.spin_steps[0], *(w / self.spin_steps[0])]
        lattice = [*zip(w, self.spin_steps, strict=True)]
        if self._is_coarse:
            between = self.spin_steps[0] * self.period
            lattice.append((attitude[0] - 0.5 * self.period * w[0], between))
        wheels = self.craft.wheels
        momenta = zip(rest[self.frame.turns :], wheels, strict=False)
        columns += [momentum / wheel.max_momentum for momentum, wheel in momenta]
        for place, step in () if wheels else lattice:
            phase = (2 * math.pi / step) * place
            columns += [phase.sin(), phase.cos()]
        # The trade-off.
        trade_off = rest[-1]
        columns += [trade_off, trade_off.square(), (5.0 * trade_off).tanh()]
        return torch.stack(torch.broadcast_tensors(*columns), dim=-1)

    def near(self, uniform: Tensor, state: Tensor) -> Tensor:
        """States around the goal at random scales in place of states (rows, N), from numbers in [0, 1).

        The numbers are (`numbers`, N). Spins are sums of whole pulses, those of a craft that began at rest, for all
        but a tenth: without wheels others allow no rest. States in which the flight is over stay those that were
        given.
        """
        rest = parted(state)[-1]
        kicks = self._kicks.to(uniform.device)
        count, axes = kicks.shape
        spread = 2.0 * uniform[2:] - 1.0
        p, turn, v, pulses = spread.split((self.dimension, axes, self.dimension, count))
        scale = torch.exp(math.log(0.02) * uniform[0])
        turn = turn * scale.sqrt() * math.pi
        most = 2.0 * math.sqrt(self.angular_acceleration * axes) / kicks.norm()
        pulses = most * scale * pulses
        w = kicks.T @ torch.where(
            uniform[1] < (0.0 if self.craft.wheels else 0.9), pulses.round(), pulses
        )
        if self.frame.turns:
            w = w - rest[:1]
        if self.dimension == 3:
            half = 0.5 * turn.square().sum(dim=0, keepdim=True).sqrt()
            turn = torch.cat((half.cos(), 0.5 * turn * (half / math.pi).sinc()))
        v = v * scale * math.sqrt(self.acceleration * self.range)
        near = torch.cat((p * scale * 1.5, turn, v, w, rest))
        return torch.where(self.frame.is_over(near), state, near)


def _weakest(columns: Tensor) -> float:
    """Sum of the columns (n, d), each from 0 to 1, in the direction that has least, along or between axes."""
    ways = [x for x in itertools.product((-1.0, 0.0, 1.0), repeat=columns.shape[1]) if any(x)]
    units = functional.normalize(torch.tensor(ways, dtype=columns.dtype), dim=1)
    return float((units @ columns.T).clamp(min=0.0).sum(dim=1).min())


def _to_rest(offset: Tensor, rate: Tensor, acceleration: float) -> Tensor:
    """Least time in which a double integrator comes to rest at the origin, s."""
    side = torch.where(offset + rate * rate.abs() / (2 * acceleration) >= 0.0, 1.0, -1.0)
    inner = 0.5 * rate.square() + acceleration * side * offset
    return (side * rate + 2.0 * inner.clamp(min=0.0).sqrt()) / acceleration
