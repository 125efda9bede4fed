"""What a craft under conditions does, as is estimated in flight: its motion, thrusters, disturbances and delay.

An extended Kalman filter begins with the mean and covariance of what the conditions draw (R. Kalman, "A new
approach to linear filtering and prediction problems", 1960). Commands are chosen for where the craft will be once
they act, after those in flight (O. Smith, "A controller to overcome dead time", 1959), by the effects estimated.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans.extend import Conditions, Spacecraft, StepInputs, Vec2, Wrench, wrap
from rans.randomization.parameters import examples
from rans_value.problem import PoseProblem

_FLOOR = 3e-4
"""Standard deviation of readings and of a period's motion beside the conditions', m, rad, m/s and rad/s."""
_ANYWHERE = 1e3
"""Variance of a state before its first reading, SI."""
_STEP = 1e-6
"""Difference of estimates for slopes, SI."""


class Belief:
    """Estimates of N flights in the plane to goals that rest; problem and value function of a search by them.

    Estimates are (6 + m, N): position, heading, velocity and spin in the frame of the goal, then the parameters.
    These are accelerations, m/s^2 and rad/s^2: in B along x, along y and about z by each thruster, along x and y of
    B by what leaks, along x and y of the goal's frame and about z by disturbances; then the delay of commands, s.
    States of the search are (7 + m, ...), with the trade-off behind.

    Args:
        problem: the flights, with everything as designed.
        value: their value function.
        conditions: what may differ from that.
        steps: control periods of a flight.
    """

    def __init__(
        self, problem: PoseProblem, value: Any, conditions: Conditions, steps: int
    ) -> None:
        self.craft, self.patterns, self.mean = problem.craft, problem.patterns, value.mean
        self._problem, self._value = problem, value
        drawn = examples(conditions, self.craft, steps)
        begun, ended = drawn_parameters(drawn, self.craft, problem.period)
        jump = ended - begun
        self._prior = begun.mean(dim=1)
        self._spread = torch.block_diag(_ANYWHERE * torch.eye(6).double(), begun.cov())
        # Thrusters may fail in any period.
        failing = jump @ jump.T / (jump.shape[1] * steps)
        self._drift = torch.block_diag(_FLOOR**2 * torch.eye(6).double(), failing)
        noise = None if drawn.sensors is None else drawn.sensors.noise
        sigmas = [_FLOOR**2 + float(np.mean(np.square(x))) for x in noise or [0.0] * 4]
        self._noise = torch.tensor(sigmas).double()[[0, 0, 1, 2, 2, 3]].diag()
        self.reset(0)

    def reset(self, count: int) -> None:
        """Begin ``count`` flights."""
        nothing = torch.zeros(6, count).double()
        self._estimate = torch.cat((nothing, self._prior[:, None].expand(-1, count)))
        self._covariance = self._spread.expand(count, -1, -1)
        self._thrust = torch.zeros(self.craft.thruster_count, count).double()

    def read(self, reading: Tensor) -> Tensor:
        """States of the search (7 + m, N) when the next command begins to act, after readings (7, N)."""
        seen, trade_off = reading[:6], reading[6:]
        gap = seen - self._estimate[:6]
        gap[2] = wrap(gap[2])
        prior = self._covariance[:, :6]
        gain = torch.linalg.solve(prior[:, :, :6] + self._noise, prior).mT
        self._estimate = self._estimate + (gain @ gap.T[:, :, None])[:, :, 0].T
        self._covariance = self._covariance - gain @ prior
        return torch.cat((self._acting(self._estimate, self._thrust), trade_off))

    def sent(self, command: Tensor) -> None:
        """Expect what commands (N, n) do until the next reading."""
        thrust = self._problem.mean_thrust(command.double())
        now = self._estimate
        self._estimate = self._later(now, self._thrust, thrust)
        # The motion is of second order in the estimates, so that its slopes are differences.
        moved = now[..., None] + _STEP * torch.eye(len(now)).double()[:, None]
        later = self._later(moved, self._thrust[..., None], thrust[..., None])
        slopes = ((later - self._estimate[..., None]) / _STEP).transpose(0, 1)
        self._covariance = slopes @ self._covariance @ slopes.mT + self._drift
        self._thrust = thrust

    def step(self, state: Tensor, command: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As `PoseProblem.step`, by the estimates, of a flight that does not end."""
        thrust = self._problem.mean_thrust(command)
        cost, discount = self._problem.cost(_designed(state), thrust)
        return self._moved(state, thrust, self._problem.period), cost, discount

    def __call__(self, state: Tensor) -> Tensor:
        """Values of states of the search, s: means of those at the next spins that pulses of the design can reach.

        Other spins come to rest by no pulses of the design, and the value function has hardly seen any.
        """
        designed = _designed(state)
        pulse = self._problem.spin_steps[0]
        pulses = designed[5] / pulse
        low = pulses.floor()
        below, above = (
            self._value(torch.cat((designed[:5], x[None] * pulse, designed[6:])))
            for x in (low, low + 1.0)
        )
        return torch.lerp(below, above, pulses - low)

    def _later(self, estimate: Tensor, before: Tensor, thrust: Tensor) -> Tensor:
        """Estimates at the next reading, after thrust that was commanded before and now, (n, ...)."""
        rest = self._problem.period - self._delay(estimate)
        return self._moved(self._acting(estimate, before), thrust, rest)

    def _acting(self, estimate: Tensor, before: Tensor) -> Tensor:
        """Estimates when a command begins to act."""
        return self._moved(estimate, before, self._delay(estimate))

    def _delay(self, estimate: Tensor) -> Tensor:
        return estimate[-1].clamp(0.0, self._problem.period)

    def _moved(self, state: Tensor, thrust: Tensor, time: Any) -> Tensor:
        """States or estimates after a time (s) with shares (n, ...) of the thrusters' forces."""
        x, y, heading, vx, vy, spin = state[:6]
        effects = state[6 : 6 + 3 * len(thrust)].unflatten(0, (len(thrust), 3))
        along, across, turning = (effects * thrust[:, None]).sum(dim=0)
        leak_x, leak_y, push_x, push_y, push_turn = state[6 + 3 * len(thrust) :][:5]
        along, across, turning = along + leak_x, across + leak_y, turning + push_turn

        def acceleration(at: Any) -> tuple[Tensor, Tensor]:
            angle = heading + spin * at + 0.5 * turning * at**2
            cosine, sine = angle.cos(), angle.sin()
            ahead = cosine * along - sine * across
            return ahead + push_x, sine * along + cosine * across + push_y

        # Thrust turns with the craft: the mean of a velocity is that of the middle, of a place that of a third.
        (ax, ay), (bx, by) = acceleration(time / 2.0), acceleration(time / 3.0)
        moved = (
            x + time * (vx + 0.5 * time * bx),
            y + time * (vy + 0.5 * time * by),
            heading + time * (spin + 0.5 * time * turning),
            vx + time * ax,
            vy + time * ay,
            spin + time * turning,
        )
        return torch.cat((torch.stack(moved), state[6:]))


