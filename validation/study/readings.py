"""What sensors tell, against what docs/conditions.md declares: noise, biases, delays, dropouts and outages.

Drake's flights are told by the same code as ours, so that only statistics of what was told can judge it.
Attitudes are compared with SciPy's rotations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rans.flight import fly
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.randomization.conditions import Conditions, SensorConditions, SensorsConditions
from rans.scenario import draws, scenarios
from validation.study.chance import (
    all_pairs,
    even_check,
    independence_check,
    normal_check,
    share_check,
    uniform_check,
)
from validation.study.checks import Check
from validation.study.sampling import ENDLESS, Restless, any_spin

_FLIGHTS = 64
_PERIODS = 40
"""Length of flights for statistics; others are of `_FEW`."""
_FEW = 8
_QUANTITIES = ("position", "attitude", "velocity", "spin")
_NOISE = (0.02, 0.01, 0.03, 0.04)
"""Of each quantity, in its unit; all differ, so that none stands in for another."""
_BIASES = ((0.1, 0.2), (0.02, 0.04), (0.3, 0.5), (0.6, 0.9))
_DROPOUTS = (0.3, 0.2, 0.4, 0.1)
_LAGS = (1, 2, 3)
"""Control periods between which noise must not repeat."""

Vectors = list[np.ndarray]
"""Of position, attitude, velocity and spin, each (T, N, components)."""


class Told(NamedTuple):
    """What a flight's controller was told before each of T control periods, beside the truth."""

    readings: Vectors
    """Attitudes as headings, (T, N, 1), or quaternions with the scalar last, (T, N, 4)."""
    truth: Vectors


def reading_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Each effect of sensors alone, then noise and dropouts together."""
    yield from _noise_checks(craft, seed)
    yield from _bias_checks(craft, seed)
    yield from _dropout_checks(craft, seed)
    yield from _outage_checks(craft, seed)
    yield from _delay_checks(craft, seed)


def _noise_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Normal, of the declared size, new in every component, period and episode."""
    errors = _errors(_told(craft, _sensors("noise", _NOISE), seed))
    for name, error, deviation in zip(_QUANTITIES, errors, _NOISE, strict=True):
        yield normal_check(f"readings: noise of {name}", error, deviation)
    columns = {
        f"{name} {k}": error[:, :, k]
        for name, error in zip(_QUANTITIES, errors, strict=True)
        for k in range(error.shape[2])
    }
    yield independence_check("readings: noise of different components", all_pairs(columns))
    later = {
        f"{one}, {lag} periods before {other}": (columns[one][:-lag], columns[other][lag:])
        for lag in _LAGS
        for one in columns
        for other in columns
    }
    yield independence_check("readings: noise of different periods", later)
    beside = {
        f"{one}, the episode before {other}": (columns[one][:, :-1], columns[other][:, 1:])
        for one in columns
        for other in columns
    }
    yield independence_check("readings: noise of different episodes", beside)


def _bias_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Steady while the craft turns: of an attitude about axes of the body."""
    errors = _errors(_told(craft, _sensors("bias", _BIASES), seed, _FEW))
    sizes = {
        name: (np.linalg.norm(error[0], axis=-1), *bounds)
        for name, error, bounds in zip(_QUANTITIES, errors, _BIASES, strict=True)
    }
    yield uniform_check("readings: size of biases", sizes)
    drift = [float(np.abs(error - error[:1]).max()) for error in errors]
    yield Check(
        "readings: change of a bias",
        max(drift),
        1e-12,
        "SI",
        "An error is steady; rounding of readings of some metres and radians.",
        _QUANTITIES[int(np.argmax(drift))],
    )


def _dropout_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Whole readings are lost as often as declared, and the last one stands until a new one comes."""
    position, attitude, velocity, spin = (
        SensorConditions(noise=noise, dropout=dropout)
        for noise, dropout in zip(_NOISE, _DROPOUTS, strict=True)
    )
    told = _told(craft, SensorsConditions(position, attitude, velocity, spin), seed)
    errors = _errors(told)
    lost: dict[str, np.ndarray] = {}
    for k, name in enumerate(_QUANTITIES):
        repeated = told.readings[k][1:] == told.readings[k][:-1]
        gone = repeated.all(axis=-1)
        lost[name] = gone.astype(float)
        yield share_check(f"readings: dropouts of {name}", gone, _DROPOUTS[k])
        # What is not repeated is a reading of this period, with the noise of a new one.
        yield normal_check(f"readings: {name} after a dropout", errors[k][1:][~gone], _NOISE[k])
    pairs = {
        f"{one}, {lag} periods before {other}": (lost[one][:-lag], lost[other][lag:])
        for lag in _LAGS
        for one in lost
        for other in lost
    }
    yield independence_check("readings: dropouts of different periods", pairs | all_pairs(lost))


