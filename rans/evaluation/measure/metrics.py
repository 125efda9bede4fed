"""What is measured on every single episode; `rans.evaluation.measure.aggregate` makes statistics of it.

"Steps" are the T states that follow the commands; the start is nobody's merit and is left out. The
"last fifth" is the last T/5 of them, rounded down but at least one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from rans import verdict
from rans.flight import Flight
from rans.model.accuracy import fastest
from rans.model.dynamics import thrust
from rans.tasks.goal_set import REST_SPEED, REST_SPIN, arrived, asks_rest
from rans.tasks.quantities import QUANTITIES, Quantity

_STAY = 7.5
"""Margin of "stay" over the threshold of a quantity."""
_TRANSIENT = 5.0
"""Time that tracking tasks are given to get up to speed before their errors count, s."""


class Sample(NamedTuple):
    """What one metric is made of."""

    group: str
    """Heading under which it belongs."""
    name: str
    meaning: str
    """Equal for metrics that differ in the bound in their name only: tables show them in one line."""
    unit: str
    values: np.ndarray
    """(N,), one per episode; truth values where the metric is the share of episodes of which it is true."""
    centre: Callable[..., Any] = np.mean

    @property
    def numbers(self) -> np.ndarray:
        """(N,) values in the metric's unit."""
        return 100.0 * self.values if self.values.dtype == bool else self.values


def samples(flight: Flight) -> Iterator[Sample]:
    """Everything that is measured on a flight of any task."""
    yield from _success(flight)
    if asks_rest(flight.task):
        yield from _rest(flight)
    yield from _held(flight)
    for quantity, error in flight.errors().items():
        yield from _accuracy(flight, quantity, error)
    yield from _motion(flight)
    yield from _effort(flight)
    if flight.guarded is not None:
        yield from _guarding(flight)


def settling_times(flight: Flight) -> np.ndarray:
    """Time at which each episode settled, (N,) s; infinite if it did not (`rans.verdict`)."""
    result = flight.verdict
    return np.where(result.settles, result.settled * flight.timing.control_period, np.inf)


def in_goal_set(flight: Flight) -> np.ndarray:
    """Whether each episode is in the goal set (`rans.tasks.goal_set.arrived`), (T + 1, N) at every instant."""
    return arrived(flight.task, flight.states, flight.goals)


def arrival_times(flight: Flight) -> np.ndarray:
    """First instant at which each episode is in the goal set, (N,) s; infinite if there is none.

    Nothing is said of later instants: `staying_times` asks for these too.
    """
    inside = in_goal_set(flight)
    first = inside.argmax(axis=0) * flight.timing.control_period
    return np.where(inside.any(axis=0), first, np.inf)


def staying_times(flight: Flight) -> np.ndarray:
    """Instant from which each episode is in the goal set at every later instant, (N,) s.

    Infinite if the episode fails, or is outside at its last instant.
    """
    inside = in_goal_set(flight)
    outside_until_end = np.logical_or.accumulate(~inside[::-1], axis=0)[::-1]
    since = outside_until_end.sum(axis=0) * flight.timing.control_period
    return np.where(inside[-1] & ~flight.failed(), since, np.inf)


def on_times(flight: Flight) -> np.ndarray:
    """Summed time the thrusters of each episode were open, (N,) thruster-seconds."""
    return flight.openings.sum(axis=(0, 2)) * flight.timing.control_period


def impulses(flight: Flight) -> np.ndarray:
    """Thrust spent by each episode, force times time summed over thrusters, (N,) N s."""
    return forces(flight).sum(axis=0) * flight.timing.control_period


def forces(flight: Flight) -> np.ndarray:
    """Forces of all thrusters of each episode in every control period, added up, (T, N) N."""
    shares = thrust(flight.craft, tuple(np.moveaxis(flight.commands, 2, 0)))
    return np.sum(
        [share * t.force for share, t in zip(shares, flight.craft.thrusters, strict=True)], axis=0
    )


def final_errors(flight: Flight) -> dict[str, np.ndarray]:
    """Mean error of each episode over its last fifth, each (N,), SI units."""
    return {name: last_fifth(error).mean(axis=0) for name, error in flight.errors().items()}


