"""Metrics of single episodes, of which `rans.evaluation.measure.aggregate` makes statistics.

"Steps" are the T states after the commands, without the start. The "last fifth" is the last T/5 of them, rounded
down but at least one. Names, units and order are those of evaluation.json and of every table
(`tests/evaluation/measure/test_aggregate.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.base.registry import Registry
from rans.episode import verdict
from rans.episode.flight import Flight
from rans.model.dynamics import mean_thrust
from rans.tasks import Task
from rans.tasks.goal_set import REST_SPEED, REST_SPIN, arrived, asks_rest
from rans.tasks.quantities import QUANTITIES, Quantity

_STAY = 7.5
"""Margin of "stay" over the threshold of a quantity."""
_TRANSIENT = 5.0
"""Time for the acceleration of tracking tasks, after which their errors count, s."""

PERCENTILES = (50.0, 90.0, 99.0, 99.7)
"""Percentages of flights of which missions' times, impulses and margins are stated: space agencies use 99.7, that
is three standard deviations of a normal distribution."""


class Sample(NamedTuple):
    """Values of one metric, an episode each."""

    group: str
    """Heading of its group in tables."""
    name: str
    meaning: str
    """Meaning; metrics with equal meanings, which differ in the bound in their name, share a line of tables."""
    unit: str
    values: np.ndarray
    """(N,), one per episode; booleans if the metric is the share of episodes of which it is true."""
    centre: Callable[..., Any] = np.mean
    key: bool = False
    """Whether short tables have it, and comparisons, if the metric is of an installed package."""

    @property
    def numbers(self) -> np.ndarray:
        """(N,) values in the metric's unit."""
        return 100.0 * self.values if self.values.dtype == bool else self.values


FURTHER: Registry[Callable[[Flight], Iterator[Sample]]] = Registry(
    "group of metrics", "rans.metrics"
)
"""Metrics that installed packages add: functions of a flight, which yield none of a flight that has none."""


def further_samples(flight: Flight) -> Iterator[Sample]:
    """Metrics of installed packages.

    Raises:
        ConfigError: one of them fails, or has no value for each episode; the message names it and its package.
    """
    for name, of in FURTHER.each():
        with FURTHER.of_package(name):
            found = [_checked(sample, flight.commands.shape[1]) for sample in of(flight)]
        yield from found


def _checked(sample: Any, episodes: int) -> Sample:
    """A metric of somebody else, with its values as an array; numbers that are not finite are values too."""
    if not isinstance(sample, Sample):
        raise ConfigError(f"it must yield objects of rans.extend.Sample, got {brief(sample)}.")
    values = np.asarray(sample.values)
    if values.shape != (episodes,) or values.dtype.kind not in "biuf":
        raise ConfigError(
            f"the metric {brief(sample.name)} must have a number or truth value for each episode, of shape "
            f"({episodes},), got shape {values.shape} of type {values.dtype}."
        )
    return sample._replace(values=values)


def samples(flight: Flight) -> Iterator[Sample]:
    """All metrics of a flight of any task, (N,) values each, in the order of the tables."""
    yield from _success(flight)
    if asks_rest(flight.task):
        yield from _goal_set(flight)
    yield from _solved_to(flight)
    for quantity, error in flight.errors().items():
        yield from _accuracy(flight, quantity, error)
    yield from further_samples(flight)
    yield from _motion(flight)
    yield from _effort(flight)
    if flight.task.can_be_won:
        yield from _percentiles(flight)
    if flight.guarded is not None:
        yield from _guarding(flight)


def settling_times(flight: Flight) -> np.ndarray:
    """Time at which each episode settled, (N,) s; infinite if it was not solved (`rans.episode.verdict`)."""
    result = flight.verdict
    return np.where(result.solved, result.settled * flight.timing.control_period, np.inf)


def in_goal_set(flight: Flight) -> np.ndarray:
    """Whether each episode is in the goal set (`rans.tasks.goal_set.arrived`), (T + 1, N) at every instant."""
    return arrived(flight.task, flight.states, flight.goals)


def arrival_times(flight: Flight) -> np.ndarray:
    """First instant at which each episode is in the goal set, (N,) s; infinite if there is none.

    The episode may leave the set later; `staying_times` excludes that.
    """
    inside = in_goal_set(flight)
    first = inside.argmax(axis=0) * flight.timing.control_period
    return np.where(inside.any(axis=0), first, np.inf)


