"""When what an episode has drawn begins to act, and what it amounts to, by the laws of momentum.

Drake is told in each control period what pushes and which thrusters have failed, by the code that tells our
engine. Here it is the motion that says when that was: momentum gained is force times time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rans.episode.flight import Flight, fly
from rans.episode.scenario import draws, scenarios
from rans.episode.step import Setup, World
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import (
    Conditions,
    DisturbanceConditions,
    FaultConditions,
    ThrusterConditions,
)
from validation.study.checks import NO_THRUSTERS, Check, Skipped
from validation.study.sampling import ENDLESS, any_spin, moments

_FLIGHTS = 16
_PERIOD = 0.2
"""Control period, s."""
_EXACT = "Nothing else pushes: rounding of sums."


class Told:
    """Opens the first thruster in the control periods that it is given, all others stay shut."""

    name = "told"

    def __init__(self, craft: Spacecraft, *periods: int) -> None:
        self._thrusters = len(craft.commands)
        self._periods = periods

    def reset(self, count: int) -> None:
        """N new episodes start."""
        self._count = count
        self._period = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller`."""
        command = np.zeros((self._count, self._thrusters))
        command[:, 0] = float(self._period in self._periods)
        self._period += 1
        return command


def onset_checks(craft: Spacecraft, seed: int) -> Iterator[Check | Skipped]:
    """Faults, pushes, swings, kicks and late valves."""
    yield from _steady_checks(craft, seed)
    yield _swing_check(craft, seed)
    yield from _kick_checks(craft, seed)
    if not craft.thrusters:
        yield Skipped("onsets: faults and late valves", NO_THRUSTERS)
        return
    yield _fault_check(craft, seed)
    yield _latency_check(craft, seed)
    if not craft.actuators.is_continuous:
        yield _least_time_check(craft, seed)


def _fault_check(craft: Spacecraft, seed: int) -> Check:
    """A thruster that sticks open at 2 s pushes from the eleventh control period on, and in every later one.

    The moment is the end of a period, so that whether faults wait for one plays no part.
    """
    stuck = FaultConditions(count=1.0, kinds=("stuck-open",), time=2.0)
    flight = _flown(craft, Conditions(faults=stuck), Told(craft), seed, 14)
    return _pushed_check("onsets: a fault at 2 s", flight, range(10, 14))


def _steady_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Momentum F t and way F t^2 / 2m from the start on; angular momentum of a torque likewise.

    The force gives 0.02 m/s^2, the torque at most 0.01 rad/s^2.
    """
    force = 0.02 * craft.mass
    torque = 0.01 * float(np.linalg.eigvalsh(moments(craft)).min())
    push = DisturbanceConditions(force=force, torque=torque)
    flight = _flown(craft, Conditions(disturbances=push), Told(craft), seed, 20)
    time = flight.times[:, None]
    speed = np.linalg.norm(_velocity(flight), axis=-1)
    way = np.linalg.norm(_columns(flight.states.p) - _columns(flight.states.p)[:1], axis=-1)
    turning = np.linalg.norm(np.stack(flight.states.spin(), axis=-1) @ moments(craft), axis=-1)
    yield _largest("onsets: speed of a steady force", speed - 0.02 * time, 1e-12, "m/s", _EXACT)
    yield _largest("onsets: way of a steady force", way - 0.5 * 0.02 * time**2, 1e-12, "m", _EXACT)
    yield _largest(
        "onsets: angular momentum of a steady torque",
        turning / torque - time,
        1e-7,
        "s",
        "Over the torque: the time since it began. In space truncation of the attitude.",
    )


def _swing_check(craft: Spacecraft, seed: int) -> Check:
    """Momentum is the integral of A sin(rate t + phase), of the rate, phase and amplitude that were drawn."""
    force = 0.05 * craft.mass
    swing = Conditions(disturbances=DisturbanceConditions(slow_force=force))
    drawn = _begun(craft, swing, seed, _FLIGHTS).parameters.swing
    flight = _flown(craft, swing, Told(craft), seed, 20)
    rate = drawn.rate
    gained = (np.cos(drawn.phase) - np.cos(rate * flight.times[:, None] + drawn.phase)) / rate
    expected = np.stack([x * gained for x in drawn.amplitude.force.columns()], axis=-1)
    apart = np.linalg.norm(craft.mass * _velocity(flight) - expected, axis=-1) * rate / force
    return _largest(
        "onsets: momentum of a swinging force",
        apart,
        5e-3,
        "relative",
        "A sine taken at the middle of each period, of 5 s or longer: (rate * 0.2 s)^2 / 24 of twice the swing; "
        "a period early or late is 0.05 or more.",
    )


def _kick_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Each comes once in the episode, and gives its impulse."""
    kick = DisturbanceConditions(kick=(0.02 * craft.mass, 0.04 * craft.mass))
    flight = _flown(craft, Conditions(disturbances=kick), Told(craft), seed, 25)
    gained = np.linalg.norm(np.diff(_velocity(flight), axis=0), axis=-1)
    yield _largest(
        "onsets: kicks of an episode less one",
        (gained > 1e-9).sum(axis=0) - 1.0,
        0.0,
        "-",
        "Conditions ask for one.",
    )
    beyond = np.abs(gained.sum(axis=0) - 0.03) - 0.01
    yield _largest(
        "onsets: speed of a kick beyond 0.02 to 0.04",
        np.maximum(beyond, 0.0),
        1e-12,
        "m/s",
        _EXACT,
    )


