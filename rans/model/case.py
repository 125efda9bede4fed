"""What one episode drew from its conditions, and what that does to it, written over fields.

A part that the conditions leave out is None: it is in no memory and in no kernel. Every effect draws from a
stream of its own, so that switching one on changes no other.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

from rans.model.body import Body
from rans.model.conditions import Conditions, FaultKind, Range, SensorConditions, largest
from rans.model.dynamics import State, Wrench
from rans.model.fields import Field, Heading, floor, leaves, map_leaves, sin, where
from rans.model.random import Random
from rans.model.rotation import exponential
from rans.model.valves import Lag


@dataclass(frozen=True)
class Fault:
    """The thrusters' health from a moment on."""

    begins: Field
    """s from the start of the episode."""
    gain: tuple[Field, ...]
    leak: tuple[Field, ...]


@dataclass(frozen=True)
class Hold:
    """How long on/off valves stay as they are, at least."""

    on: Field
    """s."""
    off: Field
    """s."""


@dataclass(frozen=True)
class Swing:
    """A wrench in W that goes to and fro: amplitude times sin(rate t + phase)."""

    amplitude: Wrench
    rate: Field
    """rad/s."""
    phase: Field
    """rad."""


@dataclass(frozen=True)
class Kick:
    """A sudden push, spread over the control period it falls in."""

    step: Field
    """Which control period, a whole number."""
    impulse: Wrench
    """In W, N s and N m s."""


@dataclass(frozen=True)
class Sensors:
    """What readings have wrong, in the order of a state's fields: p, attitude, v, w."""

    delay: Field
    """Control periods, a whole number."""
    noise: tuple[Field, ...] | None
    """Standard deviation of each component."""
    bias: tuple[Any, ...] | None
    """Vectors (a scalar for planar turns); the attitude's is a rotation vector in B."""
    dropout: tuple[Field, ...] | None
    """Probability that the last reading stands."""


@dataclass(frozen=True)
class Case:
    """What one episode drew, or N did."""

    number: Field
    """Of the episode."""
    body: Body
    """What flies."""
    fault: Fault | None
    lag: Lag | None
    hold: Hold | None
    push: Wrench | None
    """Steady, in W."""
    swing: Swing | None
    kicks: tuple[Kick, ...]
    sensors: Sensors | None

    def body_at(self, time: Field) -> Body:
        """What flies so long after the start (s)."""
        if self.fault is None:
            return self.body
        failed = time >= self.fault.begins
        choose = lambda broken, sound: where(failed, broken, sound)  # noqa: E731
        return replace(self.body, gain=tuple(map(choose, self.fault.gain, self.body.gain)),
                       leak=tuple(map(choose, self.fault.leak, self.body.leak)))

    def disturbance(self, step: Field, period: float) -> Wrench | None:
        """What pushes in this control period beside the thrusters, constant in W; None: nothing ever.

        What swings has its value in the middle of the period.
        """
        parts = [] if self.push is None else [self.push]
        if self.swing is not None:
            s = sin(self.swing.rate * ((step + 0.5) * period) + self.swing.phase)
            parts.append(map_leaves(lambda x: x * s, self.swing.amplitude))
        for kick in self.kicks:
            now = where(kick.step == step, kick.step * 0.0 + 1.0 / period, kick.step * 0.0)
            parts.append(map_leaves(lambda x, now=now: x * now, kick.impulse))
        return _total(parts) if parts else None


def draw(conditions: Conditions, base: Body, steps: int, number: Field,
         random: Callable[[int], Random]) -> Case:
    """One episode's case.

    Args:
        conditions: distributions.
        base: the body that factors apply to.
        steps: control periods of an episode.
        number: of the episode.
        random: gives the random numbers of a stream.
    """
    if conditions.others:
        conditions = conditions.met(random(17).unit())
    body = _body(conditions, base, random(1), random(2))
    return Case(
        number,
        body,
        _fault(conditions, body, random(3)),
        _lag(conditions, random(4)),
        _hold(conditions, random(5)),
        _push(conditions.disturbances.force, conditions.disturbances.torque, random(6)),
        _swing(conditions, random(7)),
        tuple(_kick(conditions, steps, random(8 + k)) for k in range(conditions.disturbances.kicks)),
        _sensors(conditions, random(16)),
    )


def _body(conditions: Conditions, base: Body, random: Random, thrusters: Random) -> Body:
    body, given = conditions.body, conditions.thrusters
    mass, inertia = random.within(body.mass), random.within(body.inertia)
    pressure, droop = random.within(given.pressure), random.within(given.droop or 0.0)
    # Equal moments stay one and the same field, so that spins are known to have no gyroscopic part.
    scaled = {x: x * inertia if x != 0.0 else x for x in base.inertia}
    centre, gain = base.centre, base.gain
    if largest(body.centre) > 0.0:
        offset = random.vector(body.centre).columns()
        centre = tuple(c + o for c, o in zip(centre, offset, strict=True))
    if (given.thrust, given.pressure) != (1.0, 1.0):
        gain = tuple(g * (thrusters.within(given.thrust) * pressure) for g in gain)
    return Body(base.mass * mass, tuple(scaled[x] for x in base.inertia), centre, gain, base.leak,
                base.droop if given.droop is None else droop)


