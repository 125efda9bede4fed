"""Whether a craft that flies to a pose will come to rest within the tolerances, said before it flies."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rans import GoToPose, RansWarning
from rans.extend import ConfigError, Spacecraft
from rans_any_craft.networks import LEAST_MARGIN, authority, columns_of, without
from rans_any_craft.twists import authority_margin

_SURE = 0.375
"""Authority margin from which at least 91 % of 32 flights of each of 35 random layouts of four to eight on/off
thrusters settled; 53 to 100 % of 12 between `LEAST_MARGIN` and here, 0 to 53 % of nine below."""
_DISTANCE, _ANGLE = GoToPose.position_tolerance, GoToPose.attitude_tolerance
_REVERSED = 1.5
"""Factor by which a thruster that is turned round raises the margin from which its sign is doubted: of craft that
come with RANS at most 1.43 (apollo-csm), of 81 of 300 random layouts more."""


class Prospect(NamedTuple):
    """What decides whether a craft holds a pose."""

    margin: float
    """See `rans_any_craft.twists.authority_margin`."""
    shift: float
    """Largest distance, m, that one thruster moves the craft in a control period after it was open for one."""
    turn: float
    """Largest angle, rad, that one thruster turns the craft in a control period after it was open for one."""
    shortest: float
    """Shortest pulse over the control period; 0 of throttled thrusters."""
    sure: float
    """Authority margin from which all flights are expected to settle."""

    @classmethod
    def of(cls, craft: Spacecraft, period: float) -> Prospect:
        """Prospect of a craft which is commanded every ``period`` seconds.

        Raises:
            ConfigError: see `rans_any_craft.networks.authority`.
        """
        authority(craft, period)
        columns = columns_of(craft)
        pulses = columns[: craft.thruster_count] * period**2
        shifts = np.linalg.norm(pulses[:, : craft.dimension], axis=1)
        turns = np.linalg.norm(pulses[:, craft.dimension :], axis=1)
        is_coarse = craft.dimension == 2 and not craft.is_continuous
        margin = authority_margin(columns)
        sure = _SURE if is_coarse else LEAST_MARGIN
        return cls(margin, float(shifts.max()), float(turns.max()), craft.actuators.shortest, sure)

    @property
    def reason(self) -> str:
        """Why flights will not settle, for a sentence; "" if all are expected to."""
        if self.shortest * self.shift > _DISTANCE or self.shortest * self.turn > _ANGLE:
            return "its shortest pulse moves or turns it farther in a period than the tolerances"
        if self.margin < LEAST_MARGIN:
            return f"its authority margin is {self.margin:.2g}, and hardly a craft below {LEAST_MARGIN:g} settles"
        if self.margin < self.sure:
            return (
                f"its authority margin is {self.margin:.2g}, and with on/off thrusters and less than "
                f"{self.sure:g} a part of the flights does not settle"
            )
        return ""

    def text(self, period: float) -> str:
        """The numbers, for a user."""
        valve = ""
        if 0.0 < self.shortest < 1.0:
            valve = f" The shortest pulse has {1000.0 * self.shortest * period:.3g} ms."
        return (
            f"At {period:g} s a pulse of one thruster moves it {100.0 * self.shift:.3g} cm and turns it "
            f"{math.degrees(self.turn):.3g} degrees in a period; the tolerances are {100.0 * _DISTANCE:g} cm and "
            f"{math.degrees(_ANGLE):g} degrees.{valve} Its authority margin is {self.margin:.2g}."
        )


_MOST_SPARED = 32
"""Thrusters up to which each is taken away once: a tenth of a second each, and more with their number."""


_IN_FLIGHT = "One that dies in flight, unknown to the agent, loses flights: rans list FILE --conditions faults."


def spared(craft: Spacecraft, period: float) -> str:
    """Which of its thrusters a craft's file may leave out, in a sentence; "" with a single thruster or too many.

    One that dies while the file has it is told to nobody, and costs flights.
    """
    count = craft.thruster_count
    if not 2 <= count <= _MOST_SPARED:
        return ""
    lost: dict[str, list[str]] = {}
    for k in range(count):
        lost.setdefault(_without(craft, k, period), []).append(str(k))
    dead = lost.pop("", [])
    if not lost:
        return f"A file without any one of its thrusters still settles. {_IN_FLIGHT}"
    needed = ", ".join(f"{', '.join(numbers)} ({reason})" for reason, numbers in lost.items())
    return (
        f"A file without any one of these thrusters still settles: {', '.join(dead) or 'none'}; without one of "
        f"these it may not: {needed}. {_IN_FLIGHT}"
    )


def _without(craft: Spacecraft, number: int, period: float) -> str:
    """Why the craft will not settle without a thruster; "" if it is expected to."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RansWarning)  # the sentence says what the craft lacks
            left = Prospect.of(without(craft, number), period)
    except ConfigError:
        return "cannot be steered"
    return f"margin {left.margin:.2g}" if left.reason else ""


def slips(craft: Spacecraft) -> Iterator[str]:
    """Questions about thrusters that a file may have wrong: reversed, copied, or alone at a supply."""
    if craft.actuators.low > 0.0:  # such engines are not meant to push every way
        return
    columns = columns_of(craft)
    margin = authority_margin(columns)
    needed = max(_REVERSED * margin, LEAST_MARGIN)
    turned = []
    for k in range(craft.thruster_count):
        other = columns.copy()
        other[k] *= -1.0
        turned.append(authority_margin(other, needed))
    best = max(turned, default=0.0)
    if best > needed:
        numbers = [str(k) for k, one in enumerate(turned) if one > best * (1.0 - 1e-9)]
        yield (
            f"With the force of thruster {' or '.join(numbers)} reversed the margin would be {best:.2g} in place "
            f"of {margin:.2g}: is its sign right? `direction` is that of the force on the craft, opposite to the "
            "exhaust."
        )
    # Copies of one table.
    alike: dict[tuple[object, ...], list[str]] = {}
    for k, one in enumerate(craft.thrusters):
        alike.setdefault((one.position, one.direction), []).append(str(k))
    for numbers in alike.values():
        if len(numbers) > 1:
            yield f"Thrusters {' and '.join(numbers)} have one position and direction: is one a copy by mistake?"
    # Supplies that others share.
    largest = max(map(len, craft.supplies), default=0)
    for fed in craft.supplies:
        if len(fed) == 1 < largest:
            yield (
                f"Thruster {fed[0]} alone has supply {craft.thrusters[fed[0]].supply}, so that no other reduces "
                "its thrust: is that meant?"
            )