def _designed(state: Tensor) -> Tensor:
    """States of the problem in those of the search."""
    return torch.cat((state[:2], wrap(state[2:3]), state[3:6], state[-1:]))


def drawn_parameters(drawn: Any, craft: Spacecraft, period: float) -> list[Tensor]:
    """Parameters (m, N) of estimates for what N episodes drew (`examples`), at the start and after faults."""
    zero = 0.0 * drawn.number
    late = zero
    if drawn.lag is not None:
        # A thrust that rises linearly acts as one that begins in the middle.
        late = zero + drawn.lag.latency + 0.5 * (zero if drawn.lag.rise is None else drawn.lag.rise)
    commands = [tuple(row) for row in np.eye(craft.thruster_count).tolist()]

    def accelerations(found: Wrench) -> np.ndarray:
        force = found.force.columns()
        body = drawn.body
        rows = (*(x / body.mass for x in force), found.torque / body.inertia[0])
        return np.stack([x + zero for x in rows])

    pushed = accelerations(drawn.disturbance(0.0, period) or Wrench(Vec2(0.0, 0.0), 0.0))
    result = []
    for time in (0.0, math.inf):
        body = drawn.body_at(time)
        shut, *open_alone = (
            accelerations(next(StepInputs(body, (command,)).pieces(craft, period))[1])
            for command in ((0.0,) * len(commands), *commands)
        )
        rows = (*(x - shut for x in open_alone), shut[:2], pushed[:2], shut[2] + pushed[2], late)
        result.append(torch.from_numpy(np.vstack(rows)))
    return result
