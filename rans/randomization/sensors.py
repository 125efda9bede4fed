"""Sensor model: the measured state that a policy observes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rans.model.dynamics import State
from rans.model.fields import Field, Heading, floor, leaves, map_leaves, where
from rans.model.random import Random
from rans.model.rotation import exponential
from rans.randomization.conditions import (
    Range,
    SensorConditions,
    SensorsConditions,
    largest,
)


@dataclass(frozen=True)
class Outage:
    """Periodic outages of all sensors."""

    fraction: Field
    """Duration of an outage over the time from the start of one to the start of the next."""
    rate: Field
    """Outages per second."""
    phase: Field
    """Elapsed share of the cycle at the start of the episode, 0 to 1."""

    def at(self, time: Field) -> Field:
        """Whether sensors are out at a time since the start of the episode (s)."""
        gone = time * self.rate + self.phase
        return gone - floor(gone) < self.fraction


@dataclass(frozen=True)
class Sensors:
    """Errors of the readings, each in the order of the state's fields: p, attitude, v, w."""

    delay: Field
    """Delay in control periods, a whole number."""
    noise: tuple[Field, ...] | None
    """Standard deviation of the noise of each component."""
    bias: tuple[Any, ...] | None
    """Constant errors: vectors (scalars for planar rotations); that of the attitude is a rotation vector in B."""
    dropout: tuple[Field, ...] | None
    """Probability that the last reading is kept."""
    outage: Outage | None
    """Outages of all sensors."""

    @property
    def repeats(self) -> bool:
        """Whether a reading may be kept for longer than one control period."""
        return self.dropout is not None or self.outage is not None


def draw_sensors(conditions: SensorsConditions, random: Random) -> Sensors | None:
    """Draw the sensor errors of an episode; None if readings are the true state.

    Quantities are drawn in the order p, attitude, v, w for each kind of error; recorded flights rely on it.
    """
    sensors = conditions.each()
    off = SensorConditions()

    def drawn(name: str, draw: Callable[[int, Range], Any]) -> tuple[Any, ...] | None:
        if all(getattr(sensor, name) == getattr(off, name) for sensor in sensors):
            return None
        return tuple(draw(k, getattr(sensor, name)) for k, sensor in enumerate(sensors))

    result = Sensors(
        random.whole(conditions.delay),
        drawn("noise", lambda _, values: random.within(values)),
        drawn("bias", lambda k, values: (random.vector if k in (0, 2) else random.turn)(values)),
        drawn("dropout", lambda _, values: random.within(values)),
        _draw_outage(conditions, random),
    )
    return result if largest(conditions.delay) >= 1 or len(leaves(result)) > 1 else None


def _draw_outage(conditions: SensorsConditions, random: Random) -> Outage | None:
    if largest(conditions.outage) == 0.0:
        return None
    length = random.within(conditions.outage)
    rate = 1.0 / random.within(conditions.outage_every)
    return Outage(length * rate, rate, random.unit())


PER_STEP = 2**25
"""First block of the random numbers of a step, which sensors draw; the blocks before it are those of an
episode."""


def reading(
    states: Sequence[State],
    sensors: Sensors,
    random: Callable[[int], Random],
    last: State | None,
    time: Field,
) -> State:
    """Measured state.

    Args:
        states: the true state and those before it, the newest first.
        sensors: errors of the sensors.
        random: returns the random numbers of a block in this control period.
        last: previous reading, which is kept where a reading drops out; None: there is none.
        time: time since the start of the episode, s.
    """
    stores = states[0].stores  # effectors report them without delay or error
    state = replace(states[0], stores=())
    # Each quantity's numbers: noise first, then whether it drops out.
    streams = [random(PER_STEP + quantity * 4) for quantity in range(4)]
    for age, old in enumerate(states[1:], 1):
        late = sensors.delay >= age
        state = map_leaves(lambda new, old, late=late: where(late, old, new), state, old)
    p = state.p
    attitude = state.attitude
    v = state.v
    w = state.w
    for errors in (sensors.bias, _noise(state, sensors.noise, streams)):
        if errors is not None:
            p = p + errors[0]
            attitude = _turned(attitude, errors[1])
            v = v + errors[2]
            w = w + errors[3]
    measured = type(state)(p, attitude, v, w, stores=stores)
    if last is None or not sensors.repeats:
        return measured
    stopped = None if sensors.outage is None else sensors.outage.at(time)
    if sensors.dropout is None:
        lost = [stopped] * 4
    else:
        lost = [
            stream.unit() < chance for stream, chance in zip(streams, sensors.dropout, strict=True)
        ]
        lost = lost if stopped is None else [missed | stopped for missed in lost]
    parts = (
        (getattr(measured, name), getattr(last, name), gone)
        for name, gone in zip(("p", "attitude", "v", "w"), lost, strict=True)
    )
    return type(state)(
        *(
            map_leaves(lambda new, old, gone=gone: where(gone, old, new), new, old)
            for new, old, gone in parts
        ),
        stores=stores,
    )


def _noise(
    state: State, sigmas: tuple[Field, ...] | None, streams: Sequence[Random]
) -> list[Any] | None:
    """Noise of p, attitude, v and w, SI, each of its own stream: vectors, or scalars about z; None without."""
    if sigmas is None:
        return None
    alike = state.p, state.w, state.v, state.w
    return [
        map_leaves(lambda _, sigma=sigma, r=stream: sigma * r.normal(), like)
        for like, sigma, stream in zip(alike, sigmas, streams, strict=True)
    ]


def _turned(attitude: Any, turn: Any) -> Any:
    """Attitude after a rotation in its own frame, by an angle or a rotation vector."""
    if isinstance(attitude, Heading):
        return Heading(attitude.angle + turn)
    return attitude.times(exponential(turn))
