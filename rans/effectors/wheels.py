"""Reaction wheels over a control period: motor torques within their limits, and wheel momentum."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

from rans.effectors.effector import Action, Begun, Effector, Push, times
from rans.model.actuators import Wheel
from rans.model.dynamics import State, Wrench
from rans.model.fields import Field, Vec3, where
from rans.model.spacecraft import CommandRange, Spacecraft, Store


@dataclass(frozen=True)
class ReactionWheels(Effector):
    """Reaction wheels of a craft, in the plane or in space (`dimension`)."""

    wheels: tuple[Wheel, ...]
    dimension: int
    ranges: tuple[CommandRange, ...]
    momenta: tuple[Store, ...]

    @property
    def commands(self) -> tuple[CommandRange, ...]:
        """Commands of the wheels, one each: -1 to 1, as a share of the largest torque."""
        return self.ranges

    @property
    def stores(self) -> tuple[Store, ...]:
        """Momentum of each wheel, N m s."""
        return self.momenta

    def begin(self, begun: Begun) -> Action:
        """Action over a control period: constant motor torques within the limits of torque and momentum."""
        motors = motor_torques(self.wheels, begun.command, begun.stores, begun.period)
        return _Spinning(self, begun.stores, motors)


@dataclass(eq=False)
class _Spinning(Action):
    wheels: ReactionWheels
    momenta: Sequence[Field]
    motors: Sequence[Field]
    elapsed: Field = 0.0

    def pushes(self, pushes: Iterable[Push]) -> Iterator[Push]:
        """Parts of the period with the reaction torque of the motors and the momentum of the wheels.

        Counts the time that has passed: iterate once, in the order of time.
        """
        wheels = self.wheels
        for push in pushes:
            turn = along_axes(wheels, self.motors)
            before = along_axes(wheels, self.stores(self.elapsed))
            after = before + times(turn, push.duration)
            if push.loss is not None:
                before, after = push.loss.turning.line(before, after)
            self.elapsed = self.elapsed + push.duration
            reaction = Wrench(push.first.force.scale(0.0), times(turn, -1.0))
            yield replace(push.plus(reaction), momentum=(before, after - before))

    def stores(self, time: Field) -> tuple[Field, ...]:
        """Momenta of the wheels at a time since the start of the period (s), N m s."""
        pairs = zip(self.momenta, self.motors, strict=True)
        return tuple(momentum + torque * time for momentum, torque in pairs)


def motor_torques(
    wheels: Sequence[Wheel], command: Sequence[Field], momenta: Sequence[Field], period: float
) -> tuple[Field, ...]:
    """Torque of each motor on its wheel, N m, constant over the control period.

    A motor follows its command, but gives less torque if the momentum of the wheel would exceed its limit by the
    end of the period. Momenta and commands are fields; the torque on the craft has the other sign.

    Args:
        wheels: reaction wheels.
        command: commands of the wheels, -1 to 1.
        momenta: momenta of the wheels at the start of the period, N m s.
        period: control period, s.
    """
    torques = []
    for wheel, fraction, momentum in zip(wheels, command, momenta, strict=True):
        torque = fraction * wheel.max_torque
        largest = (wheel.max_momentum - momentum) * (1.0 / period)
        least = (-wheel.max_momentum - momentum) * (1.0 / period)
        torque = where(torque < largest, torque, largest)
        torques.append(where(torque > least, torque, least))
    return tuple(torques)


def wheel_speeds(craft: Spacecraft, state: State) -> tuple[Any, ...]:
    """Speed of each reaction wheel about its axis relative to the body, rad/s, as its encoder reads it.

    It is momentum / inertia - w . axis, of the wheel's absolute momentum (`rans.model.actuators.Wheel`).

    Args:
        craft: spacecraft.
        state: its state, with stores.
    """
    # Propellant has the first entry of the stores if there is any.
    first = 0 if craft.propellant is None else 1
    momenta = state.stores[first : first + craft.wheel_count]
    spin = state.spin()
    speeds = []
    for wheel, momentum in zip(craft.wheels, momenta, strict=True):
        about = sum(a * w for a, w in zip(wheel.axis[3 - len(spin) :], spin, strict=True))
        speeds.append(momentum / wheel.inertia - about)
    return tuple(speeds)


def wheel_inertia(wheels: Sequence[Wheel]) -> tuple[float, ...]:
    """Sum of the wheels' moments of inertia about their axes, as the six entries of a tensor in B, kg m^2."""
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    if not wheels:
        return ()
    return tuple(sum(w.inertia * w.axis[i] * w.axis[j] for w in wheels) for i, j in pairs)


def along_axes(wheels: ReactionWheels, amounts: Sequence[Field]) -> Any:
    """Sum of amounts (one a wheel) times axes, in B: a vector in space, a scalar about z in the plane; any unit.

    Zeros of axes are left out, so that a traced step has no operation for them.
    """
    if wheels.dimension == 2:
        return reduce(add, (x * w.axis[2] for x, w in zip(amounts, wheels.wheels, strict=True)))
    columns = []
    for k in range(3):
        pairs = zip(amounts, wheels.wheels, strict=True)
        terms = [x * wheel.axis[k] for x, wheel in pairs if wheel.axis[k] != 0.0]
        columns.append(reduce(add, terms) if terms else amounts[0] * 0.0)
    return Vec3(*columns)
