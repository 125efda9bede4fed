"""Parameters that an episode draws from its conditions, and their effect in each control period.

Everything is written over fields. An effect that the conditions leave out is None and needs neither memory nor
operations. Every effect draws from a random stream of its own, so that adding one does not change the others.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.model.body import Body, Mounting
from rans.model.drift import Drift
from rans.model.dynamics import Piece, Wrench, undelayed
from rans.model.fields import Field, Vec3, at_least, cos, floor, map_leaves, sin, where
from rans.model.random import Draws, Random
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions, DisturbanceConditions, Range, largest
from rans.randomization.fault_draws import Fault, draw_fault
from rans.randomization.sensors import Sensors, draw_sensors
from rans.randomization.valves import Lag, failing, pieces


@dataclass(frozen=True)
class MinimumDwell:
    """Shortest time for which an on/off valve stays open."""

    on: Field
    """Shortest time open, s."""

    def enforced(
        self, command: Sequence[Field], before: Sequence[Sequence[Field]], period: float
    ) -> tuple[Field, ...]:
        """Commands that the valves carry out: a valve that has just opened stays open for its dwell time.

        Args:
            command: one field per valve, 0 or 1.
            before: the commands of earlier periods, the newest first.
            period: control period, s.
        """
        result = []
        for commanded, *last in zip(command, *before, strict=True):
            opened = _age(last)
            must_open = (opened > 0.0) & (opened * period < self.on - 1e-6)
            result.append(where(must_open, commanded * 0.0 + 1.0, commanded))
        return tuple(result)


def _age(open_before: Sequence[Field]) -> Field:
    """Number of control periods for which a valve has been open until now, within the stored history."""
    still: Field = 1.0
    age: Field = 0.0
    for was_open in open_before:
        still = still * was_open
        age = age + still
    return age


@dataclass(frozen=True)
class SinusoidalWrench:
    """A sinusoidal disturbance wrench in W: amplitude times sin(rate t + phase)."""

    amplitude: Wrench
    rate: Field
    """Angular frequency, rad/s."""
    phase: Field
    """Phase at the start of the episode, rad."""


@dataclass(frozen=True)
class ImpulsiveWrench:
    """An impulsive disturbance, spread evenly over the control period in which it occurs."""

    step: Field
    """Index of the control period, a whole number."""
    impulse: Wrench
    """Impulse and angular impulse in W, N s and N m s."""


@dataclass(frozen=True)
class Failing:
    """Thrusters that fail at an instant."""

    instant: Field
    """Time of the fault from the start of the control period, s; it may lie before or after the period."""
    body: Body
    """Body after the fault; it differs from the one before in gain and leak only."""


@dataclass(frozen=True)
class StepInputs:
    """Body, commands and disturbances that move a spacecraft in one control period."""

    body: Body
    """Body before a fault."""
    commands: tuple[tuple[Field, ...], ...]
    """Commands of this period, and of earlier ones that delayed valves still carry out, the newest first."""
    lag: Lag | None = None
    """Delay of the valves; None: they follow commands without delay."""
    disturbance: Wrench | None = None
    """Disturbance wrench, constant in W."""
    failing: Failing | None = None
    """Fault within the period; None: no thruster fails."""
    drift: Drift | None = None
    """Motion of a free point from the start of the period; None: that of the task at all times."""

    def pieces(self, craft: Spacecraft, period: float) -> Iterator[Piece]:
        """Wrenches of the thrusters over the control period (s), piece by piece."""
        if self.failing is None:
            return self._with(self.body, craft, period)
        sound, failed = (self._with(body, craft, period) for body in (self.body, self.failing.body))
        return failing(sound, failed, self.failing.instant)

    def _with(self, body: Body, craft: Spacecraft, period: float) -> Iterator[Piece]:
        """Pieces of the period for thrusters whose health does not change within it."""
        if self.lag is None:
            return undelayed(craft, body, self.commands[0], period)
        return pieces(craft, body, self.commands, self.lag, period)


@dataclass(frozen=True)
class EpisodeParameters:
    """Parameters that one episode drew, or N episodes as fields (N,)."""

    number: Field
    """Number of the episode."""
    body: Body
    """Body before a fault."""
    fault: Fault | None
    lag: Lag | None
    dwell: MinimumDwell | None
    push: Wrench | None
    """Constant disturbance wrench in W."""
    swing: SinusoidalWrench | None
    kick: ImpulsiveWrench | None
    sensors: Sensors | None
    noise: Field | None = None
    """Standard deviation of each thrust over its force, drawn anew in every control period."""

    def body_at(self, time: Field) -> Body:
        """Body at a time since the start of the episode (s), with the fault once it has begun."""
        if self.fault is None:
            return self.body
        failed = time >= self.fault.begins
        choose = lambda broken, sound: where(failed, broken, sound)  # noqa: E731
        return replace(
            self.body,
            gain=tuple(map(choose, self.fault.gain, self.body.gain)),
            leak=tuple(map(choose, self.fault.leak, self.body.leak)),
        )

    def flying(self, time: Field) -> tuple[Body, Failing | None]:
        """Body of a control period that begins at a time since the start (s), and the fault within it.

        The fault is None if no fault of these conditions begins after the start.
        """
        if self.fault is None or self.fault.latest <= 0.0:
            return self.body_at(time), None
        failed = replace(self.body, gain=self.fault.gain, leak=self.fault.leak)
        return self.body, Failing(self.fault.begins - time, failed)

    def thrust_factors(self, step: Field, draws: Draws) -> list[Field] | None:
        """Factor on the force of each thruster in a control period, never below 0; None: the force has no noise.

        Recorded flights rely on the numbers of streams and blocks: other ones are other noise for the same seed.

        Args:
            step: number of the control period, a whole number.
            draws: seed of the random numbers.
        """
        if self.noise is None:
            return None
        count = len(self.body.gain)
        # Two normal numbers take two of the four numbers of a block.
        blocks = count // 4 + 1
        random = draws.random(2, self.number, step * blocks + THRUST_PER_STEP)
        return [at_least(1.0 + self.noise * random.normal(), 0.0) for _ in range(count)]

    def strongest(self) -> Body:
        """Body with the largest forces before and after the fault, and with noise of three standard deviations."""
        strongest = self._strongest()
        if self.noise is None:
            return strongest
        return scaled(strongest, [1.0 + 3.0 * self.noise] * len(strongest.gain))

    def _strongest(self) -> Body:
        """Body whose thrusters have the larger of their forces before and after the fault."""
        if self.fault is None:
            return self.body
        gain = (
            where(a + b > c + d, a + b, c + d)
            for a, b, c, d in zip(
                self.body.gain, self.body.leak, self.fault.gain, self.fault.leak, strict=True
            )
        )
        return replace(self.body, gain=tuple(gain), leak=(0.0,) * len(self.body.leak))

    def disturbance(self, step: Field, period: float) -> Wrench | None:
        """Disturbance wrench of a control period, constant in W; None if the conditions have no disturbances.

        A sinusoidal disturbance has its value at the middle of the period. `step` counts control periods, a field;
        N and N m.
        """
        parts = [] if self.push is None else [self.push]
        if self.swing is not None:
            s = sin(self.swing.rate * ((step + 0.5) * period) + self.swing.phase)
            parts.append(map_leaves(lambda x: x * s, self.swing.amplitude))
        if self.kick is not None:
            at = self.kick.step
            now = where(at == step, at * 0.0 + 1.0 / period, at * 0.0)
            parts.append(map_leaves(lambda x: x * now, self.kick.impulse))
        return reduce(lambda a, b: map_leaves(operator.add, a, b), parts) if parts else None


def scaled(body: Body, factors: Sequence[Field]) -> Body:
    """Body whose thrusters have forces times these factors (fields); a gain or leak of 0 stays constant.

    Zeros stay numbers, so that what a dead thruster does costs no operation.
    """
    gain, leak = (
        tuple(
            x if isinstance(x, float) and x == 0.0 else x * k
            for x, k in zip(xs, factors, strict=True)
        )
        for xs in (body.gain, body.leak)
    )
    return replace(body, gain=gain, leak=leak)


def examples(conditions: Conditions, craft: Spacecraft, steps: int) -> EpisodeParameters:
    """Parameters of the first 1,024 episodes of ``steps`` control periods under seed 0, as arrays (1024,).

    Raises:
        ConfigError: ``conditions`` are not `Conditions`, or do not apply to the valves of the craft.
    """
    if not isinstance(conditions, Conditions):
        raise ConfigError(f"conditions must be rans.load_conditions(...), got {brief(conditions)}.")
    conditions.check_craft(craft)
    numbers = np.arange(1024, dtype=np.int32)
    return draw(
        conditions,
        craft,
        Body.of(craft),
        steps,
        numbers,
        Draws(low=0, high=0, first=numbers, stride=0, dtype=np.float64),
    )


_STREAMS = {
    "body": 1,
    "thrusters": 2,
    "fault": 3,
    "lag": 4,
    "hold": 5,
    "push": 6,
    "swing": 7,
    "kick": 8,
    "sensors": 16,
    "mixture": 17,
    "noise": 18,
    "mountings": 19,
}
"""Random streams of the effects, of 256 blocks of random numbers each. Start and goal have stream 0.
These numbers must not change: every seed would then have other episodes."""
MIXTURE = 256 * _STREAMS["mixture"]
"""Block of the random number that selects an episode's conditions from a mixture."""
THRUST_PER_STEP = 2**26
"""First block of the random numbers of thrusts in a step, above those of sensors (`PER_STEP`). The largest
number of thrusters takes 251 blocks in each of 2^20 steps, which ends below 2^31."""