def staying_times(flight: Flight) -> np.ndarray:
    """Instant from which each episode is in the goal set at every later instant, (N,) s.

    It is infinite if the episode fails, or is outside at its last instant.
    """
    inside = in_goal_set(flight)
    outside_until_end = np.logical_or.accumulate(~inside[::-1], axis=0)[::-1]
    since = outside_until_end.sum(axis=0) * flight.timing.control_period
    return np.where(inside[-1] & ~flight.failed(), since, np.inf)


def on_times(flight: Flight) -> np.ndarray:
    """Time that thrusters were open, summed over the thrusters of each episode, (N,) s."""
    return _opened(flight).sum(axis=(0, 2)) * flight.timing.control_period


def _opened(flight: Flight) -> np.ndarray:
    """(T, N, thrusters) share of each control period for which valves are open; of throttles the share of force."""
    commands = tuple(np.moveaxis(flight.openings, 2, 0))
    opened = flight.craft.actuators.opened(commands)
    return np.stack(opened, axis=-1) if commands else flight.openings


def valve_openings(flight: Flight) -> np.ndarray:
    """How often a valve goes from shut to open, summed over the thrusters of each episode, (N,).

    Valves are shut before the first command. A valve opens at the beginning of a control period, if at all; a pulse
    that ends within its period is followed by another opening.
    """
    actuators = flight.craft.actuators
    commands = actuators.levels(tuple(np.moveaxis(flight.openings, 2, 0)))
    if not commands:
        return np.zeros(flight.commands.shape[1])
    pieces = [np.asarray(shares) > 0.0 for _, shares in actuators.pulses(commands)]
    begins, ends = pieces[0], pieces[-1]  # (thrusters, T, N) open at both ends of each period
    begins[:, 1:] &= ~ends[:, :-1]
    return begins.sum(axis=(0, 1))


def impulses(flight: Flight) -> np.ndarray:
    """Impulse of each episode, force times time summed over thrusters, (N,) N s."""
    return forces(flight).sum(axis=0) * flight.timing.control_period


def forces(flight: Flight) -> np.ndarray:
    """Sum of the forces of all thrusters in the mean of every control period of each episode, (T, N) N.

    It is 0 after a success, where engines that cannot be shut in flight are shut too.
    """
    shares = mean_thrust(flight.craft, tuple(np.moveaxis(flight.commands, 2, 0)))
    total = np.zeros(flight.commands.shape[:2])
    for share, thruster in zip(shares, flight.craft.thrusters, strict=True):
        total = total + share * thruster.force
    if flight.lengths is None:
        return total
    return np.where(np.arange(len(total))[:, None] < flight.lengths, total, 0.0)


def propellant_used(flight: Flight) -> np.ndarray:
    """Propellant that each episode of a craft with a tank used, (N,) kg."""
    tank = np.asarray(flight.states.stores[0])
    return tank[0] - tank[-1]


def final_errors(flight: Flight) -> dict[str, np.ndarray]:
    """Mean error of each episode over its last fifth, each (N,), SI units."""
    return {name: last_fifth_of(error).mean(axis=0) for name, error in flight.errors().items()}


def worst_errors(flight: Flight) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Largest error of the last fifth in tolerances, (N,), and the largest of each kind, (N,) SI units.

    Only errors with a tolerance count. They are infinite if a state is not finite.
    """
    result = flight.errors()
    bounds = flight.task.tolerances()
    worst = {
        name: np.nan_to_num(last_fifth_of(result[name]).max(axis=0), nan=np.inf) for name in bounds
    }
    return reduce(np.maximum, [worst[name] / bounds[name] for name in bounds]), worst


def returns(flight: Flight) -> np.ndarray:
    """Sum of the task's rewards of each full episode, (N,)."""
    return np.sum(list(flight.rewards().values()), axis=(0, 1))


def solved(flight: Flight) -> np.ndarray:
    """(N,) whether each episode was solved (`rans.episode.verdict`)."""
    return np.asarray(flight.verdict.solved)


def won(flight: Flight) -> np.ndarray:
    """(N,) whether each episode was solved, and no limit was broken in it."""
    return solved(flight) & ~flight.violated()