def _latency_check(craft: Spacecraft, seed: int) -> Check:
    """Told to open from 1.0 to 1.2 s, with a latency of 0.3 s it pushes from 1.3 to 1.5 s."""
    late = Conditions(thrusters=ThrusterConditions(latency=0.2, command_delay=0.1))
    flight = _flown(craft, late, Told(craft, 5), seed, 12)
    return _pushed_check("onsets: a valve 0.3 s late", flight, (6, 7))


def _least_time_check(craft: Spacecraft, seed: int) -> Check:
    """Of 0.2 s each: open for 0.5 s at least is three periods."""
    open_long = Conditions(thrusters=ThrusterConditions(least_on=0.5))
    return _pushed_check(
        "onsets: open for 0.5 s at least",
        _flown(craft, open_long, Told(craft, 2), seed, 8),
        (2, 3, 4),
    )


def _pushed_check(name: str, flight: Flight, periods: Any) -> Check:
    """In which control periods the velocity changes; a period that should not, or does not, is wrong."""
    weakest = (
        min(thruster.force for thruster in flight.craft.thrusters) * _PERIOD / flight.craft.mass
    )
    pushed = np.linalg.norm(np.diff(_velocity(flight), axis=0), axis=-1) > 1e-3 * weakest
    expected = np.isin(np.arange(len(pushed)), list(periods))
    wrong = pushed != expected[:, None]
    return _largest(
        name, wrong.sum(axis=0), 0.0, "periods", "Each control period is pushed, or is not."
    )


def _largest(name: str, values: Any, tolerance: float, unit: str, reason: str) -> Check:
    """Of an array whose last axis is that of flights."""
    values = np.abs(np.asarray(values, dtype=float))
    number = int(np.argmax(values.reshape(-1, values.shape[-1]).max(axis=0)))
    return Check(name, float(values.max()), tolerance, unit, reason, f"flight {number}")


def _begun(craft: Spacecraft, conditions: Conditions, seed: int, count: int) -> Any:
    starts = scenarios(ENDLESS, craft, seed, count)
    return World(Setup(craft, ENDLESS, conditions=conditions)).begin(
        starts.start, starts.goal, 0, draws(seed, count)
    )


def _flown(
    craft: Spacecraft,
    conditions: Conditions,
    pilot: Told,
    seed: int,
    steps: int,
) -> Flight:
    """From rest."""
    timing = Timing(control_period=_PERIOD, episode_steps=steps)
    with any_spin():
        return fly(
            craft,
            ENDLESS,
            pilot,
            scenarios(ENDLESS, craft, seed, _FLIGHTS),
            timing,
            conditions=conditions,
            draws=draws(seed, _FLIGHTS),
        )


def _columns(vector: Any) -> np.ndarray:
    return np.stack(vector.columns(), axis=-1)


def _velocity(flight: Flight) -> np.ndarray:
    """(T + 1, N, 2 or 3) m/s."""
    return _columns(flight.states.v)
