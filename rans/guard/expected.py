"""Errors that a safety filter expects under conditions: reserves of constraints, and delay of commands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.episode import Setup
from rans.randomization.conditions import Conditions, bounds
from rans.scenario import scenarios

_DOUBT = 3.0
"""Standard deviations of the noise that a reserve covers."""
_STARTS = 64
"""Starts at which the slopes of the constraints are measured."""
_STEP = 1e-3
"""Step of the difference quotients, m and m/s."""

Reserve = tuple[tuple[str, float], ...]
"""Margins that are held in reserve, in the unit of each constraint, by its name."""


@dataclass(frozen=True)
class Expected:
    """Errors that a filter expects."""

    reserve: Reserve = ()
    delay: float = 0.0
    """Time from a reading until the command that is decided by it acts, s."""

    @classmethod
    def of(cls, setup: Setup) -> Expected:
        """Errors under a setup's conditions.

        The reserve of a constraint is what its margin changes by over three standard deviations of the noise of
        position and velocity, the latter also over a control period; noise that grows with range is that of the
        farthest of 64 starts. Where delays vary, the mean one is expected,
        and the way in half of their range at the largest speed of a start is added. Of a mixture the delays of all
        parts are one range, and the noise is that of the part with most of it.
        """
        conditions = setup.conditions
        if conditions is None:
            return cls()
        period = setup.timing.control_period
        parts = (conditions, *conditions.others)
        delays = [_delays(part, period) for part in parts]
        soonest = min(least for least, _ in delays)
        latest = max(greatest for _, greatest in delays)
        starts = scenarios(setup.task, setup.craft, seed=0, count=_STARTS)
        # Noise that grows with range is largest at a start.
        distance = float(np.max(starts.start.p.norm()))
        velocity = _DOUBT * max(part.sensors.velocity.largest_deviation(distance) for part in parts)
        position = _DOUBT * max(part.sensors.position.largest_deviation(distance) for part in parts)
        position = float(np.hypot(position, velocity * period))
        speed = float(np.max((starts.start.v - starts.goal.v).norm()))
        position += 0.5 * (latest - soonest) * speed
        if not (position or velocity):
            return cls((), 0.5 * (soonest + latest))
        by_position = _slopes(setup, starts, "p")
        by_velocity = _slopes(setup, starts, "v")
        reserve = tuple(
            (name, by_position[name] * position + by_velocity[name] * velocity)
            for name in by_position
        )
        return cls(reserve, 0.5 * (soonest + latest))


def _delays(conditions: Conditions, period: float) -> tuple[float, float]:
    """Least and largest time from a reading until its command acts, s."""
    parts = (
        bounds(conditions.thrusters.latency),
        bounds(conditions.thrusters.command_delay),
        tuple(period * round(x) for x in bounds(conditions.sensors.delay)),
    )
    return sum(least for least, _ in parts), sum(greatest for _, greatest in parts)


def _slopes(setup: Setup, starts: Any, of: str) -> dict[str, float]:
    """Largest gradient of each constraint over position ("p") or velocity ("v") at the starts."""
    vector = getattr(starts.start, of)
    columns = vector.columns()
    squares: dict[str, Any] = {}
    for axis in range(len(columns)):
        ends = []
        for step in (_STEP, -_STEP):
            shifted = [x + step if k == axis else x for k, x in enumerate(columns)]
            state = replace(starts.start, **{of: type(vector)(*shifted)})
            ends.append(setup.task.constraints(state, starts.goal))
        for name in ends[0]:
            slope = (np.asarray(ends[0][name]) - np.asarray(ends[1][name])) / (2.0 * _STEP)
            squares[name] = squares.get(name, 0.0) + slope**2
    return {name: float(np.sqrt(np.max(x))) for name, x in squares.items()}
