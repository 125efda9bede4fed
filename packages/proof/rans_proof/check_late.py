"""Valves that open and shut late, each by itself and each time anew, for the check of a trapping set of poses.

A cell's state at a decision is that to which the craft coasts once all pulses before have ended: what valves let
through late counts as done. A pulse of a period T lasts from T - opening to T + shutting. What it lacks or has too
much changes a rate by at most `slip`, and, with what begins late, a position by at most `slip` T. As the set of one
part knows nothing of the pulses of the others, every thruster may be open in each period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping


class Late:
    """Delays of single valves; all bounds are of absolute values.

    Args:
        off: errors of a certificate, with `opening` and `shutting`, s.
        along: of each thruster -1, 0 or 1 along either diagonal of the craft.
        pull: acceleration by one thruster, at most, m/s^2.
        twist: rate of the spin by one thruster, at most, rad/s^2.
        most: number of thrusters that push along a diagonal or turn the craft the same way, at most.
    """

    def __init__(
        self,
        off: Mapping[str, float],
        along: list[tuple[int, int]],
        pull: float,
        twist: float,
        most: tuple[int, int],
    ) -> None:
        self.opening = off["opening"]
        self.shutting = off["shutting"]
        both = self.opening + self.shutting
        self._aligned = max(sum(abs(a[axis]) for a in along) for axis in (0, 1)) * pull * both
        self.spin_slip = len(along) * twist * both
        """Largest change of the spin by late valves in a period, rad/s."""
        # What is let through after a decision, in any direction of the craft.
        speed = math.sqrt(2.0) * most[0] * pull
        spin = most[1] * twist
        self.unread = {
            "position": speed * self.shutting**2 / 2.0,
            "velocity": speed * self.shutting,
            "heading": spin * self.shutting**2 / 2.0,
            "spin": spin * self.shutting,
        }
        """Difference of a reading and of the state that a cell has, by names of errors."""

    def slip(self, turned: float) -> float:
        """Largest change by late valves, in a period, of the velocity along a diagonal of the goal's frame, m/s.

        Args:
            turned: largest angle between the craft and the goal's frame while thrusters are open, rad.
        """
        across = math.sin(turned) if turned < math.pi / 2 else 1.0
        return self._aligned * (1.0 + across)

    def readings(self, off: Mapping[str, float]) -> dict[str, float]:
        """Errors of a certificate, with readings that are compared with a cell's states."""
        return {name: value + self.unread.get(name, 0.0) for name, value in off.items()}

    def turned(self, spin: float, period: float) -> float:
        """By how much more the craft may turn until the last valve of a period has shut, rad."""
        reach = period + self.shutting
        return (spin + self.unread["spin"]) * self.shutting + 2.0 * self.spin_slip * reach