def worst_errors(flight: Flight) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The largest error of the last fifth in tolerances, (N,), and the largest of each, (N,) SI units.

    Infinite where a state is lost; of errors that have a tolerance.
    """
    result = flight.errors()
    bounds = flight.task.tolerances()
    worst = {
        name: np.nan_to_num(last_fifth(result[name]).max(axis=0), nan=np.inf) for name in bounds
    }
    return reduce(np.maximum, [worst[name] / bounds[name] for name in bounds]), worst


def returns(flight: Flight) -> np.ndarray:
    """Sum of the task's rewards of each full episode, (N,)."""
    return np.sum(list(flight.rewards().values()), axis=(0, 1))


def solved(flight: Flight) -> np.ndarray:
    """(N,) whether each episode was solved (`rans.verdict`)."""
    return np.asarray(flight.verdict.solved)


def last_fifth(instants: np.ndarray) -> np.ndarray:
    """The last fifth of an array whose first axis is the T + 1 instants, the start included."""
    return instants[-verdict.last_fifth(len(instants) - 1) :]


def _success(flight: Flight) -> Iterator[Sample]:
    means = final_errors(flight)
    settling = settling_times(flight)
    mean = np.all([means[name] < bound for name, bound in flight.task.tolerances().items()], axis=0)
    for name, meaning, inside in (
        ("solved", "within all tolerances at every step of the last fifth", solved(flight)),
        ("solved in the mean", "mean errors of the last fifth within tolerances", mean),
        ("settled", "enters all tolerances and stays", np.isfinite(settling)),
    ):
        yield Sample("success", name, meaning, "%", inside)
    yield Sample(
        "success", "settling time", "median time to enter and stay", "s", settling, np.median
    )
    yield Sample(
        "success", "failed", "declared failed by the task at any time", "%", flight.failed()
    )


def _rest(flight: Flight) -> Iterator[Sample]:
    """Of tasks with a place or an attitude to keep; of others arriving for good is settling."""
    slow = f"{100.0 * REST_SPEED:g} cm/s, {math.degrees(REST_SPIN):g} deg/s"
    first = arrival_times(flight)
    staying = staying_times(flight)
    yield Sample(
        "success",
        "first at rest",
        f"median first time within all tolerances and {slow}",
        "s",
        first,
        np.median,
    )
    yield Sample(
        "success",
        "at rest for good",
        "within all of these from then on, at every instant",
        "%",
        np.isfinite(staying) & (staying == first),
    )
    yield Sample(
        "success",
        "time at rest for good",
        "median time from which that is so, be it later",
        "s",
        staying,
        np.median,
    )


def _held(flight: Flight) -> Iterator[Sample]:
    """Like "solved", with other bounds than the task's tolerances."""
    ends = {
        name: QUANTITIES[name].display_factor * last_fifth(error)
        for name, error in flight.errors().items()
        if name in flight.task.tolerances() and QUANTITIES[name].held
    }
    for grade in range(3 if ends else 0):
        inside = np.all(
            [(end < QUANTITIES[name].held[grade]).all(axis=0) for name, end in ends.items()], axis=0
        )
        bounds = " ".join(
            f"{one.held[grade]} {one.display_unit}" for one in map(QUANTITIES.__getitem__, ends)
        )
        yield Sample(
            "success",
            f"held {bounds}",
            "within so much at every step of the last fifth",
            "%",
            inside,
        )


def _accuracy(flight: Flight, quantity: str, error: np.ndarray) -> Iterator[Sample]:
    declared = QUANTITIES[quantity]
    factor, unit = declared.display
    after = error[1:]
    short, bounds = declared.time_within
    for bound in bounds:
        yield Sample(
            quantity,
            f"{short}{bound}",
            f"time steps with {quantity} error below so many {unit}",
            "%",
            100.0 * (factor * after < bound).mean(axis=0),
        )
    if declared.threshold is not None:
        yield from _reached(declared, after)
    yield Sample(
        quantity,
        f"{quantity} error",
        "mean over the last fifth",
        unit,
        factor * last_fifth(error).mean(axis=0),
    )
    tracked = flight.times > _TRANSIENT
    if "position" not in flight.errors() and tracked.any():
        yield Sample(
            quantity,
            f"{quantity} error after {_TRANSIENT:g} s",
            "mean from then on",
            declared.unit,
            error[tracked].mean(axis=0),
        )


