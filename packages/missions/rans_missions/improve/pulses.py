"""Search over the pulses of on/off thrusters, also from flights that miss their goal.

Rounded to pulses, an optimal trajectory of throttled thrusters misses its goal by little, and spends much less
than agents do. Impulses are multiples of one pulse, and a pulse that is left out ruins a flight unless others
change too. The search therefore keeps several flights of each start. One that solves its task costs its impulse;
any other costs a price more, which rises with how far it is from solving it. A round flies changes of single pulses
first. Where the craft is at the end changes by about the sum of what they do, so that two to four of them that
together lead to the goal follow without flying; these are flown next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rans.extend import (
    Flight,
    Scenario,
    Setup,
    Task,
    coordinates,
    fly,
    impulses,
    last_fifth,
    map_leaves,
    won,
)
from rans_missions.improve.following import MANNERS, Following
from rans_missions.script import Script

COPIES = 256
"""Changed copies of the flights of each start in a round: a step of one flight takes as long as that of some
hundred."""
_PARENTS = 16
"""Flights of each start that are kept."""
_LUCK = 2.0
"""Mean cost, in pulses, that is added at random where it is decided which flights but the best are kept: without it
all are nearly the same."""
_OFFSETS = (0.5, 0.25, 0.75, 0.1, 0.9)
"""Parts of a pulse at which a sum of commands becomes the next one."""
_LOW, _HIGH = 1.0, 100.0
"""Least and greatest price of missing the goal by e - 1 tolerances, in pulses. It rises while the cheapest flight
that is kept does not solve its task, and falls while it does."""
_CHEAPER, _DEARER = 0.8, 1.25
"""Factors of the price in a round: flights lose pulses and miss their goal by little, and then reach it again."""
_BEGIN = 10.0
"""The price at first, in pulses."""
_DEEP = 0.05
"""How far a limit is broken that counts as one tolerance, m."""
_BARELY = 0.02
"""Tolerances by which a flight misses its goal at least that does not solve its task: limits are checked within
control periods too."""
_FAR = 1e3
"""Tolerances that stand for infinitely many."""
_SHIFTS = (1, 2, 3, 5, 8, 13, 21)
"""Control periods by which a pulse moves."""
_TOGETHER = 4
"""Changes that are made at once, at most."""
_BEAM = 200
"""Sets of changes to which one more is added, of each weight."""
_WEIGHTS = (1.0, 10.0, 0.1)
"""Weights of broken limits by which sets are chosen: what mends a limit misses the goal at first."""


@dataclass
class Best:
    """The cheapest flights that solve their task, from each start."""

    commands: np.ndarray
    """(T, N, thrusters), 0 or 1."""
    cost: np.ndarray
    """(N,) N s; infinite: there is none."""
    flown: int = 0
    """Flights that were judged."""
    rounds: int = 0
    """Rounds of the search."""

    def judge(self, flight: Flight, starts: np.ndarray) -> np.ndarray:
        """Impulse of each of M flights, see `judged`; those that are cheaper take their places.

        Args:
            flight: M flights.
            starts: number of the start of each, (M,).
        """
        self.flown += len(starts)
        spent = judged(flight)
        steps = len(flight.commands)
        for number in np.flatnonzero(np.isfinite(spent)):
            start = starts[number]
            if spent[number] < self.cost[start]:
                last = steps if flight.lengths is None else int(flight.lengths[number])
                self.commands[:, start] = 0.0
                self.commands[:last, start] = flight.commands[:last, number]
                self.cost[start] = spent[number]
        return spent


def judged(flight: Flight) -> np.ndarray:
    """Impulse of each flight, (N,) N s; infinite where it does not solve its task, by the engine's own checks."""
    return np.where(won(flight) & ~flight.failed(), impulses(flight), np.inf)


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
    """Price of missing the goal by e - 1 tolerances, N s."""
    luck: float
    """Mean cost that is added at random to flights but the best where it is decided which are kept, N s."""
    random: np.random.Generator
    """Random numbers."""

    def costs(self, spent: np.ndarray, missed: np.ndarray) -> np.ndarray:
        """Impulse, and the price of what is missed, N s."""
        return spent + self.price * np.log1p(missed)

    def taking(self, commands: np.ndarray, spent: np.ndarray, missed: np.ndarray) -> None:
        """Keep the best of flights with commands (M, T, n), impulses and misses (M,), and of those kept.

        Changes itself.
        """
        every = np.concatenate([commands, self.commands])
        spent = np.concatenate([spent, self.spent])
        missed = np.concatenate([missed, self.missed])
        costs = self.costs(spent, missed)
        luck = self.luck * self.random.exponential(size=len(costs))
        luck[costs.argmin()] = -np.inf
        kept: dict[bytes, int] = {}
        for number in np.argsort(costs + luck):
            kept.setdefault(every[number].tobytes(), int(number))
            if len(kept) == _PARENTS:
                break
        chosen = list(kept.values())
        self.commands, self.spent, self.missed = every[chosen], spent[chosen], missed[chosen]


