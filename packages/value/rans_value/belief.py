"""What a craft under conditions does, as is estimated in flight: its motion, thrusters, disturbances and delay.

An extended Kalman filter begins with the mean and covariance of what the conditions draw (R. Kalman, "A new
approach to linear filtering and prediction problems", 1960). Commands are chosen for where the craft will be once
they act, after those in flight (O. Smith, "A controller to overcome dead time", 1959), by the effects estimated.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from rans import Conditions
from rans.extend import Timing, wrap
from rans.randomization.parameters import examples
from rans_value.varied import VariedProblem, drawn_parameters

_FLOOR = 3e-4
"""Standard deviation of readings and of a period's motion beside the conditions', m, rad, m/s and rad/s."""
_ANYWHERE = 1e3
"""Variance of a state before its first reading, SI."""
_OFTEN = 3
"""How often each craft is drawn where there are no others, of 2,048: half before anything fails."""
_EXACT = 1e-6
"""Variance at which a parameter is that of a craft, SI."""
_STEP = 1e-6
"""Difference of estimates for slopes, SI."""


class Belief:
    """Estimates of N flights in the plane to goals that rest.

    Estimates are (6 + m, N), states of the problem without the trade-off.

    Args:
        problem: the flights.
        conditions: what may differ from the design.
        timing: control period and length of a flight.
    """

    def __init__(self, problem: VariedProblem, conditions: Conditions, timing: Timing) -> None:
        self.craft = problem.craft
        self._problem = problem
        drawn = examples(conditions, self.craft, timing.episode_steps)
        begun, ended = drawn_parameters(conditions, self.craft, timing)
        jump = ended - begun
        self._prior = begun.mean(dim=1)
        self._spread = torch.block_diag(_ANYWHERE * torch.eye(6).double(), begun.cov())
        # Thrusters may fail in any period.
        failing = jump @ jump.T / (jump.shape[1] * timing.episode_steps)
        self._drift = torch.block_diag(_FLOOR**2 * torch.eye(6).double(), failing)
        craft, number = torch.cat((begun, ended), dim=1).unique(dim=1, return_counts=True)
        self._few = craft if number.min() >= _OFTEN else None
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
        found = self._estimate
        if self._few is not None:
            # Thrusters that fail wholly leave few craft, and a mean of those is none.
            off = (self._few[:, None] - found[6:, :, None]).transpose(0, 1)
            spread = self._covariance[:, 6:, 6:] + _EXACT * torch.eye(len(self._few))
            nearest = (off * torch.linalg.solve(spread, off)).sum(dim=1).argmin(dim=1)
            found = torch.cat((found[:6], self._few[:, nearest]))
        return torch.cat((self._acting(found, self._thrust), trade_off))

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

    def _later(self, estimate: Tensor, before: Tensor, thrust: Tensor) -> Tensor:
        """Estimates at the next reading, after thrust that was commanded before and now, (n, ...)."""
        rest = self._problem.period - self._delay(estimate)
        return self._problem.moved(self._acting(estimate, before), thrust, rest)

    def _acting(self, estimate: Tensor, before: Tensor) -> Tensor:
        """Estimates when a command begins to act."""
        return self._problem.moved(estimate, before, self._delay(estimate))

    def _delay(self, estimate: Tensor) -> Tensor:
        return estimate[-1].clamp(0.0, self._problem.period)
