"""What drifts along uneven orbits have in common."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from rans.extend import Drift, Field


class UnevenOrbit(Drift):
    """Relative motion near a target on an orbit along which it changes."""

    in_straight_lines: ClassVar[bool] = False
    steady: ClassVar[bool] = False

    @property
    @abstractmethod
    def angle(self) -> Field:
        """Where the target is on its orbit now, rad: a number, or an array of one for each episode."""