@dataclass(frozen=True)
class _Flown:
    """What M flights came to."""

    spent: np.ndarray
    """(M,) N s."""
    missed: np.ndarray
    """(M,) tolerances; 0: solved."""
    when: np.ndarray
    """(M,) instant that counts."""
    ends: np.ndarray
    """Where they are then, see `_ends`, (M, quantities, axes)."""
    margins: np.ndarray
    """Least margin of each constraint until then, in tolerances, (M, constraints)."""


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

    def flies(commands: Sequence[np.ndarray], at: np.ndarray | None = None) -> list[_Flown]:
        """What flights (M, T, thrusters) from every start come to; at (N,): the instant that counts.

        It also takes every flight that solves and is cheaper into the result, so that callers may drop what they
        get.
        """
        group = np.repeat(np.arange(len(commands)), [len(one) for one in commands])
        rows = group % count
        many = map_leaves(lambda x: np.broadcast_to(x, count)[rows], starts)
        every = np.concatenate(commands).swapaxes(0, 1)
        flight = fly(craft, task, Script(every), many, timing)
        spent = best.judge(flight, rows)
        solved = np.isfinite(spent)
        missed, when = shortfall(flight)
        missed = np.where(solved, 0.0, np.maximum(missed, _BARELY))
        spent = np.where(solved, spent, impulses(flight))
        counts = when if at is None else at[group]
        found = spent, missed, when, _ends(flight, counts), _margins(flight, counts)
        return [_Flown(*(x[group == one] for x in found)) for one in range(len(commands))]

    # Beginnings: the flights as pulses, rounded; and followed, which are kept apart: they solve the task sooner,
    # and spend more than the others come to.
    begun = [[rounded(one, offset) for one in flights for offset in _OFFSETS], []]
    for one in flights:
        if not np.isin(one, (0.0, 1.0)).all():
            flight = fly(craft, task, Script(one), starts, timing)
            begun[1] += [
                fly(craft, task, Following(craft, flight, manner), starts, timing).commands
                for manner in MANNERS
            ]
    of_start = [one for group in begun if group for one in np.stack(group).transpose(2, 0, 1, 3)]
    kept: list[_Kept] = []
    for commands, flown in zip(of_start, flies(of_start), strict=True):
        one = _Kept(commands[:0], np.zeros(0), np.zeros(0), _BEGIN * pulse, _LUCK * pulse, random)
        one.taking(commands, flown.spent, flown.missed)
        kept.append(one)

    # Rounds: flights with one change each, then such with several that should do better together.
    for done in range(1, rounds + 1):
        try:
            parents = [one.commands[_ranked(len(one.commands), random)] for one in kept]
            was = flies([parent[None] for parent in parents])
            at = np.array([one.when[0] for one in was])
            changes = [_changes(parent, random) for parent in parents]
            tried = [
                np.stack([_changed(parent, one[None]) for one in several])
                for parent, several in zip(parents, changes, strict=True)
            ]
            singles = flies(tried, at)
            together = [
                np.stack([_changed(parent, several[chosen]) for chosen in _sets(one.price, *rest)])
                for parent, several, one, *rest in zip(
                    parents, changes, kept, was, singles, changes, strict=True
                )
            ]
            results = flies(together)
        except KeyboardInterrupt:
            break
        for row, one in enumerate(kept):
            for commands, flown in ((tried[row], singles[row]), (together[row], results[row])):
                one.taking(commands, flown.spent, flown.missed)
            factor = _CHEAPER if one.missed[0] == 0.0 else _DEARER
            one.price = float(np.clip(factor * one.price, _LOW * pulse, _HIGH * pulse))
        best.rounds = done
        report(done, best.cost)


