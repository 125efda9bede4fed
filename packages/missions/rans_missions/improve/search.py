"""Local search over the burns of flights, judged by the engine's own checks.

A flight of a mission is its burns, one a control period: changes of velocity of a craft that nothing turns,
and the commands of all thrusters of any other craft. Each round tries many changed copies of the best flight
of every start: a burn weaker, gone, turned, earlier or later, divided, or exchanged among thrusters or times.
The copies are flown by the engine; the cheapest that solves its task without a violation is the next best
one. Nothing is proved: the result is a flight, which others may beat.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.effectors.commands import per_velocity
from rans.evaluation.measure.metrics import impulses
from rans.extend import (
    ConfigError,
    Controller,
    Flight,
    Scenario,
    Setup,
    Task,
    counted,
    fly,
    map_leaves,
    write_text,
)
from rans_missions.control.circumnavigation import Circumnavigation
from rans_missions.tasks.inspect import Inspect

_COPIES = 256
"""Changed copies of the best flight of each start in a round: a step of one flight takes as long as that of some
hundred."""
_SLACK = 1.25
"""How much longer than the best flights the copies may last, of missions that end with a success."""
_SMALLEST = 1e-7
"""Change of velocity, m/s, below which a period coasts."""


@dataclass(frozen=True)
class Improved:
    """The cheapest flights that a search found."""

    changes: np.ndarray
    """Changes of velocity in W, (T, N, 3) m/s, or commands, (T, N, thrusters)."""
    before: np.ndarray
    """Impulse of the cheapest flight at the beginning of the search, (N,) N s; NaN: none solved its task."""
    after: np.ndarray
    """Impulse at its end, (N,) N s."""
    flown: int
    """Flights that were judged."""
    period: float
    """Control period, s."""
    columns: tuple[str, ...]
    """Columns of a file of flights that hold the changes."""

    def __repr__(self) -> str:
        return (
            f"<Improved: {counted(len(self.after), 'flight')}, from {np.nanmean(self.before):.4g} to "
            f"{np.nanmean(self.after):.4g} N s>"
        )

    def write(self, file: str | Path) -> Path:
        """Write the flights as a contestant of `rans compare`: a CSV file of changes of velocity or of commands."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(["start", "time", *self.columns])
        for start in range(self.changes.shape[1]):
            burns = np.flatnonzero(np.abs(self.changes[:, start]).max(axis=1))
            if not len(burns):
                rows.writerow([start, 0, *(0.0 for _ in self.columns)])
            for step in burns:
                values = (repr(float(x)) for x in self.changes[step, start])
                rows.writerow([start, f"{step * self.period:.10g}", *values])
        write_text(Path(file), text.getvalue())
        return Path(file)


@dataclass(frozen=True)
class _Form:
    """What a search changes: changes of velocity along the axes, or the thrusters' commands."""

    levers: np.ndarray
    """Command of each thruster for a change of 1, (thrusters, K)."""
    low: float
    """Least value of a change."""
    high: float
    """Greatest value of a change."""
    whole: bool
    """Whether only the least and the greatest value are possible: on and off."""
    columns: tuple[str, ...]
    """Columns of a file of flights."""

    @staticmethod
    def of(setup: Setup) -> _Form:
        """Changes of velocity where the craft's thrusters allow them, commands otherwise."""
        craft, period = setup.craft, setup.timing.control_period
        if craft.wheels or craft.further_effectors:
            raise ConfigError(
                f"improve searches burns of thrusters, and {craft.name} has wheels or other effectors; fly a craft "
                "without them."
            )
        try:
            # In the plane a craft turns, and a file's changes of velocity depend on its heading.
            levers = np.array(per_velocity(craft, period)) if craft.dimension == 3 else None
        except ConfigError:
            levers = None
        if levers is None:
            count = craft.command_count
            columns = tuple(f"command.{k}" for k in range(count))
            return _Form(np.eye(count), 0.0, 1.0, not craft.is_continuous, columns)
        most = 1.0 / float(np.abs(levers).max())
        return _Form(levers, -most, most, False, ("dv.x", "dv.y", "dv.z"))


class _Burns:
    """Controller that gives burns, whatever the state is.

    Args:
        changes: (T, N, K).
        levers: command of each thruster for a change of 1, (thrusters, K).
    """

    name = "burns"
    observes = False

    def __init__(self, changes: np.ndarray, levers: np.ndarray) -> None:
        self._commands = np.clip(changes @ levers.T, 0.0, 1.0)
        self._step = 0

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._step = 0

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        commands = self._commands[self._step]
        self._step += 1
        return commands


