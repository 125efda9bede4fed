"""Thrusters as an effector: on/off, pulsed or throttled, as the craft's actuators say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rans.effectors.effector import Action, Begun, Effector
from rans.model.body import Body
from rans.model.dynamics import Piece, at_once
from rans.model.fields import Field
from rans.model.spacecraft import CommandRange, Spacecraft

_NOTHING_MORE = Action()


@dataclass(frozen=True)
class Thrusters(Effector):
    """All thrusters of a craft: the source of the parts of a control period that other effectors change."""

    craft: Spacecraft

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """One of each thruster."""
        return self.craft.commands[: len(self.craft.thrusters)]

    def pieces(self, body: Body, command: Sequence[Field], period: float) -> Iterator[Piece]:
        """Parts of a control period (s) in which thrusters obey their commands at once."""
        return at_once(self.craft, body, command, period)

    def begin(self, begun: Begun) -> Action:
        """Nothing beside `pieces`."""
        return _NOTHING_MORE
