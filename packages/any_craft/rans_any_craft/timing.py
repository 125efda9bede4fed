"""How often a craft that flies to a pose is commanded, and how long its episodes are."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rans.extend import MOST_STEPS, ConfigError, Spacecraft, Timing
from rans_any_craft.authority import Authority
from rans_any_craft.networks import authority, columns_of

PERIODS = 0.1, 0.2
"""Control periods of craft in their own task, s."""
LARGEST_TURN = 0.6
"""Largest change of the spin in a control period, rad/s, over the angular authority; else the period is shorter."""
_LARGEST_PULSE = 0.03
"""Largest angle, rad, by which a pulse of an on/off thruster turns a craft in space; else the period is shorter.

Of a craft with nine thrusters and 0.07 rad 41 % of 64 flights settle at 0.2 s and all at 0.1 s; with twelve times
the mass and 0.006 rad all and 16 %."""
PERIODS_IN_SPACE = 0.1, 0.2, 0.5, 1.0
"""Control periods of craft in space with continuous effectors, s: those that shipped craft are flown at."""
_GENTLE_TURN = 0.2
"""Largest change of the spin of such a craft in a control period by its least angular authority, rad/s."""
_LARGEST_COMMAND = 0.06
"""Largest angle, rad, by which a full command of one thruster turns such a craft in a control period. Thrusters
that also turn a craft are opened together, and what is left of their torques grows with the square of the period
(docs/decisions/any_craft.md)."""
_FARTHEST = 4.0
"""Distance of the farthest start, m."""
_SLACK = 2.0
"""Length of an episode over the least time from rest to rest."""
_REST = 10.0
"""Time at the goal after it, s."""


def timing_for(craft: Spacecraft, usual: Timing, period: float | None = None) -> Timing:
    """Control period and length of an episode for a craft: slow craft are given longer ones.

    Args:
        craft: what flies.
        usual: timing of the task; no episode is shorter.
        period: control period, s; None: chosen for the craft.

    Raises:
        ConfigError: the agent for any craft cannot steer the craft, or it is too slow.
    """
    own = Authority.of_numbers(authority(craft, max(PERIODS)))
    if period is None:
        period = _period(craft, own)
    # The craft flies to the goal and turns to its attitude, both from rest to rest.
    flown = math.sqrt(_FARTHEST / own.least_linear)
    turned = math.sqrt(math.pi / own.least_angular)
    needed = _SLACK * 2.0 * max(flown, turned) + _REST
    usual_time = usual.episode_steps * usual.control_period
    # A period that is no number is refused by the timing.
    length = max(usual_time, needed)
    steps = math.ceil(length / period) if period > 0.0 else usual.episode_steps
    if steps > MOST_STEPS:
        raise ConfigError(
            f"{craft.name} needs {length:,.0f} s to fly {_FARTHEST:g} m and to turn, which is {steps:,} periods of "
            f"{period:g} s, and an episode has at most {MOST_STEPS:,}: the usual cause is a mass in g or forces in "
            "kN, where RANS takes kg and N."
        )
    return replace(usual, control_period=period, episode_steps=steps)


def _period(craft: Spacecraft, own: Authority) -> float:
    """Control period for a craft with an authority, s, short enough that it turns and pulses gently.

    Every flight of the craft of a user's file has it, so that a change moves the figures of `docs` and packages. In
    the plane only turning counts.
    """
    short, long = PERIODS
    slow = own.least_angular * long <= LARGEST_TURN
    if craft.dimension == 2:
        return long if slow and not craft.is_continuous else short
    # Largest angular acceleration by one thruster, rad/s^2, of which a craft in space that spans all ways has six.
    kicks = np.linalg.norm(columns_of(craft)[: craft.thruster_count, 3:], axis=1)
    kick = float(kicks.max())
    if not craft.is_continuous:
        return long if slow and kick * long**2 <= _LARGEST_PULSE else short
    # Slow craft need not be commanded often, and their episodes are long.
    gentle = [
        x
        for x in PERIODS_IN_SPACE
        if own.least_angular * x <= _GENTLE_TURN and kick * x**2 <= _LARGEST_COMMAND
    ]
    return max(gentle, default=short)
