"""How one episode's case is drawn from its conditions, written over fields.

Every effect draws from a stream of its own, so that switching one on changes no other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rans.errors import ConfigError, brief
from rans.model.body import Body
from rans.model.case import Case, Fault, Hold, Kick, Swing
from rans.model.conditions import (
    Conditions,
    FaultConditions,
    FaultKind,
    Range,
    bounds,
    largest,
    piecewise,
)
from rans.model.dynamics import Wrench
from rans.model.faults import sets_among
from rans.model.fields import Field, floor, where
from rans.model.random import Draws, Random
from rans.model.sensors import drawn_sensors
from rans.model.spacecraft import Spacecraft
from rans.model.valves import Lag


def examples(conditions: Conditions, craft: Spacecraft, steps: int) -> Case:
    """What the first 1,024 episodes of so many steps draw under the seed 0: arrays (1024,).

    Raises:
        ConfigError: conditions are none, or not for the craft's valves.
    """
    if not isinstance(conditions, Conditions):
        raise ConfigError(f"conditions must be rans.load_conditions(...), got {brief(conditions)}.")
    conditions.check_valves(craft)
    numbers = np.arange(1024, dtype=np.int32)
    return draw(conditions, craft, Body.of(craft), steps, numbers, Draws(0, 0, numbers, 0, np.float64))


def draw(conditions: Conditions, craft: Spacecraft, base: Body, steps: int, number: Field,
         draws: Draws) -> Case:
    """One episode's case.

    Args:
        conditions: distributions.
        craft: whose thrusters fail.
        base: the body that factors apply to.
        steps: control periods of an episode.
        number: of the episode.
        draws: random numbers.
    """
    def random(stream: int) -> Random:
        return draws.random(craft.dimension, number, stream * 256)

    if conditions.others:
        conditions = conditions.met(random(17).unit())
    body = _body(conditions, base, random(1), random(2))
    return Case(
        number,
        body,
        _fault(conditions, craft, body, random(3)),
        _lag(conditions, random(4)),
        _hold(conditions, random(5)),
        _push(conditions.disturbances.force, conditions.disturbances.torque, random(6)),
        _swing(conditions, random(7)),
        tuple(_kick(conditions, steps, random(8 + k)) for k in range(conditions.disturbances.kicks)),
        drawn_sensors(conditions.sensors, random(16)),
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


def _fault(conditions: Conditions, craft: Spacecraft, body: Body, random: Random) -> Fault | None:
    """What failing thrusters do; the others stay as they are."""
    given, thrusters = conditions.faults, len(body.gain)
    if largest(given.count) < 1:
        return None
    count, begins = random.whole(given.count), random.within(given.time)
    lost = (_scattered(given, thrusters, random) if given.among == "any" else
            _alike(given, craft, count, random))
    gain, leak = list(body.gain), list(body.leak)
    for slot, (place, (fault_gain, fault_leak)) in enumerate(lost):
        for i in range(thrusters):
            hit = (place == float(i)) & (count > float(slot))
            gain[i] = where(hit, fault_gain * body.gain[i], gain[i])
            leak[i] = where(hit, fault_leak * body.gain[i], leak[i])
    return Fault(begins, tuple(gain), tuple(leak))


Lost = list[tuple[Field, tuple[Field, Field]]]
"""Thrusters by number, with the gain and leak that they have left."""


def _scattered(given: FaultConditions, thrusters: int, random: Random) -> Lost:
    """Any: the second takes its place among the others."""
    places = [floor(random.unit() * float(thrusters - k)) for k in range(int(largest(given.count)))]
    if len(places) == 2:
        places[1] = places[1] + where(places[1] >= places[0], places[1] * 0.0 + 1.0, places[1] * 0.0)
    return [(place, _failure(given.kinds, random.unit(), random.within(given.share))) for place in places]


def _alike(given: FaultConditions, craft: Spacecraft, count: Field, random: Random) -> Lost:
    """A set that is recoverable, or one that is not; all of it fails in one way."""
    chance, share, which = random.unit(), random.within(given.share), random.unit()
    failure, (least, most) = _failure(given.kinds, chance, share), bounds(given.count)
    places = _places(given, craft, int(most), chance, which)
    if least < 2 <= most:
        alone, = _places(given, craft, 1, chance, which)
        places = where(count > 1.0, places[0], alone), places[1]
    return [(place, failure) for place in places]


def _places(given: FaultConditions, craft: Spacecraft, count: int, chance: Field,
            which: Field) -> tuple[Field, ...]:
    """The thrusters of a set of so many, of the kind that ``chance`` chooses."""
    found: dict[tuple[tuple[int, ...], ...], tuple[Field, ...]] = {}
    result: tuple[Field, ...] = ()
    for k, kind in enumerate(given.kinds):
        sets = sets_among(craft, count, kind, bounds(given.share), given.among == "recoverable")
        new = found.setdefault(sets, _member(sets, which))
        result = new if k == 0 or new is result else tuple(
            where(chance >= k / len(given.kinds), a, b) for a, b in zip(new, result, strict=True))
    return result


def _member(sets: Sequence[tuple[int, ...]], which: Field) -> tuple[Field, ...]:
    """One of these sets, each as likely as the next.

    Their last thrusters mostly rise by one from set to set: what is looked up is where they do not.
    """
    k, ends = floor(which * float(len(sets))), range(1, len(sets))
    *first, last = ([float(x) for x in column] for column in zip(*sets, strict=True))
    rise = [x - at for at, x in enumerate(last)]
    return *(piecewise(column, ends, k) for column in first), piecewise(rise, ends, k) + k


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
