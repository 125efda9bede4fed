"""What drifts along uneven orbits have in common."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

from rans.extend import Drift, Field


class UnevenOrbit(Drift):
    """Relative motion near a target on an orbit along which it changes."""

    in_straight_lines: ClassVar[bool] = False
    steady: ClassVar[bool] = False

    @property
    @abstractmethod
    def angle(self) -> Field:
        """Where the target is on its orbit now, rad, as `at_angle` takes it."""

    @abstractmethod
    def at_angle(self, angle: Field) -> Self:
        """This orbit with the target at an angle along it, rad: a number, or an array of one for each episode."""
