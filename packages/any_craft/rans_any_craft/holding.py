"""Holding the goal's pose in the plane by single pulses of on/off thrusters.

Within the tolerances a craft coasts until it is about to leave them. Then it opens the thrusters whose pulse costs
the least thrust for each second that it stays inside. A network's demand is worse there: it asks for rest at the
goal, which pulses that are large against the tolerances reach only by many of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rans.extend import Field, absolute, at_least, sqrt, where
from rans_any_craft.authority import of_wide

_DISTANCE = 0.05
_ANGLE = math.radians(5.0)
"""Tolerances of go-to-pose, m and rad, within which the craft holds its pose."""
_KEPT = 0.97
"""Part of the tolerances that a pulse may use up. From 0.9 to 0.97 the platform's impulse falls by 2 %."""
_PERIODS = 2.0
_SECONDS = 0.4
"""Control periods, and s, ahead for which the craft must stay inside to coast. At 1.5 periods craft with fine
pulses take 1 to 3 % more impulse. Commanded every 0.1 s, the platform settles 28 % of its flights in `lab` by 2
periods, and 69 % by 0.4 s."""
_MOST_OPEN = 3
"""Largest number of thrusters that open together. With any number the impulse is the same within 5 %."""
_LEAST = 1.1
"""Shortest time inside that a pulse is worth, control periods: it cannot be corrected sooner."""
_NONE = -1e5
_NEVER = -1e6
"""Worth of leaving the choice to the network, in units of thrust for each period, and of pulses that are worse."""
NUMBERS = 6
"""Numbers of a pose and its rates."""


class Pulses(NamedTuple):
    """Pulses to choose from; before them come the network's own choice and shut thrusters."""

    twist: np.ndarray
    """(P, 3) changes of the twist, in units of the craft's authority."""
    thrust: np.ndarray
    """(P,) over the least of them."""
    table: np.ndarray
    """(2 + P, n + 1): 0.5 for open and -0.5 for shut thrusters, then 1 where the network chooses, else 0."""
    radius: float
    """`_DISTANCE` in units of the authority: what its change of speed covers in a control period."""
    angle: float
    """`_ANGLE` in units of what the authority's change of spin turns in a control period."""
    units: tuple[float, float]
    """These units, m and rad."""
    ahead: float
    """Control periods ahead for which the craft must stay inside to coast."""


def pulses_of(
    opened: np.ndarray,
    twist: np.ndarray,
    thrust: np.ndarray,
    units: tuple[float, float],
    period: float,
) -> Pulses:
    """Pulses of at most `_MOST_OPEN` thrusters.

    Args:
        opened: (S, n) 0 or 1, ways to open the thrusters.
        twist: (S, 3) changes of the twist by them in a control period, in units of the authority.
        thrust: (S,) of them, in any unit.
        units: distance (m) and angle (rad) that the authority's change of a speed and a spin covers in a period.
        period: control period, s.
    """
    count = opened.sum(axis=1)
    is_pulse = (count > 0) & (count <= _MOST_OPEN)
    shut = np.zeros((1, opened.shape[1]))
    table = np.concatenate((shut, shut, opened[is_pulse])) - 0.5
    network = np.zeros((len(table), 1))
    network[0] = 1.0
    thrust = thrust[is_pulse]
    distance, angle = units
    return Pulses(
        twist[is_pulse],
        thrust / thrust.min(),
        np.concatenate((table, network), axis=1),
        _DISTANCE / distance,
        _ANGLE / angle,
        units,
        max(_PERIODS, _SECONDS / period),
    )


def pose(columns: Sequence[Field]) -> list[Field]:
    """Vector to the goal in B (m), velocity, angle to the goal (rad) and spin, by the columns of a network.

    Columns are those of `rans_any_craft.authority.columns` in the plane; velocity and spin are in units of the
    authority. The columns are logarithms of these numbers.
    """
    x, y, speed_x, speed_y = columns[:4]
    turn, spin = columns[12], columns[14]
    return [
        0.05 * of_wide(x),
        0.05 * of_wide(y),
        of_wide(speed_x),
        of_wide(speed_y),
        0.1 * of_wide(turn),
        of_wide(spin),
    ]


def first(own: Sequence[Field], pulses: Pulses) -> list[Field]:
    """Worth of the network's own choice and of shut thrusters, of the six numbers of `pose`."""
    x, y, speed_x, speed_y, turn, spin = in_units(own, pulses)
    is_near = _inside(x, y, turn, pulses, 1.0)
    ahead = pulses.ahead
    stays = _inside(x - ahead * speed_x, y - ahead * speed_y, turn - ahead * spin, pulses, _KEPT)
    return [where(is_near > 0.0, _NONE, -_NONE), where(is_near * stays > 0.0, 1.0, _NEVER)]


def in_units(own: Sequence[Field], pulses: Pulses) -> list[Field]:
    """The six numbers of `pose`, places in units of what the authority covers in a control period."""
    distance, angle = pulses.units
    x, y, speed_x, speed_y, turn, spin = own
    return [
        x * (1.0 / distance),
        y * (1.0 / distance),
        speed_x,
        speed_y,
        turn * (1.0 / angle),
        spin,
    ]


def _inside(x: Field, y: Field, turn: Field, pulses: Pulses, part: float) -> Field:
    """1 within a part of the tolerances, else 0."""
    radius, angle = part * pulses.radius, part * pulses.angle
    near = where(x * x + y * y < radius * radius, 1.0, 0.0)
    return near * where(absolute(turn) < angle, 1.0, 0.0)


def worth(
    own: Sequence[Field], pulse: Sequence[Field], thrust: Field, radius: float, angle: float
) -> Field:
    """Worth of a pulse: minus its thrust for each period that the craft then stays within the tolerances.

    Args:
        own: six numbers of `in_units`.
        pulse: its three changes of the twist.
        thrust: of it.
        radius: see `Pulses`.
        angle: see `Pulses`.
    """
    radius, angle = _KEPT * radius, _KEPT * angle
    x, y, speed_x, speed_y, turn, spin = own
    push_x, push_y, kick = pulse
    # At the end of the pulse, which lasts a period.
    x = x - speed_x - 0.5 * push_x
    y = y - speed_y - 0.5 * push_y
    turn = turn - spin - 0.5 * kick
    speed_x, speed_y, spin = speed_x + push_x, speed_y + push_y, spin + kick
    # Until it leaves the circle, and the angle.
    square = speed_x * speed_x + speed_y * speed_y + 1e-6
    ahead = x * speed_x + y * speed_y
    beyond = x * x + y * y - radius * radius
    leaves = (ahead + sqrt(at_least(ahead * ahead - square * beyond, 0.0))) / square
    left = angle + where(spin < 0.0, -turn, turn)
    turns = left / (absolute(spin) + 1e-4)
    time = where(turns < leaves, turns, leaves)
    # It ends inside, and stays so until it can be corrected.
    value = -thrust / at_least(time - 1.0, _LEAST - 1.0)
    value = where(beyond < 0.0, value, _NEVER)
    value = where(absolute(turn) < angle, value, _NEVER)
    return where(time > _LEAST, value, _NEVER)
