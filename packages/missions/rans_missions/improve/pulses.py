"""Search over the pulses of on/off thrusters, also from flights that miss their goal.

Rounded to pulses, an optimal trajectory of throttled thrusters misses its goal by little, and spends much less
than agents do. Impulses are multiples of one pulse, and a pulse that is left out ruins a flight unless others
change too. The search therefore keeps several flights of each start. One that solves its task costs its impulse;
any other costs a price more, which rises with how far it is from solving it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rans.evaluation.measure.metrics import impulses
from rans.extend import Flight, Scenario, Setup, Task, fly, map_leaves
from rans.verdict import last_fifth
from rans_missions.improve.judging import COPIES, Best, Burns, judged

_PARENTS = 8
"""Flights of each start that are kept."""
_OFFSETS = (0.5, 0.25, 0.75, 0.1, 0.9)
"""Parts of a pulse at which a sum of commands becomes the next one."""
_LOW, _HIGH = 1.0, 100.0
"""Least and greatest price of missing the goal by e - 1 tolerances, in pulses. It rises while the cheapest flight
that is kept does not solve its task, and falls while it does."""
_BEGIN = 10.0
"""The price at first, in pulses."""
_DEEP = 0.05
"""How far a limit is broken that counts as one tolerance, m."""
_BARELY = 0.02
"""Tolerances by which a flight misses its goal at least that does not solve its task: limits are checked within
control periods too."""


@dataclass
class _Kept:
    """Flights of one start: their commands, what they spend, and how far they are from solving the task."""

    commands: np.ndarray
    """(M, T, thrusters)."""
    spent: np.ndarray
    """(M,) N s."""
    missed: np.ndarray
    """(M,) tolerances; 0: solved."""
    price: float
    """Of missing the goal by e - 1 tolerances, N s."""

    def taking(self, commands: np.ndarray, spent: np.ndarray, missed: np.ndarray) -> None:
        """Keep the best of these flights and others, which come first among equals."""
        every = np.concatenate([commands, self.commands])
        spent = np.concatenate([spent, self.spent])
        missed = np.concatenate([missed, self.missed])
        costs = spent + self.price * np.log1p(missed)
        kept: dict[bytes, int] = {}
        for number in np.argsort(costs, kind="stable"):
            kept.setdefault(every[number].tobytes(), int(number))
            if len(kept) == _PARENTS:
                break
        chosen = list(kept.values())
        self.commands, self.spent, self.missed = every[chosen], spent[chosen], missed[chosen]


def rounded(commands: np.ndarray, offset: float = 0.5) -> np.ndarray:
    """Pulses (T, ...) in place of commands from 0 to 1: one where their sum passes a whole number plus an offset.

    Commands that are pulses stay as they are.

    Args:
        commands: (T, ...).
        offset: more than 0 and at most 1.
    """
    sums = np.floor(np.cumsum(commands, axis=0) + (1.0 - offset) + 1e-9)
    return np.diff(sums, axis=0, prepend=0.0 * sums[:1])


def search_pulses(
    setup: Setup,
    starts: Scenario,
    flights: Sequence[np.ndarray],
    best: Best,
    rounds: int,
    random: np.random.Generator,
    report: Callable[[int, np.ndarray], object],
) -> None:
    """Search from flights that may miss their goal; what is cheaper than the best ones takes their place.

    Args:
        setup: spacecraft with on/off thrusters, task and timing.
        starts: N starts.
        flights: commands from 0 to 1 of the flights from which the search begins, (T, N, thrusters) each.
        best: cheapest flights.
        rounds: rounds of the search.
        random: random numbers.
        report: called after each round with the number of rounds done and the impulses, (N,) N s.
    """
    craft, task, timing = setup.craft, setup.task, setup.timing
    count = flights[0].shape[1]
    pulse = float(np.mean([one.force for one in craft.thrusters])) * timing.control_period

    def flies(commands: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What flights (T, M, thrusters) from these starts spend, and how far they are from solving the task."""
        many = map_leaves(lambda x: np.broadcast_to(x, count)[rows], starts)
        flight = fly(craft, task, Burns(commands, np.eye(craft.thruster_count)), many, timing)
        spent = judged(flight)
        solved = np.isfinite(spent)
        missed = np.where(solved, 0.0, np.maximum(shortfall(flight), _BARELY))
        best.flown += len(rows)
        for number in np.flatnonzero(solved):
            row = int(rows[number])
            if spent[number] < best.cost[row]:
                best.take(row, commands[:, number], spent[number], flight, int(number))
        return np.where(solved, spent, impulses(flight)), missed

    # Beginnings: the flights as pulses.
    begun = [rounded(one, offset) for one in flights for offset in _OFFSETS]
    kept: list[_Kept] = []
    results = [flies(commands, np.arange(count)) for commands in begun]
    for row in range(count):
        empty = np.zeros((0, timing.episode_steps, craft.thruster_count))
        first = _Kept(empty, np.zeros(0), np.zeros(0), _BEGIN * pulse)
        first.taking(
            np.stack([commands[:, row] for commands in begun]),
            np.array([spent[row] for spent, _ in results]),
            np.array([missed[row] for _, missed in results]),
        )
        kept.append(first)

    # Rounds.
    for done in range(1, rounds + 1):
        rows = np.repeat(np.arange(count), COPIES)
        copies = np.concatenate(
            [one.commands[random.integers(len(one.commands), size=COPIES)] for one in kept]
        )
        for one in copies:
            _change(one, random)
        try:
            spent, missed = flies(copies.swapaxes(0, 1), rows)
        except KeyboardInterrupt:
            break
        for row, one in enumerate(kept):
            mine = slice(row * COPIES, (row + 1) * COPIES)
            one.taking(copies[mine], spent[mine], missed[mine])
            factor = 0.97 if one.missed[0] == 0.0 else 1.05
            one.price = float(np.clip(factor * one.price, _LOW * pulse, _HIGH * pulse))
        best.rounds = done
        report(done, best.cost)