def _reached(declared: Quantity, error: np.ndarray) -> Iterator[Sample]:
    """Whether errors (T, N) ever fall below the original system's threshold, and stay near it."""
    threshold = declared.threshold
    assert threshold is not None
    whole, half, margin = declared.threshold_texts
    for bound, text in ((threshold, whole), (threshold / 2, half)):
        ever: Any = (error < bound).any(axis=0)
        yield Sample(declared.name, f"reach {text}", "ever closer than that", "%", ever)
    yield Sample(
        declared.name,
        f"stay {margin}",
        f"once closer than {whole}, never farther than that",
        "%",
        _stays(error, threshold),
    )


def _stays(error: np.ndarray, threshold: float) -> np.ndarray:
    """(N,) whether each episode gets below the threshold and from then on keeps within the margin.

    The original system also counts episodes that never got there but were always within the margin.
    """
    hit = np.logical_or.accumulate(error < threshold)
    lost = hit & (error >= _STAY * threshold)
    return np.logical_and(hit[-1], ~lost.any(axis=0))


def _motion(flight: Flight) -> Iterator[Sample]:
    speed: Any = flight.states.v.norm()
    spin: Any = np.linalg.norm(flight.states.spin(), axis=0)
    yield Sample("motion", "speed", "mean linear speed (ALV)", "m/s", speed[1:].mean(axis=0))
    yield Sample("motion", "spin", "mean angular speed (AAV)", "rad/s", spin[1:].mean(axis=0))
    yield Sample(
        "motion",
        "spin at rest",
        "the same over the last fifth",
        "rad/s",
        last_fifth(spin).mean(axis=0),
    )


def _effort(flight: Flight) -> Iterator[Sample]:
    opened = np.diff(flight.openings, axis=0, prepend=0.0).clip(min=0.0).sum(axis=(0, 2))
    last = flight.openings[-verdict.last_fifth(len(flight.commands)) :]
    for name, meaning, unit, values in (
        (
            "duty",
            "mean share of thrusters open (AAC)",
            "%",
            100.0 * flight.openings.mean(axis=(0, 2)),
        ),
        ("duty at rest", "the same over the last fifth", "%", 100.0 * last.mean(axis=(0, 2))),
        ("openings", "times a thruster opens, an episode", "", opened),
        ("on-time", "thruster-seconds an episode", "s", on_times(flight)),
        ("impulse", "thrust spent an episode", "N s", impulses(flight)),
        ("return", "sum of rewards of the full episode", "", returns(flight)),
    ):
        yield Sample("effort", name, meaning, unit, values)
    stores = flight.states.stores
    if flight.craft.propellant is not None:
        used = stores[0][0] - stores[0][-1]
        yield Sample("effort", "propellant", "used an episode", "kg", used)
    if flight.craft.wheels:
        held = stores[len(stores) - len(flight.craft.wheels) :]
        limits = [wheel.max_momentum for wheel in flight.craft.wheels]
        most = np.max([np.abs(h) / m for h, m in zip(held, limits, strict=True)], axis=(0, 1))
        meaning = "largest momentum of any wheel, of what it can hold"
        yield Sample("effort", "wheel momentum", meaning, "%", 100.0 * most)


def _guarding(flight: Flight) -> Iterator[Sample]:
    """What a safety filter did."""
    assert flight.guarded is not None
    share = 100.0 * flight.guarded.mean(axis=0)
    yield Sample("guard", "interventions", "control periods with another command", "%", share)
    ever: Any = flight.guarded.any(axis=0)
    yield Sample("guard", "guarded", "flights with an intervention", "%", ever)


def outran(flight: Flight) -> str:
    """Why the motion of a flight is not to be trusted: it span faster than its substeps are accurate for.

    Nothing if it is; `rans.model.accuracy.fastest` has the bound.
    """
    spin = float(np.nanmax(np.linalg.norm(np.array(flight.states.spin()), axis=0)))
    bound = fastest(flight.craft, flight.timing)
    if spin <= bound:
        return ""
    return (
        f"{flight.controller} spins {flight.craft.name} at up to {spin:.3g} rad/s, but its motion is "
        f"accurate up to {bound:.3g} rad/s; set timing.substeps {math.ceil(spin / bound)} times as high, "
        "or keep the agent from tumbling."
    )
