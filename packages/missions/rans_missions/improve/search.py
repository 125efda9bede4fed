"""Local search over the burns of flights, judged by the engine's own checks.

A flight of a mission is its burns, one a control period: changes of velocity of a craft that nothing turns, and the
commands of all thrusters of any other craft. Each round tries many changed copies of the best flight of every
start: a burn weaker, gone, turned, earlier or later, divided, or exchanged among thrusters or times. The copies are
flown by the engine; the cheapest that solves its task without a violation is the next best one. On/off thrusters
have a search of their own (`rans_missions.improve.pulses`). Nothing is proved: the result is a flight, which others
may beat. A flight counts only after the engine's own verdict, on the task's own craft; seeds make a search
repeatable.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rans.effectors.commands import per_velocity
from rans.evaluation.fly.tuned import task_name
from rans.extend import (
    ConfigError,
    Controller,
    Failure,
    Flight,
    Scenario,
    Setup,
    Task,
    counted,
    fly,
    map_leaves,
    write_text,
)
from rans_missions.improve.judging import COPIES, Best, judged
from rans_missions.improve.pulses import rounded, search_pulses
from rans_missions.script import Script

_SLACK = 1.25
"""How much longer than the best flights the copies may last, of missions that end with a success."""
_SMALLEST = 1e-7
"""Change of velocity, m/s, below which a period coasts."""


@dataclass(frozen=True)
class Improved:
    """The cheapest flights that a search found."""

    changes: np.ndarray
    """Changes of velocity in W, (T, N, 3) m/s, or commands, (T, N, thrusters)."""
    spent: np.ndarray
    """Impulse of each contestant, (contestants, N) N s; NaN: it did not solve its task."""
    after: np.ndarray
    """Impulse at the end of the search, (N,) N s; NaN: no flight solves its task."""
    flown: int
    """Flights that were judged."""
    rounds: int
    """Rounds of the search; fewer than asked after Ctrl-C."""
    period: float
    """Control period, s."""
    columns: tuple[str, ...]
    """Columns of a file of flights that hold the changes."""

    @property
    def before(self) -> np.ndarray:
        """Impulse of the cheapest contestant, (N,) N s; NaN: none solved its task."""
        least = np.nan_to_num(self.spent, nan=np.inf).min(axis=0)
        return np.where(np.isfinite(least), least, np.nan)

    def __repr__(self) -> str:
        return (
            f"<Improved: {counted(len(self.after), 'flight')}, from {np.nanmean(self.before):.4g} to "
            f"{np.nanmean(self.after):.4g} N s>"
        )

    def write(self, file: str | Path) -> Path:
        """Write the flights as a contestant of `rans compare`: a CSV file of changes of velocity or of commands.

        `rans.evaluation.fly.flights_file` reads it. A start without burns has a row of zeros, or it would be
        missing.
        """
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
    columns: tuple[str, ...]
    """Columns of a file of flights."""

    def script(self, changes: np.ndarray) -> Script:
        """What gives changes (T, N, K) as commands."""
        return Script(np.clip(changes @ self.levers.T, 0.0, 1.0))

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
            return _Form(np.eye(count), 0.0, 1.0, columns)
        most = 1.0 / float(np.abs(levers).max())
        return _Form(levers, -most, most, ("dv.x", "dv.y", "dv.z"))


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
        seeds: contestants whose flights the search begins from.
        rounds: rounds of the search.
        seed: of its random numbers.
        report: called after each round with the number of rounds done and the impulses, (N,) N s; infinite where no
            flight solves its task.

    Ctrl-C in a round ends the search, and what was found until then is its result.

    Raises:
        ConfigError: the craft has other effectors, or no flight solves its task from any start.
    """
    craft, task, timing = setup.craft, setup.task, setup.timing
    form = _Form.of(setup)
    random = np.random.default_rng([seed, 1027])

    # The cheapest flight of the seeds from each start.
    count = len(np.ravel(starts.start.p.x))
    best = Best.coasts(timing.episode_steps, count, len(form.columns))
    spent_by = []
    begun = []
    why: list[np.ndarray] = []
    for controller in seeds:
        flight = fly(craft, task, controller, starts, timing)
        changes = _changes(flight, form.levers)
        begun.append(changes)
        if not craft.is_continuous:
            changes = rounded(changes)
        # What was flown may have been another split of thrusters: the changes alone are judged.
        again = fly(craft, task, form.script(changes), starts, timing)
        best.flown += 2 * count
        spent = judged(again)
        spent_by.append(np.where(np.isfinite(spent), spent, np.nan))
        why.append(np.broadcast_to(again.verdict.failure(), count))
        for row in np.flatnonzero(spent < best.cost):
            best.take(int(row), changes[:, row], spent[row], again, int(row))

    # Rounds.
    if craft.is_continuous:
        if np.isfinite(best.cost).any():
            _search(setup, starts, form, best, rounds, random, report)
    else:
        search_pulses(setup, starts, begun, best, rounds, random, report)
    if not np.isfinite(best.cost).any():
        kinds = {int(kind) for kind in np.concatenate(why)} - {0}
        reasons = "; ".join(Failure(kind).meaning for kind in sorted(kinds))
        raise ConfigError(
            f"the search begins from a flight that solves {task_name(task)}, and none of "
            f"{', '.join(one.name for one in seeds)} does, from {counted(count, 'start')}: {reasons}."
        )
    after = np.where(np.isfinite(best.cost), best.cost, np.nan)
    return Improved(
        best.changes,
        np.array(spent_by),
        after,
        best.flown,
        best.rounds,
        timing.control_period,
        form.columns,
    )


