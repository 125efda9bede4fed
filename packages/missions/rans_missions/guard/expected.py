"""Errors that a safety filter expects under conditions: reserves of constraints, and delay of commands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from rans import Conditions, scenarios
from rans.extend import Setup, bounds
from rans_missions.guard.manoeuvres import on_both_sides

_RARE = 0.05
"""Chance that a reading of an episode is too optimistic by more than the reserve. A craft comes nearer then, but
seldom violates a constraint: that takes several such readings. Smaller chances cost reach: for a thousandth of all
episodes the reserve for noise of 0.1 m is 0.44 m, and goals of avoid are 0.4 m from zones."""
PERIODS = 20
"""Largest number of control periods of a manoeuvre by default."""
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

        The reserve of a constraint is what its margin changes by over z standard deviations of the noise of
        position and velocity. Of a normal
        distribution one reading in all of twenty episodes is off by more than z of them to one side: 3.4 in 150
        control periods. Nothing is guaranteed beyond. An error of the velocity also moves the positions that are
        predicted until the craft has stopped: it counts over one control period and the time in which the weakest
        thruster stops twice the mean speed of an episode from the farthest start to its goal, but at most over a
        manoeuvre. Where delays vary, the mean one is expected,
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
        deviations = NormalDist().inv_cdf(1.0 - _RARE / setup.timing.episode_steps)
        velocity, position = (
            deviations * max(bounds(sensor.noise)[1] for sensor in sensors)
            for sensors in zip(
                *((part.sensors.velocity, part.sensors.position) for part in parts), strict=True
            )
        )
        speed = float(np.max((starts.start.v - starts.goal.v).norm()))
        weakest = min(thruster.force for thruster in setup.craft.thrusters) / setup.craft.mass
        way = float(np.max((starts.start.p - starts.goal.p).norm()))
        usual = 2.0 * way / (setup.timing.episode_steps * period)
        braking = min(usual / weakest, PERIODS * period) + period
        position = float(np.hypot(position, velocity * braking))
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
    """Largest gradient (1 per m, or s/m) of each constraint over position ("p") or velocity ("v") at the starts.

    Reserves are errors times these, so that a gradient that is larger elsewhere is not covered.
    """
    squares: dict[str, Any] = {}

    def margins(vector: Any) -> dict[str, Any]:
        return setup.task.constraints(replace(starts.start, **{of: vector}), starts.goal)

    for ahead, back in on_both_sides(getattr(starts.start, of), _STEP, margins):
        for name in ahead:
            slope = (np.asarray(ahead[name]) - np.asarray(back[name])) / (2.0 * _STEP)
            squares[name] = squares.get(name, 0.0) + slope**2
    return {name: float(np.sqrt(np.max(x))) for name, x in squares.items()}