def shortfall(flight: Flight) -> np.ndarray:
    """How far flights are from solving their task, (N,): errors beyond the tolerances, and depths of broken limits.

    Both count in tolerances. The worst instant of the last fifth counts where a task lasts, the best instant of all
    where a mission ends with a success.
    """
    errors, tolerances = flight.errors(), flight.task.tolerances()
    shape = len(flight.commands) + 1, flight.commands.shape[1]
    beyond = np.max([np.broadcast_to(errors[k], shape) / v for k, v in tolerances.items()], axis=0)
    beyond = np.nan_to_num(np.maximum(beyond - 1.0, 0.0), nan=1e3)
    broken = np.zeros_like(beyond)
    if flight.margins:
        least = np.minimum.reduce(list(flight.margins.values()))
        deepest = np.maximum.accumulate(np.maximum(-least, 0.0), axis=0) / _DEEP
        broken[1:] = np.nan_to_num(deepest, nan=1e3)
    if type(flight.task).done is Task.done:
        return beyond[-last_fifth(len(flight.commands)) :].max(axis=0) + broken[-1]
    return (beyond + broken).min(axis=0)


def _change(flight: np.ndarray, random: np.random.Generator) -> None:
    """Change the pulses of a flight, (T, thrusters), in place."""
    steps, thrusters = flight.shape
    for _ in range(1 + random.geometric(0.5)):
        pulses = np.argwhere(flight)
        move = random.random()
        if move < 0.12 or not len(pulses):  # one more
            flight[random.integers(steps), random.integers(thrusters)] = 1.0
            continue
        at, thruster = pulses[random.integers(len(pulses))]
        if move < 0.3:  # one less
            flight[at, thruster] = 0.0
        elif move < 0.75:  # earlier or later
            width = 1.0 if random.random() < 0.5 else 12.0
            to = at + int(np.rint(random.normal() * width)) or at + 1
            if 0 <= to < steps and not flight[to, thruster]:
                flight[at, thruster] = 0.0
                flight[to, thruster] = 1.0
        elif move < 0.85:  # of another thruster
            other = random.integers(thrusters)
            if not flight[at, other]:
                flight[at, thruster] = 0.0
                flight[at, other] = 1.0
        elif move < 0.93:  # all of a time earlier or later
            first, last = sorted(random.integers(steps, size=2))
            by = int(random.choice([-2, -1, 1, 2]))
            window = flight[first : last + 1].copy()
            flight[first : last + 1] = np.roll(window, by, axis=0)
        else:  # all of a time gone
            flight[at : at + 1 + random.integers(8)] = 0.0