def draw(
    conditions: Conditions, craft: Spacecraft, base: Body, steps: int, number: Field, draws: Draws
) -> EpisodeParameters:
    """Draw the parameters of an episode.

    Args:
        conditions: distributions to draw from.
        craft: spacecraft.
        base: body to which the factors apply.
        steps: control periods of an episode.
        number: number of the episode.
        draws: seed of the random numbers.
    """

    def random(stream: str) -> Random:
        return draws.random(craft.dimension, number, _STREAMS[stream] * 256)

    if conditions.others:
        conditions = conditions.met(draws.random(craft.dimension, number, MIXTURE).unit())
    body = _body(conditions, base, random("body"), random("thrusters"))
    thrusters = conditions.thrusters
    mountings = _mountings(thrusters.misalignment, craft, random("mountings"))
    # A base with true positions keeps them unless the conditions have errors.
    body = replace(body, mountings=mountings or base.mountings)
    # Every effect has a stream of its own: a new one gets a new number in `_STREAMS`.
    pushes = conditions.disturbances
    return EpisodeParameters(
        number=number,
        body=body,
        fault=draw_fault(conditions.faults, craft, body, random("fault")),
        lag=_lag(conditions, random("lag")),
        dwell=_dwell(conditions, random("hold")),
        push=_push(pushes.force, pushes.torque, random("push")),
        swing=_swing(pushes.slow_force, random("swing")),
        kick=_kick(pushes.kick, steps, random("kick")),
        sensors=draw_sensors(conditions.sensors, random("sensors")),
        noise=_noise(conditions.thrusters.noise, random("noise")),
    )


