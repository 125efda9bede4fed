"""What drifts along uneven orbits have in common."""

from __future__ import annotations

from typing import ClassVar

from rans.extend import Drift, Field


class UnevenOrbit(Drift):
    """Relative motion near a target on an orbit along which it changes."""

    in_straight_lines: ClassVar[bool] = False
    steady: ClassVar[bool] = False
    angle: Field
    """Where the target is on its orbit at the start of a motion, rad: a number, or one for each episode."""