def _fault(conditions: Conditions, body: Body, random: Random) -> Fault | None:
    """Slots of failing thrusters: the second takes its place among the others. These stay as they are."""
    given, thrusters = conditions.faults, len(body.gain)
    if largest(given.count) < 1:
        return None
    count, begins = random.whole(given.count), random.within(given.time)
    places = [floor(random.unit() * float(thrusters - k)) for k in range(int(largest(given.count)))]
    if len(places) == 2:
        places[1] = places[1] + where(places[1] >= places[0], places[1] * 0.0 + 1.0, places[1] * 0.0)
    gain, leak = list(body.gain), list(body.leak)
    for slot, place in enumerate(places):
        fault_gain, fault_leak = _failure(given.kinds, random.unit(), random.within(given.share))
        for i in range(thrusters):
            hit = (place == float(i)) & (count > float(slot))
            gain[i] = where(hit, fault_gain * body.gain[i], gain[i])
            leak[i] = where(hit, fault_leak * body.gain[i], leak[i])
    return Fault(begins, tuple(gain), tuple(leak))


def _failure(kinds: Sequence[FaultKind], chance: Field, share: Field) -> tuple[Field, Field]:
    """Gain and leak of a kind that a number in [0, 1) chooses."""
    none, one = chance * 0.0, chance * 0.0 + 1.0
    of: dict[FaultKind, tuple[Field, Field]] = {
        "dead": (none, none), "stuck-open": (none, one), "stuck": (none, share), "weak": (share, none)}
    gain, leak = of[kinds[0]]
    for k, kind in enumerate(kinds[1:], 1):
        later = chance >= k / len(kinds)
        gain, leak = where(later, of[kind][0], gain), where(later, of[kind][1], leak)
    return gain, leak


def _lag(conditions: Conditions, random: Random) -> Lag | None:
    given = conditions.thrusters
    if conditions.lasting == 0.0:
        return None
    latency = random.within(given.latency) + random.within(given.command_delay)
    ramps = largest(given.rise) > 0.0 or largest(given.fall or 0.0) > 0.0
    rise = random.within(given.rise) if ramps else None
    return Lag(latency, rise, None if given.fall is None else random.within(given.fall))


def _hold(conditions: Conditions, random: Random) -> Hold | None:
    on, off = conditions.thrusters.least_on, conditions.thrusters.least_off
    return Hold(random.within(on), random.within(off)) if largest(on) > 0 or largest(off) > 0 else None


def _push(force: Range, torque: Range, random: Random) -> Wrench | None:
    if largest(force) == 0.0 and largest(torque) == 0.0:
        return None
    return Wrench(random.vector(force), random.turn(torque))


def _swing(conditions: Conditions, random: Random) -> Swing | None:
    given = conditions.disturbances
    amplitude = _push(given.slow_force, given.slow_torque, random)
    if amplitude is None:
        return None
    return Swing(amplitude, math.tau / random.within(given.slow_period), random.uniform(0.0, math.tau))


def _kick(conditions: Conditions, steps: int, random: Random) -> Kick:
    given = conditions.disturbances
    return Kick(floor(random.unit() * float(steps)),
                Wrench(random.vector(given.kick), random.turn(given.kick_spin)))


def _sensors(conditions: Conditions, random: Random) -> Sensors | None:
    given, sensors = conditions.sensors, conditions.sensors.each()
    off = SensorConditions()

    def drawn(name: str, draw: Callable[[int, Range], Any]) -> tuple[Any, ...] | None:
        if all(getattr(sensor, name) == getattr(off, name) for sensor in sensors):
            return None
        return tuple(draw(k, getattr(sensor, name)) for k, sensor in enumerate(sensors))

    result = Sensors(
        random.whole(given.delay),
        drawn("noise", lambda _, values: random.within(values)),
        drawn("bias", lambda k, values: (random.vector if k in (0, 2) else random.turn)(values)),
        drawn("dropout", lambda _, values: random.within(values)))
    return result if largest(given.delay) >= 1 or len(leaves(result)) > 1 else None


def reading(state: State, sensors: Sensors, random: Callable[[int], Random], last: State | None) -> State:
    """What sensors tell of a state.

    Args:
        state: the true one, as old as readings are.
        sensors: what is wrong with them.
        random: gives the random numbers of a quantity in this control period.
        last: the reading before, which stands where one drops out; None: there was none.
    """
    streams = [random(k) for k in range(4)]
    p, attitude, v, w = state.p, state.attitude, state.v, state.w
    for errors in (sensors.bias, _noise(state, sensors, streams)):
        if errors is not None:
            p, attitude, v, w = p + errors[0], _turned(attitude, errors[1]), v + errors[2], w + errors[3]
    seen = type(state)(p, attitude, v, w)
    if last is None or sensors.dropout is None:
        return seen
    lost = [stream.unit() < chance for stream, chance in zip(streams, sensors.dropout, strict=True)]
    parts = ((getattr(seen, name), getattr(last, name), gone)
             for name, gone in zip(("p", "attitude", "v", "w"), lost, strict=True))
    return type(state)(*(map_leaves(lambda new, old, gone=gone: where(gone, old, new), new, old)
                         for new, old, gone in parts))


def _noise(state: State, sensors: Sensors, streams: Sequence[Random]) -> list[Any] | None:
    """One vector, or planar turn, for each quantity."""
    if sensors.noise is None:
        return None
    alike = state.p, state.w, state.v, state.w
    return [map_leaves(lambda _, sigma=sigma, r=stream: sigma * r.normal(), like)
            for like, sigma, stream in zip(alike, sensors.noise, streams, strict=True)]


def _turned(attitude: Any, turn: Any) -> Any:
    """An attitude after a turn in its own frame: an angle, or a rotation vector."""
    if isinstance(attitude, Heading):
        return Heading(attitude.angle + turn)
    return attitude.times(exponential(turn))


def _total(wrenches: Sequence[Wrench]) -> Wrench:
    return reduce(lambda a, b: map_leaves(operator.add, a, b), wrenches)