def improve(
    setup: Setup,
    starts: Scenario,
    seeds: Sequence[Controller],
    rounds: int = 100,
    seed: int = 0,
    report: Callable[[int, np.ndarray], object] = lambda done, best: None,
) -> Improved:
    """Search for cheaper flights of a mission from each start.

    Args:
        setup: spacecraft, task and timing, without conditions; the craft has thrusters and nothing else.
        starts: N starts.
        seeds: contestants whose flights the search begins from. Inspections have a search of their own beside them
            (`rans_missions.control.circumnavigation.Circumnavigation.thorough`).
        rounds: rounds of the search.
        seed: of its random numbers.
        report: called after each round with the number of rounds done and the impulses, (N,) N s.

    Raises:
        ConfigError: the craft has other effectors, or no seed solves its task from any start.
    """
    craft, task, timing = setup.craft, setup.task, setup.timing
    form = _Form.of(setup)
    levers = form.levers
    random = np.random.default_rng([seed, 1027])

    # The cheapest flight of the seeds, and of what a mission has of its own, from each start.
    if isinstance(task, Inspect):
        seeds = [*seeds, Circumnavigation.thorough(craft, task, timing)]
    count = len(np.ravel(starts.start.p.x))
    best = np.zeros((timing.episode_steps, count, len(form.columns)))
    cost = np.full(best.shape[1], np.inf)
    length = np.full(best.shape[1], timing.episode_steps)
    flown = 0
    for controller in seeds:
        flight = fly(craft, task, controller, starts, timing)
        changes = _changes(flight, levers)
        # What was flown may have been another split of thrusters: the changes alone are judged.
        again = fly(craft, task, _Burns(changes, levers), starts, timing)
        flown += 2 * len(cost)
        spent = _judged(again)
        cheaper = spent < cost
        best[:, cheaper] = changes[:, cheaper]
        cost = np.where(cheaper, spent, cost)
        if again.lengths is not None:
            length = np.where(cheaper, again.lengths, length)
    solved = np.flatnonzero(np.isfinite(cost))
    if not len(solved):
        raise ConfigError(
            f"none of {', '.join(one.name for one in seeds)} solves {type(task).__name__} from any of "
            f"{counted(len(cost), 'start')}: the search begins from a flight that does."
        )
    before = np.where(np.isfinite(cost), cost, np.nan)

    # Rounds over the starts with a flight.
    size = np.full(len(cost), 0.5)
    ends = type(task).done is not Task.done
    for done in range(1, rounds + 1):
        steps = timing.episode_steps
        if ends:
            steps = min(steps, int(np.ceil(_SLACK * length[solved].max())) + 1)
        copies = np.repeat(best[:steps, solved], _COPIES, axis=1)
        for number in range(copies.shape[1]):
            _change(copies[:, number], float(size[solved[number // _COPIES]]), form, random)
        many = map_leaves(
            lambda x: np.repeat(np.broadcast_to(x, cost.shape)[solved], _COPIES), starts
        )
        shorter = replace(timing, episode_steps=steps)
        flight = fly(craft, task, _Burns(copies, levers), many, shorter)
        flown += copies.shape[1]
        spent = _judged(flight).reshape(len(solved), _COPIES)
        for row, start in enumerate(solved):
            winner = int(np.argmin(spent[row]))
            if spent[row, winner] < cost[start]:
                number = row * _COPIES + winner
                best[:, start] = 0.0
                best[:steps, start] = copies[:, number]
                cost[start] = spent[row, winner]
                if ends and flight.lengths is not None:
                    length[start] = flight.lengths[number]
                    best[length[start] :, start] = 0.0
                size[start] = min(1.0, 1.5 * size[start])
            else:
                size[start] = max(1e-3, 0.93 * size[start])
        report(done, np.where(np.isfinite(cost), cost, np.nan))
    after = np.where(np.isfinite(cost), cost, np.nan)
    return Improved(best, before, after, flown, timing.control_period, form.columns)


def _judged(flight: Flight) -> np.ndarray:
    """Impulse of each flight, (N,) N s; infinite where it does not solve its task, by the engine's own checks."""
    verdict = flight.verdict
    solved = np.asarray(verdict.solved) & ~flight.violated() & ~flight.failed()
    return np.where(solved, impulses(flight), np.inf)


def _changes(flight: Flight, levers: np.ndarray) -> np.ndarray:
    """Changes of a flight by its commands, (T, N, K), without those after its success."""
    # Each row of levers is a direction over the change by a full command.
    most = 1.0 / np.square(levers).sum(axis=1)
    changes = flight.commands @ (levers * most[:, None])
    if flight.lengths is not None:
        going = np.arange(len(changes))[:, None] < flight.lengths
        changes = np.where(going[:, :, None], changes, 0.0)
    return changes


def _change(flight: np.ndarray, size: float, form: _Form, random: np.random.Generator) -> None:
    """Change the burns of a flight, (T, K), in place, by a random move of a size from 0 to 1."""
    burns = np.flatnonzero(np.abs(flight).max(axis=1))
    if not len(burns):
        return
    for _ in range(1 + random.integers(3)):
        at = int(random.choice(burns))
        move = random.integers(6)
        if move == 0:  # weaker or stronger
            flight[at] *= 1.0 + size * random.uniform(-1.0, 0.4)
        elif move == 1:  # a window of burns weaker, or gone
            last = at + 1 + random.integers(8)
            flight[at:last] *= 0.0 if random.random() < 0.3 else 1.0 - size * random.random()
        elif move == 2:  # turned
            scale = np.abs(flight[at]).max()
            flight[at] += scale * size * random.normal(size=flight.shape[1])
        elif move == 3:  # a part of it earlier or later
            to = at + int(np.rint(random.normal() * (1.0 + 20.0 * size)))
            if 0 <= to < len(flight):
                part = flight[at] * (1.0 if random.random() < 0.5 else random.random())
                flight[at] -= part
                flight[to] += part
        elif move == 4:  # one axis of it gone or smaller
            axis = random.integers(flight.shape[1])
            flight[at, axis] *= 0.0 if random.random() < 0.5 else 1.0 - size * random.random()
        else:  # exchanged among burns
            to = int(random.choice(burns))
            part = flight[at] * size * random.random()
            flight[at] -= part
            flight[to] += part
    flight[:] = np.clip(flight, form.low, form.high)
    if form.whole:
        flight[:] = flight > 0.5
    flight[np.abs(flight) < _SMALLEST] = 0.0
