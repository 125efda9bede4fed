"""Flights in the plane of a craft that is not as designed, as a problem of optimal control with its parameters.

A state has what differs from flight to flight between motion and trade-off, so that values are functions of it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rans import Conditions
from rans.extend import Spacecraft, StepInputs, Timing, Vec2, Wrench, wrap
from rans.randomization.parameters import examples
from rans_value.problem import PoseProblem


class VariedProblem(PoseProblem):
    """Least cost of flights to a pose in the plane of craft under conditions.

    States are (7 + m, ...): position, heading, velocity and spin in the frame of the goal, m parameters, and the
    trade-off. Parameters are accelerations (m/s^2, m/s^2, rad/s^2), along x, along y and about z, in B by each
    thruster and by what leaks, in the frame of the goal by disturbances; then the delay of commands, s, on which
    values do not depend.

    Args: see `PoseProblem`.
    """

    def __init__(
        self,
        craft: Spacecraft,
        task: Any,
        timing: Timing,
        position_tolerance: float | None = None,
    ) -> None:
        super().__init__(craft, task, timing, position_tolerance)
        self.design = drawn_parameters(Conditions(), craft, timing)[0][:, :1].float()
        self.rows += len(self.design)

    def with_parameters(self, state: Tensor) -> Tensor:
        """States (rows, N) with the parameters of the design."""
        parameters = self.design.to(state).expand(-1, state.shape[1])
        return torch.cat((state[:6], parameters, state[-1:]))

    def after(self, state: Tensor, command: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As `PoseProblem.after`, of a flight that no success ends."""
        after = self.moved(state, self.mean_thrust(command), self.period)
        after = torch.cat((after[:2], wrap(after[2:3]), after[3:]))
        lost = self.frame.is_over(after)
        return after, torch.zeros_like(lost), lost

    def moved(self, state: Tensor, thrust: Tensor, time: Any) -> Tensor:
        """States or estimates after a time (s) with shares (n, ...) of the thrusters' forces."""
        x, y, heading, vx, vy, spin = state[:6]
        count = len(thrust)
        effects = state[6 : 12 + 3 * count].unflatten(0, (count + 2, 3))
        push_x, push_y, push = effects[-1]
        along, across, turning = (effects[:count] * thrust[:, None]).sum(dim=0) + effects[count]
        turning = turning + push

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


def drawn_parameters(conditions: Conditions, craft: Spacecraft, timing: Timing) -> list[Tensor]:
    """Parameters (m, N) of what episodes of the conditions draw (`examples`), at the start and after faults."""
    drawn = examples(conditions, craft, timing.episode_steps)
    zero = 0.0 * drawn.number
    late = zero
    if drawn.lag is not None:
        # A thrust that rises linearly acts as one that begins in the middle.
        late = zero + drawn.lag.latency + 0.5 * (zero if drawn.lag.rise is None else drawn.lag.rise)
    commands = np.eye(craft.thruster_count + 1)[:, 1:].tolist()
    period = timing.control_period

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
            accelerations(next(StepInputs(body, (tuple(command),)).pieces(craft, period))[1])
            for command in commands
        )
        rows = (*(x - shut for x in open_alone), shut, pushed, late)
        result.append(torch.from_numpy(np.vstack(rows)))
    return result