def _search(
    setup: Setup,
    starts: Scenario,
    form: _Form,
    best: Best,
    rounds: int,
    random: np.random.Generator,
    report: Callable[[int, np.ndarray], object],
) -> None:
    """Rounds over the starts that have a flight, of thrusters that are throttled or give pulses of any length."""
    craft, task, timing = setup.craft, setup.task, setup.timing
    solved = np.flatnonzero(np.isfinite(best.cost))
    size = np.full(len(best.cost), 0.5)
    ends = type(task).done is not Task.done
    # A round: changed copies of every start's best, flown together, and the best of each kept.
    for done in range(1, rounds + 1):
        steps = timing.episode_steps
        if ends:
            steps = min(steps, int(np.ceil(_SLACK * best.length[solved].max())) + 1)
        copies = np.repeat(best.changes[:steps, solved], COPIES, axis=1)
        for number in range(copies.shape[1]):
            _change(copies[:, number], float(size[solved[number // COPIES]]), form, random)
        many = map_leaves(
            lambda x: np.repeat(np.broadcast_to(x, best.cost.shape)[solved], COPIES), starts
        )
        shorter = replace(timing, episode_steps=steps)
        try:
            flight = fly(craft, task, form.script(copies), many, shorter)
        except KeyboardInterrupt:
            break
        best.flown += copies.shape[1]
        spent = judged(flight).reshape(len(solved), COPIES)
        for row, start in enumerate(solved):
            winner = int(np.argmin(spent[row]))
            if spent[row, winner] < best.cost[start]:
                number = row * COPIES + winner
                best.take(int(start), copies[:, number], spent[row, winner], flight, number)
                size[start] = min(1.0, 1.5 * size[start])
            else:
                size[start] = max(1e-3, 0.93 * size[start])
        best.rounds = done
        report(done, best.cost)


def _changes(flight: Flight, levers: np.ndarray) -> np.ndarray:
    """Changes of a flight by its commands, (T, N, K), in the unit of the form; none after its success.

    The flight is where a search begins: `_Form.script` makes commands of such changes. Levers are (thrusters, K).
    """
    # A thruster that changes c along its unit direction d has the lever d / c: d c is lever / |lever|^2.
    most = 1.0 / np.square(levers).sum(axis=1)
    changes = flight.commands @ (levers * most[:, None])
    if flight.lengths is not None:
        going = np.arange(len(changes))[:, None] < flight.lengths
        changes = np.where(going[:, :, None], changes, 0.0)
    return changes


def _change(flight: np.ndarray, size: float, form: _Form, random: np.random.Generator) -> None:
    """Change the burns of a flight, (T, K), in place, by a random move of a size from 0 to 1.

    A further draw changes all later moves of a seed.
    """
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
    flight[np.abs(flight) < _SMALLEST] = 0.0
