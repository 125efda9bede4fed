"""An effector that RANS does not know: a torquer that a battery feeds. All that it needs is here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.effectors.effector import Action, Begun, Effector, Push
from rans.model.fields import Field, Vec3, absolute, where
from rans.model.spacecraft import CommandRange, Store
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.further import DrakeEffector, Pushing, register


@dataclass(frozen=True)
class Torquer(Effector):
    """Turns the craft about an axis of B, the harder the more of its charge a control period takes."""

    axis: tuple[float, float, float]
    torque: float
    """For the command 1, N m."""
    charge: float
    """Full, as seconds of full torque; without charge it gives nothing."""

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        return (CommandRange("torquer", "torque", -1.0, 1.0),)

    @property
    def stores(self) -> tuple[Store, ...]:
        return (Store("charge", "s", self.charge, 0.0, self.charge),)

    @property
    def largest_torque(self) -> float:
        return self.torque

    def begin(self, begun: Begun) -> Action:
        (command,) = begun.command
        (charge,) = begun.stores
        # No more than the charge that is left.
        most = charge * (1.0 / begun.period)
        share = where(command < most, command, most)
        share = where(share > -most, share, -most)
        return _Turning(self, share, charge)


class _Turning(Action):
    def __init__(self, torquer: Torquer, share: Field, charge: Field) -> None:
        self._torquer = torquer
        self._share = share
        self._charge = charge

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        torquer = self._torquer
        for push in pushes:
            amount = self._share * torquer.torque
            planar = not isinstance(push.first.torque, Vec3)
            x, y, z = torquer.axis
            # Without propellant, which would make it grow.
            turn = amount * z if planar else Vec3(amount * x, amount * y, amount * z)
            yield replace(push, first=replace(push.first, torque=push.first.torque + turn))

    def stores(self, time: Field) -> tuple[Field, ...]:
        return (self._charge - absolute(self._share) * time,)


class TorquerInDrake(DrakeEffector):
    """A pure torque in Drake's plant."""

    def __init__(self, torquer: Any) -> None:
        self._torquer = torquer

    def places(self) -> list[Pushing]:
        return [Pushing((0.3, -0.2, 0.1), self._torquer.axis, 0.0, self._torquer.torque)]

    def values(self, commands: np.ndarray, stores: np.ndarray, duration: float) -> np.ndarray:
        most = stores / duration if np.isfinite(duration) else 1.0
        return np.clip(commands, -most, most)

    def stores_after(
        self, commands: np.ndarray, stores: np.ndarray, duration: float, time: float
    ) -> np.ndarray:
        return stores - np.abs(self.values(commands, stores, duration)) * time


register("Torquer", TorquerInDrake)
TURNED = replace(
    load_spacecraft("floating-platform"),
    name="turned",
    further_effectors=(Torquer((0.0, 0.0, 1.0), 0.05, 1.5),),
)
TURNED_IN_SPACE = replace(
    load_spacecraft("free-flyer"),
    name="turned-in-space",
    further_effectors=(Torquer((0.0, 0.6, 0.8), 0.03, 1.5),),
)
