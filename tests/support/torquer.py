"""Effectors that RANS does not know: the torquer of ``examples/plugin``, which a battery feeds, and a fan."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rans_example.in_drake import TorquerInDrake
from rans_example.motion import Torquer

from rans.effectors.effector import Action, Begun, Effector, Push
from rans.model.fields import Vec3
from rans.model.spacecraft import CommandRange, Spacecraft
from rans.model.spacecraft_file import load_spacecraft
from rans.reference.further import DrakeEffector, Pushing, register

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


@dataclass(frozen=True)
class Fan(Effector):
    """Pushes the craft along x of B from a place beside its centre of mass."""

    force: float
    """For the command 1, N."""
    position: tuple[float, float, float]
    """In G; of a craft from its designed centre of mass, m."""
    commands = (CommandRange("fan", "fan", 0.0, 1.0),)

    def of_craft(self, craft: Spacecraft) -> Effector:
        away = [a - b for a, b in zip(self.position, craft.centre_of_mass, strict=True)]
        return MountedFan(self.force, self.position, (away[0], away[1], away[2]))

    def begin(self, begun: Begun) -> None: ...


@dataclass(frozen=True)
class MountedFan(Fan):
    """A fan at its place on a craft."""

    away: tuple[float, float, float]

    def begin(self, begun: Begun) -> Action:  # type: ignore[override]
        (command,) = begun.command
        zero = command * 0.0
        push = Vec3(command * self.force, zero, zero)
        return _Blowing(begun.wrench(Vec3(zero, zero, zero), push, self.away))


class _Blowing(Action):
    def __init__(self, wrench: Any) -> None:
        self._wrench = wrench

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        for push in pushes:
            yield push.plus(self._wrench)


class FanInDrake(DrakeEffector):
    def __init__(self, fan: MountedFan) -> None:
        self._fan = fan

    def places(self) -> list[Pushing]:
        return [Pushing(self._fan.position, (1.0, 0.0, 0.0), self._fan.force, 0.0)]

    def values(self, commands: np.ndarray, stores: np.ndarray, duration: float) -> np.ndarray:
        return commands


register("MountedFan", FanInDrake)