def _noise(noise: Range, random: Random) -> Field | None:
    return random.within(noise) if largest(noise) > 0.0 else None


def _mountings(misalignment: Range, craft: Spacecraft, random: Random) -> tuple[Mounting, ...]:
    """True directions of thrusters at their designed positions; empty if they are as designed.

    Thrusters draw in their order, in space the azimuth before the angle; recorded flights rely on it.
    """
    if largest(misalignment) == 0.0:
        return ()
    mountings = []
    for thruster in craft.thrusters:
        designed = thruster.direction[: craft.dimension]
        if craft.dimension == 2:
            angle = random.turn(misalignment)
            sides = [(-designed[1], designed[0])]
            components = [sin(angle)]
        else:
            azimuth = random.uniform(-math.pi, math.pi)
            angle = random.within(misalignment)
            sides = _across(designed)
            components = [sin(angle) * cos(azimuth), sin(angle) * sin(azimuth)]
        along = cos(angle)
        direction = [
            sum(
                (component * side[axis] for component, side in zip(components, sides, strict=True)),
                along * x,
            )
            for axis, x in enumerate(designed)
        ]
        mountings.append(Mounting((0.0,) * craft.dimension, tuple(direction)))
    return tuple(mountings)


def _across(direction: Sequence[float]) -> list[Sequence[float]]:
    """Two unit vectors in space that are normal to a unit vector and to each other."""
    along = Vec3(*direction)
    # The axis that is least along the vector is never parallel to it.
    least = min(range(3), key=lambda axis: abs(direction[axis]))
    first = along.cross(Vec3(*(float(axis == least) for axis in range(3))))
    first = first.scale(1.0 / math.sqrt(first.dot(first)))
    return [first.columns(), along.cross(first).columns()]


