"""Local search over the pulses of flights, judged by the engine's own checks.

Each round tries many changed copies of flights of every start (`rans_missions.improve.pulses`). They are flown by
the engine; the cheapest that solves its task without a violation is the next best one. Nothing is proved: the
result is a flight, which others may beat. A flight counts only after the engine's own verdict, on the task's own
craft; seeds make a search repeatable.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rans.evaluation.fly.tuned import task_name
from rans.extend import (
    ConfigError,
    Controller,
    Failure,
    Flight,
    Scenario,
    Setup,
    counted,
    fly,
    write_text,
)
from rans_missions.improve.pulses import Best, rounded, search_pulses
from rans_missions.script import Script


@dataclass(frozen=True)
class Improved:
    """The cheapest flights that a search found."""

    commands: np.ndarray
    """(T, N, thrusters), 0 or 1."""
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
        """Write the flights as a contestant of `rans compare`: a CSV file of commands.

        `rans compare` reads it. A start without pulses has a row of zeros, or it would be
        missing.
        """
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        _, starts, thrusters = self.commands.shape
        rows.writerow(["start", "time", *(f"command.{k}" for k in range(thrusters))])
        for start in range(starts):
            for step in np.flatnonzero(self.commands[:, start].any(axis=1)).tolist() or [0]:
                values = (repr(float(x)) for x in self.commands[step, start])
                rows.writerow([start, f"{step * self.period:.10g}", *values])
        write_text(Path(file), text.getvalue())
        return Path(file)


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
        setup: spacecraft, task and timing, without conditions; the craft has on/off thrusters and nothing else.
        starts: N starts.
        seeds: contestants whose flights the search begins from.
        rounds: rounds of the search.
        seed: of its random numbers.
        report: called after each round with the number of rounds done and the impulses, (N,) N s; infinite where no
            flight solves its task.

    Ctrl-C in a round ends the search, and what was found until then is its result.

    Raises:
        ConfigError: no flight solves its task from any start.
    """
    craft, task, timing = setup.craft, setup.task, setup.timing
    random = np.random.default_rng([seed, 1027])

    # The cheapest flight of the seeds from each start.
    count = len(np.ravel(starts.start.p.x))
    coasts = np.zeros((timing.episode_steps, count, craft.command_count))
    best = Best(coasts, np.full(count, np.inf))
    spent_by = []
    begun = []
    why: list[np.ndarray] = []
    for controller in seeds:
        commands = _until_success(fly(craft, task, controller, starts, timing))
        begun.append(commands)
        again = fly(craft, task, Script(rounded(commands)), starts, timing)
        best.flown += count
        spent = best.judge(again, np.arange(count))
        spent_by.append(np.where(np.isfinite(spent), spent, np.nan))
        why.append(np.broadcast_to(again.verdict.failure(), count))

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
        best.commands, np.array(spent_by), after, best.flown, best.rounds, timing.control_period
    )


def _until_success(flight: Flight) -> np.ndarray:
    """Commands of a flight, (T, N, thrusters); none after its success."""
    if flight.lengths is None:
        return flight.commands
    going = np.arange(len(flight.commands))[:, None] < flight.lengths
    return np.where(going[:, :, None], flight.commands, 0.0)