def metric_definitions(task: Task) -> tuple[str, str]:
    """Definitions of "solved" and "settling time" for a task that holds a goal, or for a mission."""
    if type(task).done is Task.done:
        return (
            "within all tolerances at every step of the last fifth",
            "median time to enter and stay",
        )
    return (
        "accomplished before the end, with no limit broken",
        "median time until it is accomplished",
    )


def last_fifth_of(instants: np.ndarray) -> np.ndarray:
    """The last fifth of an array whose first axis is the T + 1 instants, the start included."""
    return instants[-verdict.last_fifth(len(instants) - 1) :]


def _success(flight: Flight) -> Iterator[Sample]:
    """Samples of success: solved, failed, and the times of it."""
    means = final_errors(flight)
    settling = settling_times(flight)
    mean = np.all([means[name] < bound for name, bound in flight.task.tolerances().items()], axis=0)
    of_solved, of_time = metric_definitions(flight.task)
    for name, meaning, inside in (
        ("solved", of_solved, solved(flight)),
        ("solved in the mean", "mean errors of the last fifth within tolerances", mean),
    ):
        yield Sample("success", name, meaning, "%", inside)
    yield Sample("success", "settling time", of_time, "s", settling, np.median)
    yield Sample(
        "success", "failed", "declared failed by the task at any time", "%", flight.failed()
    )


def _goal_set(flight: Flight) -> Iterator[Sample]:
    """First time in the goal set, of tasks with a position or an attitude; others have settled then."""
    slow = f"{100.0 * REST_SPEED:g} cm/s, {math.degrees(REST_SPIN):g} deg/s"
    first = arrival_times(flight)
    stays = np.isfinite(first) & (staying_times(flight) == first)
    at_first = f"median first time within all tolerances and below {slow}"
    yield Sample("success", "first in the goal set", at_first, "s", first, np.median)
    always = "within all of these from then on, at every instant"
    yield Sample("success", "stays in the goal set", always, "%", stays)


def _solved_to(flight: Flight) -> Iterator[Sample]:
    """Shares like "solved", with other bounds than the task's tolerances."""
    ends = {
        name: QUANTITIES[name].display_factor * last_fifth_of(error)
        for name, error in flight.errors().items()
        if name in flight.task.tolerances() and QUANTITIES[name].held
    }
    for grade in range(3 if ends else 0):
        inside = np.all(
            [(end < QUANTITIES[name].held[grade]).all(axis=0) for name, end in ends.items()], axis=0
        )
        bounds = " ".join(
            f"{quantity.held[grade]} {quantity.display_unit}"
            for quantity in map(QUANTITIES.__getitem__, ends)
        )
        meaning = "within so much at every step of the last fifth"
        yield Sample("success", f"solved to {bounds}", meaning, "%", inside)


def _accuracy(flight: Flight, quantity: str, error: np.ndarray) -> Iterator[Sample]:
    """Metrics of the errors (T + 1, N) of a quantity in SI units; shown ones are in its display unit."""
    declared = QUANTITIES[quantity]
    factor, unit = declared.display
    after = error[1:]
    short, bounds = declared.time_within
    for bound in bounds:
        below = 100.0 * (factor * after < bound).mean(axis=0)
        meaning = f"time steps with {quantity} error below so many {unit}"
        yield Sample(quantity, f"{short}{bound}", meaning, "%", below)
    if declared.threshold is not None:
        yield from _reached(declared, after)
    final = factor * last_fifth_of(error).mean(axis=0)
    yield Sample(quantity, f"{quantity} error", "mean over the last fifth", unit, final)
    # Of a task that follows a velocity, without the time in which craft get up to speed.
    tracked = flight.times > _TRANSIENT
    if "position" not in flight.errors() and tracked.any():
        name = f"{quantity} error after {_TRANSIENT:g} s"
        mean = error[tracked].mean(axis=0)
        yield Sample(quantity, name, "mean from then on", declared.unit, mean)


def _reached(declared: Quantity, error: np.ndarray) -> Iterator[Sample]:
    """Whether errors (T, N) ever fall below the threshold of the original system, and stay near it."""
    threshold = declared.threshold
    assert threshold is not None
    whole, half, margin = declared.threshold_texts
    for bound, text in ((threshold, whole), (threshold / 2, half)):
        ever: Any = (error < bound).any(axis=0)
        yield Sample(declared.name, f"reach {text}", "ever closer than that", "%", ever)
    meaning = f"once closer than {whole}, never farther than that"
    yield Sample(declared.name, f"stay {margin}", meaning, "%", _stays(error, threshold))