def _outage_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Everything stands for 1 s in every 5 s: for five control periods of any 25 in a row."""
    position, attitude, velocity, spin = (SensorConditions(noise=noise) for noise in _NOISE)
    sensors = SensorsConditions(position, attitude, velocity, spin, outage=1.0)
    told = _told(craft, sensors, seed)
    stands = np.stack([(part[1:] == part[:-1]).all(axis=-1) for part in told.readings])
    windows = np.lib.stride_tricks.sliding_window_view(stands, 25, axis=1).sum(axis=-1)
    yield Check(
        "readings: control periods of an outage",
        float(np.abs(windows - 5).max()),
        0.0,
        "periods",
        "1 s of 5 s are 5 of 25 control periods of 0.2 s, of each quantity.",
    )
    alone = np.count_nonzero(stands.any(axis=0) & ~stands.all(axis=0))
    yield Check(
        "readings: quantities that stop alone",
        float(alone),
        0.0,
        "periods",
        "All sensors stop together.",
    )
    starts = np.argmax(stands[0, 1:26] & ~stands[0, :25], axis=0)
    yield even_check("readings: first outage", starts, 25)


def _delay_checks(craft: Spacecraft, seed: int) -> Iterator[Check]:
    """Readings are two control periods old; before there were so many, they are of the start."""
    told = _told(craft, SensorsConditions(delay=2.0), seed, _FEW)
    apart = 0.0
    for reading, truth in zip(told.readings, told.truth, strict=True):
        late = np.concatenate([truth[:1], truth[:1], truth[:-2]])
        apart = max(apart, float(np.abs(reading - late).max()))
    yield Check(
        "readings: two control periods old",
        apart,
        0.0,
        "SI",
        "A late reading is the very state of that moment.",
    )


def _sensors(what: str, sizes: Sequence[Any]) -> SensorsConditions:
    """So much of it in position, attitude, velocity and spin."""
    position, attitude, velocity, spin = (SensorConditions(**{what: size}) for size in sizes)
    return SensorsConditions(position, attitude, velocity, spin)


def _told(
    craft: Spacecraft, sensors: SensorsConditions, seed: int, periods: int = _PERIODS
) -> Told:
    """Flights that move and turn, told through these sensors."""
    starts = scenarios(ENDLESS, craft, seed, _FLIGHTS)
    pilot = _Listening(craft, seed)
    with any_spin():
        flight = fly(
            craft,
            ENDLESS,
            pilot,
            starts,
            Timing(episode_steps=periods),
            conditions=Conditions(sensors=sensors),
            draws=draws(seed, _FLIGHTS),
        )
    readings = [_vectors(state) for state in pilot.told]
    truth = [part[:-1] for part in _vectors(flight.states)]
    return Told([np.stack(part) for part in zip(*readings, strict=True)], truth)


class _Listening(Restless):
    """Keeps what it was told."""

    def __copy__(self) -> Any:
        """Itself: what it keeps is read after the flight."""
        return self

    def reset(self, count: int) -> None:
        """Forget the last flight."""
        self.told: list[Any] = []

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        self.told.append(state)
        return super().act(state, goal, observation)


def _vectors(state: Any) -> Vectors:
    attitude = state.attitude
    turned = (
        (attitude.angle,)
        if hasattr(attitude, "angle")
        else (attitude.x, attitude.y, attitude.z, attitude.w)
    )
    return [
        np.stack(columns, axis=-1)
        for columns in (state.p.columns(), turned, state.v.columns(), state.spin())
    ]


def _errors(told: Told) -> Vectors:
    """Readings less the truth; of an attitude in space the rotation vector in B."""
    found = [reading - truth for reading, truth in zip(told.readings, told.truth, strict=True)]
    if told.truth[1].shape[-1] == 4:
        true, read = (Rotation.from_quat(x[1].reshape(-1, 4)) for x in (told.truth, told.readings))
        found[1] = (true.inv() * read).as_rotvec().reshape(found[0].shape)
    return found