def shortfall(flight: Flight) -> tuple[np.ndarray, np.ndarray]:
    """How far flights are from solving their task, (N,) tolerances, and the instant that says so, (N,).

    Errors beyond their tolerances and depths of broken limits add up. The worst errors of the last fifth count
    where a task lasts, those of the best instant where a mission ends with a success.
    """
    errors, tolerances = flight.errors(), flight.task.tolerances()
    steps, count = flight.commands.shape[:2]
    beyond = [
        np.nan_to_num(
            np.maximum(np.broadcast_to(errors[k], (steps + 1, count)) / v - 1.0, 0.0), nan=_FAR
        )
        for k, v in tolerances.items()
    ]
    broken = np.zeros((steps + 1, count))
    if flight.margins:
        least = np.minimum.reduce(list(flight.margins.values()))
        deepest = np.maximum.accumulate(np.maximum(-least, 0.0), axis=0) / _DEEP
        broken[1:] = np.nan_to_num(deepest, nan=_FAR)
    if type(flight.task).done is Task.done:
        worst = [one[-last_fifth(steps) :].max(axis=0) for one in beyond]
        return np.sum(worst, axis=0) + broken[-1], np.full(count, steps)
    missed = np.sum(beyond, axis=0) + broken
    when = missed.argmin(axis=0)
    return missed[when, np.arange(count)], when


def _ends(flight: Flight, when: np.ndarray) -> np.ndarray:
    """Where M flights are at their end, around the goal, in tolerances, (M, quantities, axes).

    Where a task lasts these are position and attitude at the first and at the last instant of the last fifth, where
    a mission ends with a success those and the velocities at one instant (M,).

    Quantities come in the order of `coordinates`, without those that the task has no tolerance for.
    """
    steps, count = flight.commands.shape[:2]
    fields = coordinates(flight.states, flight.goals)
    every = np.stack([np.broadcast_to(x, (steps + 1, count)) for x in fields])
    axes = 3 if len(every) == 12 else 2
    sizes = {"position": axes, "attitude": 2 * axes - 3, "velocity": axes, "spin": 2 * axes - 3}
    tolerances = flight.task.tolerances()
    instants = [when]
    if type(flight.task).done is Task.done:
        instants = [when - last_fifth(steps) + 1, when]
    found = []
    first = 0
    for name, size in sizes.items():
        group = every[first : first + size]
        first += size
        if name not in tolerances:
            continue
        for instant in instants:
            now = group[:, instant, np.arange(count)] / tolerances[name]
            found.append(np.pad(now, ((0, axes - size), (0, 0))))
    return np.nan_to_num(np.stack(found).transpose(2, 0, 1), nan=_FAR)


def _margins(flight: Flight, when: np.ndarray) -> np.ndarray:
    """Least margin of each constraint of M flights until an instant (M,), in tolerances, (M, constraints)."""
    steps, count = flight.commands.shape[:2]
    until = np.arange(steps)[:, None] < when
    least = [np.where(until, one, np.inf).min(axis=0) / _DEEP for one in flight.margins.values()]
    return np.nan_to_num(
        np.stack([*least, np.full(count, np.inf)], axis=1), posinf=_FAR, neginf=-_FAR
    )