def _stays(error: np.ndarray, threshold: float) -> np.ndarray:
    """(N,) whether each episode falls below the threshold and stays within the margin from then on.

    The original system also counts episodes that never fell below the threshold but were always within the margin.
    """
    hit = np.logical_or.accumulate(error < threshold)
    lost = hit & (error >= _STAY * threshold)
    return np.logical_and(hit[-1], ~lost.any(axis=0))


def _motion(flight: Flight) -> Iterator[Sample]:
    speed: Any = flight.states.v.norm()
    spin: Any = np.linalg.norm(flight.states.spin(), axis=0)
    yield Sample("motion", "speed", "mean linear speed (ALV)", "m/s", speed[1:].mean(axis=0))
    yield Sample("motion", "spin", "mean angular speed (AAV)", "rad/s", spin[1:].mean(axis=0))
    at_rest = last_fifth_of(spin).mean(axis=0)
    yield Sample("motion", "spin at rest", "the same over the last fifth", "rad/s", at_rest)


def _effort(flight: Flight) -> Iterator[Sample]:
    """Samples of what is spent: duty, openings, on-time, impulse, return and stores."""
    opened = _opened(flight)
    last = opened[-verdict.last_fifth(len(flight.commands)) :]
    thrusters = max(1, flight.craft.thruster_count)  # of a craft without thrusters the duty is 0
    duty, duty_at_rest = (
        100.0 * opening.mean(axis=0).sum(axis=1) / thrusters for opening in (opened, last)
    )
    for name, meaning, unit, values in (
        ("duty", "mean duty cycle of the thrusters (AAC)", "%", duty),
        ("duty at rest", "the same over the last fifth", "%", duty_at_rest),
        ("openings", "times a thruster opens, an episode", "", valve_openings(flight)),
        ("on-time", "thruster-seconds an episode", "s", on_times(flight)),
        ("impulse", "thrust spent an episode", "N s", impulses(flight)),
        ("return", "sum of rewards of the full episode", "", returns(flight)),
    ):
        yield Sample("effort", name, meaning, unit, values)
    stores = flight.states.stores
    if flight.craft.propellant is not None:
        used = propellant_used(flight)
        yield Sample("effort", "propellant", "used an episode", "kg", used)
    if flight.craft.wheels:
        first = int(flight.craft.propellant is not None)
        held = stores[first : first + flight.craft.wheel_count]
        limits = [wheel.max_momentum for wheel in flight.craft.wheels]
        ratio = np.max([np.abs(h) / m for h, m in zip(held, limits, strict=True)], axis=(0, 1))
        meaning = "largest momentum of any wheel, of what it can hold"
        yield Sample("effort", "wheel momentum", meaning, "%", 100.0 * ratio)


def _percentiles(flight: Flight) -> Iterator[Sample]:
    """Percentiles of what a mission takes and of the margins that it leaves."""
    arrival = settling_times(flight)
    for name, meaning, unit, values in (
        ("arrival", "time of success of so many of all flights, at most", "s", arrival),
        ("impulse", "thrust spent by so many of all flights, at most", "N s", impulses(flight)),
    ):
        for percentage in PERCENTILES:
            centre = partial(np.quantile, q=percentage / 100.0, method="inverted_cdf")
            yield Sample("percentiles", f"{name} {percentage:g} %", meaning, unit, values, centre)
    for name, margins in flight.margins.items():
        meaning = f"least margin of {name} that so many of all flights keep, SI units"
        for percentage in PERCENTILES:
            # The lower end: 99 % keep a margin that 1 % fall below.
            centre = partial(np.quantile, q=1.0 - percentage / 100.0, method="inverted_cdf")
            least = margins.min(axis=0)
            yield Sample("percentiles", f"{name} {percentage:g} %", meaning, "", least, centre)


def _guarding(flight: Flight) -> Iterator[Sample]:
    """Interventions of a safety filter."""
    assert flight.guarded is not None
    percentage = 100.0 * flight.guarded.mean(axis=0)
    meaning = "control periods with another command"
    yield Sample("guard", "interventions", meaning, "%", percentage, key=True)
    ever: Any = flight.guarded.any(axis=0)
    yield Sample("guard", "guarded", "flights with an intervention", "%", ever)