def _body(conditions: Conditions, base: Body, random: Random, thrusters: Random) -> Body:
    """Mass properties and thrusts of the episode; ``thrusters`` draws the factor of each thruster.

    The order of these draws is that of recorded flights; a new quantity is drawn last, or from a stream of its own.
    """
    body = conditions.body
    given = conditions.thrusters
    mass = random.within(body.mass)
    inertia = random.within(body.inertia)
    pressure = random.within(given.pressure)
    droop = random.within(given.droop or 0.0)
    # Equal moments of inertia stay the same object, so that the gyroscopic torque is known to be zero.
    same = [x if isinstance(x, float) else id(x) for x in base.inertia]
    scaled = {
        key: x if key == 0.0 else x * inertia for key, x in zip(same, base.inertia, strict=True)
    }
    centre = base.centre
    gain = base.gain
    if largest(body.centre) > 0.0:
        offset = random.vector(body.centre).columns()
        centre = tuple(c + o for c, o in zip(centre, offset, strict=True))
    if (given.thrust, given.pressure) != (1.0, 1.0):
        gain = tuple(g * (thrusters.within(given.thrust) * pressure) for g in gain)
    return Body(
        base.mass * mass,
        tuple(scaled[key] for key in same),
        centre,
        gain,
        base.leak,
        base.droop if given.droop is None else droop,
    )


def _lag(conditions: Conditions, random: Random) -> Lag | None:
    thrusters = conditions.thrusters
    if conditions.lasting == 0.0:
        return None
    latency = random.within(thrusters.latency) + random.within(thrusters.command_delay)
    rise = random.within(thrusters.rise) if largest(thrusters.rise) > 0.0 else None
    return Lag(latency, rise, conditions.delay, conditions.lasting - conditions.delay)


def _dwell(conditions: Conditions, random: Random) -> MinimumDwell | None:
    on = conditions.thrusters.least_on
    return MinimumDwell(random.within(on)) if largest(on) > 0 else None


def _push(force: Range, torque: Range, random: Random) -> Wrench | None:
    if largest(force) == 0.0 and largest(torque) == 0.0:
        return None
    return Wrench(random.vector(force), random.turn(torque))


def _swing(force: Range, random: Random) -> SinusoidalWrench | None:
    amplitude = _push(force, 0.0, random)
    if amplitude is None:
        return None
    rate = math.tau / random.within(DisturbanceConditions.slow_period)
    return SinusoidalWrench(amplitude, rate, random.uniform(0.0, math.tau))


def _kick(size: Range, steps: int, random: Random) -> ImpulsiveWrench | None:
    if largest(size) == 0.0:
        return None
    step = floor(random.unit() * float(steps))
    return ImpulsiveWrench(step, Wrench(random.vector(size), random.turn(0.0)))