def _ranked(count: int, random: np.random.Generator) -> int:
    """Number of a flight that is kept: the best in half of the rounds, else any."""
    return 0 if random.random() < 0.5 else int(random.integers(count))


def _changes(flight: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Changes of single pulses of a flight (T, thrusters), (M, 2): which goes, and which comes; -1: none.

    Places are counted through all thrusters of all periods.

    At most `COPIES`, in a random order, of which a quarter at most are new pulses.
    """
    steps, thrusters = flight.shape
    found = []
    for at, thruster in np.argwhere(flight):
        here = at * thrusters + thruster
        moved = [(at + by, thruster) for shift in _SHIFTS for by in (-shift, shift)]
        moved += [(at, other) for other in range(thrusters)]
        found += [
            (here, to * thrusters + other)
            for to, other in moved
            if 0 <= to < steps and not flight[to, other]
        ]
        found.append((here, -1))
    random.shuffle(found)
    shut = np.flatnonzero(flight.ravel() == 0.0)
    more = random.choice(shut, size=min(COPIES // 4, len(shut)), replace=False)
    found = found[: COPIES - len(more)] + [(-1, place) for place in more]
    return np.array(found)


def _changed(flight: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """The flight (T, thrusters) with these changes (K, 2), see `_changes`."""
    result = flight.ravel().copy()
    off, on = changes.T
    result[off[off >= 0]] = 0.0
    result[on[on >= 0]] = 1.0
    return result.reshape(flight.shape)


def _sets(price: float, was: _Flown, singles: _Flown, changes: np.ndarray) -> list[np.ndarray]:
    """Sets of changes that together should lead to the goal or cost less, as numbers of the changes.

    Args:
        price: of missing the goal, N s.
        was: the flight without changes, of one.
        singles: flights with one change each.
        changes: (M, 2), see `_changes`.
    """
    effects = singles.ends - was.ends
    moved = singles.margins - was.margins
    costs = singles.spent - was.spent
    sets = np.arange(len(changes))[:, None]
    found: list[np.ndarray] = []
    for _ in range(1, _TOGETHER):
        sums = was.ends + effects[sets].sum(axis=1)
        spent = was.spent + costs[sets].sum(axis=1)
        margins = was.margins + moved[sets].sum(axis=1)
        # One more change for each set, of another pulse.
        broken = np.maximum(-(margins[:, None] + moved).min(axis=-1), 0.0)
        beyond = _beyond(sums[:, None] + effects)
        again = np.zeros(beyond.shape, bool)
        for column in range(sets.shape[1]):
            mine = changes[sets[:, column]]
            for end in (0, 1):
                again |= (mine[:, None, end] == changes[None, :, end]) & (
                    changes[None, :, end] >= 0
                )
        # The best by each weight.
        best = []
        for weight in _WEIGHTS:
            missed = beyond + weight * broken
            value = (spent[:, None] + costs) + price * np.log1p(missed)
            value[again] = np.inf
            most = min(2 * _BEAM, value.size)
            best.append(np.argpartition(value, most - 1, axis=None)[:most])
            best[-1] = best[-1][np.argsort(value.ravel()[best[-1]])]
        chosen = []
        for order in best:
            row, column = np.unravel_index(order, beyond.shape)
            grown = np.sort(np.concatenate([sets[row], column[:, None]], axis=1), axis=1)
            _, first = np.unique(grown, axis=0, return_index=True)
            chosen.append(grown[np.sort(first)][:_BEAM])
        found += [*chosen[0][: COPIES // (_TOGETHER - 1)]]
        sets = np.unique(np.concatenate(chosen), axis=0)
    return found


def _beyond(ends: np.ndarray) -> np.ndarray:
    """Errors beyond the tolerances, added up, of ends (..., quantities, axes)."""
    return np.maximum(np.linalg.norm(ends, axis=-1) - 1.0, 0.0).sum(axis=-1)
